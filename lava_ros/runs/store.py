# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Folders with ``run.json``, and the state from which an interrupted run is resumed."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
import fcntl
from itertools import count
import json
import math
import os
from pathlib import Path
import time as wall_clock
from typing import Any

from lava_ros.bag.run_bag import RUN_FILE
from lava_ros.errors import LavaError, refusing
from lava_ros.files import open_input, write_output
from lava_ros.files.yaml import parse_json
from lava_ros.runs.sinks import ScheduledSink
from lava_ros.simulation.output.checkpoint import Checkpoint, from_bytes

#: Version of the format of ``run.json``.
VERSION = 1

#: File with the last state of an interrupted run.
CHECKPOINT = 'checkpoint'

#: Parent folder of runs without ``--output``.
RUNS = Path('runs')

#: Minimum wall time after which a run stores its state again [s], and maximum fraction of the
#: wall time that storing takes.
KEEP_EVERY, MAX_KEEP_FRACTION = 10.0, 0.05

#: Values of ``status`` in ``run.json``.
RUNNING, FINISHED = 'running', 'finished'

#: Folders that a run can use.
USABLE = 'a folder that is new, empty, or of an interrupted run of the same scene and settings'


class RecordedFolder:
    """A folder with ``run.json``, which one run at a time can use.

    Attributes:
        path: The folder.
        record: Contents of ``run.json``.
    """

    def __init__(self, path: Path, record: Mapping[str, Any]) -> None:
        """Create the folder unless it exists, and keep other runs from it.

        Args:
            path: The folder, which the run can use.
            record: Contents of ``run.json``.

        Raises:
            LavaError: If the folder cannot be written, or another run is using it.
        """
        self.path, self.record = path, {'status': RUNNING, **record}
        with refusing('--output', str(path), 'a writable folder', OSError):
            path.mkdir(parents=True, exist_ok=True)
            self._lock: int | None = _locked(path)

    def put(self, changes: Mapping[str, Any]) -> None:
        """Write ``run.json`` with some values changed.

        Raises:
            LavaError: If it cannot be written.
        """
        self.record = _finite({'version': VERSION, **self.record, **changes})
        write_record(self.path, self.record)

    def finish(self, changes: Mapping[str, Any]) -> None:
        """Write ``run.json`` of a finished run, and release the folder for other runs.

        Raises:
            LavaError: If the file cannot be written.
        """
        self.put({**changes, 'status': FINISHED})
        self.close()

    def close(self) -> None:
        """Release the folder for other runs."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def __del__(self) -> None:
        """Release the folder for other runs."""
        if getattr(self, '_lock', None) is not None:
            self.close()


class RunStore(RecordedFolder):
    """A folder with ``run.json`` and the state of an interrupted run.

    Attributes:
        checkpoint: State from which the run is resumed; None for a new run.
    """

    def __init__(self, path: Path, record: Mapping[str, Any]) -> None:
        """Create the folder, or read the state of the interrupted run in it.

        Args:
            path: The folder: new, empty, or of an interrupted run with the same identity.
            record: Contents of ``run.json``, with ``identity`` and ``program``. Those of a resumed
                run replace them.

        Raises:
            LavaError: If the folder contains anything else, cannot be read or written, or another
                run is using it.
        """
        known = known_record(path)
        if not is_usable(path, known, record['identity']):
            raise LavaError('--output', str(path), USABLE)
        super().__init__(path, record)
        self.checkpoint: Checkpoint | None = None
        if (path / CHECKPOINT).is_file() and known:
            with refusing('--output', str(path), USABLE, OSError, KeyError, TypeError):
                self.checkpoint = from_bytes((path / CHECKPOINT).read_bytes())
                self.record = dict(known)

    def keep(self, checkpoint: Checkpoint, **changes: Any) -> None:
        """Store the state from which the run can be resumed.

        Args:
            checkpoint: The state.
            changes: Changes of ``run.json``.

        Raises:
            LavaError: If a file cannot be written.
        """
        self.put(changes)
        write_output('--output', self.path / CHECKPOINT, checkpoint.to_bytes())

    def finish(self, changes: Mapping[str, Any]) -> None:
        """Write ``run.json`` of a finished run, and remove its state.

        Raises:
            LavaError: If a file cannot be written.
        """
        super().finish(changes)
        with refusing('--output', str(self.path), 'a writable folder', OSError):
            (self.path / CHECKPOINT).unlink(missing_ok=True)


def write_record(folder: Path, record: Mapping[str, Any]) -> None:
    """Write the ``run.json`` of a folder.

    Raises:
        LavaError: If it cannot be written.
    """
    text = json.dumps({'version': VERSION, **_finite(record)}, indent=1, allow_nan=False) + '\n'
    write_output('--output', folder / RUN_FILE, text)


def _finite(plain: Any) -> Any:
    """Return plain data with None in place of numbers that JSON cannot represent."""
    if isinstance(plain, Mapping):
        return {key: _finite(value) for key, value in plain.items()}
    if isinstance(plain, list | tuple):
        return [_finite(value) for value in plain]
    return None if isinstance(plain, float) and not math.isfinite(plain) else plain


def _locked(path: Path) -> int:
    """Open a folder so that no other run can lock it until it is closed."""
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(folder)
        expected = 'a folder that no other run is writing to'
        raise LavaError('--output', str(path), expected) from None
    return folder


def known_record(path: Path) -> dict[str, Any]:
    """Read the ``run.json`` of a folder; empty without one.

    Raises:
        LavaError: If it cannot be read or does not describe a run.
    """
    if not (path / RUN_FILE).is_file():
        return {}
    expected = 'a folder whose run.json describes a run and is undamaged'
    with refusing('run', str(path), expected, OSError, KeyError, TypeError, ValueError):
        with open_input(path / RUN_FILE) as file:
            record: dict[str, Any] = parse_json(RUN_FILE, file.read())
        if record['version'] > VERSION:
            field = f'version of {path / RUN_FILE}'
            raise LavaError(field, record['version'], f'at most {VERSION}')
        return record


def unused_folder(name: str, identity: str, *, or_finished: bool = False) -> Path:
    """Return the first folder of a name in ``RUNS``, with a number if needed, that a run can use.

    It is new, empty, or belongs to an interrupted run with the same identity; with ``or_finished``
    also to a finished one.
    """
    return next(
        path for path in numbered(RUNS / name)
        if is_usable(path, known_record(path), identity, or_finished=or_finished)
    )


def numbered(path: Path) -> Iterator[Path]:
    """Yield a path, and then the path with the numbers 2, 3, ... in its name."""
    yield path
    for number in count(2):
        yield path.with_name(f'{path.name}_{number}')


def is_usable(
    path: Path, known: Mapping[str, Any], identity: str, *, or_finished: bool = False
) -> bool:
    """Return True if a run with an identity may use a folder whose record is ``known``."""
    if known:
        is_open = or_finished or known.get('status') == RUNNING
        return is_open and known.get('identity') == identity
    return not path.exists() or (path.is_dir() and not any(path.iterdir()))


class KeepSink(ScheduledSink):
    """Stores the state of a run at intervals of wall time."""

    def __init__(self, keep: Callable[[], object], times: Sequence[float] | None = None) -> None:
        """Initialize.

        Args:
            keep: Function that stores the state.
            times: Simulated times [s] at which the state may be stored; None for any time. A run
                in a batch needs these times, because it cannot complete a step by itself.
        """
        super().__init__([] if times is None else times)
        self._keep, self._is_free = keep, times is None
        self._wait(KEEP_EVERY)

    def observe(self, simulation: Any, time: float) -> Iterable[object]:
        """Store the state if that is due."""
        self._note_time(time)
        begun = wall_clock.monotonic()
        if begun >= self._next:
            self._keep()
            self._wait(max(KEEP_EVERY, (wall_clock.monotonic() - begun) / MAX_KEEP_FRACTION))
        return ()

    def _wait(self, duration: float) -> None:
        """Set the wall time until the state is stored again [s]."""
        self._next = wall_clock.monotonic() + duration
        if self._is_free:
            self.wall_due = self._next
