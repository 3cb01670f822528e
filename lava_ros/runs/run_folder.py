# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The folder of a run: ``run.json``, a bag of maps, and the state of an interrupted run.

``run.json`` is written before the first map, and again at the end. Maps are flushed before the
checkpoint that includes them. A resumed run copies the maps up to its checkpoint into a new bag.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import count
import json
import logging
from pathlib import Path
import shutil
import time as wall_clock
from typing import Any

from lava_ros.bag.run_bag import bag_in, RUN_FILE
from lava_ros.errors import LavaError, refusing
from lava_ros.files import open_input, write_output
from lava_ros.files.yaml import parse_json
from lava_ros.runs.drive import Sink
from lava_ros.runs.map_bag import RunBag
from lava_ros.scene import Scene
from lava_ros.simulation.output.checkpoint import Checkpoint, from_bytes

_LOG = logging.getLogger(__name__)

#: Version of the format of ``run.json``.
VERSION = 1

#: Names in the folder: the bag of maps, and the state of an interrupted run.
MAPS, CHECKPOINT = 'maps', 'checkpoint'

#: Wall time after which a run stores its state again [s].
KEEP_EVERY = 10.0

#: Values of ``status``.
RUNNING, FINISHED = 'running', 'finished'


class RunFolder:
    """The folder of one run.

    Attributes:
        path: The folder.
        bag: The bag of its maps.
        checkpoint: State from which the run is resumed; None for a new run.
        record: Contents of ``run.json``.
        wall_time: Wall time of the earlier parts of the run [s].
    """

    def __init__(
        self, path: Path, scene: Scene, record: Mapping[str, Any], data: Mapping[str, str]
    ) -> None:
        """Create the folder, or resume the interrupted run in it.

        Args:
            path: The folder: new, empty, or of an interrupted run with the same identity.
            scene: The scene of the run.
            record: Contents of ``run.json``, with its ``identity``.
            data: Description of the bag in addition to its scene.

        Raises:
            LavaError: If the folder contains anything else, or cannot be written.
        """
        self.path, self.record = path, dict(record)
        self.checkpoint: Checkpoint | None = None
        self.wall_time = 0.0
        known = read_record(path) if (path / RUN_FILE).is_file() else {}
        if not _is_usable(path, known, record['identity']):
            expected = 'a folder that is new, empty, or of an interrupted run of the same scene'
            raise LavaError('--output', str(path), expected)
        former = bag_in(path) if known else None
        with refusing('--output', str(path), 'a folder to write to', OSError):
            path.mkdir(parents=True, exist_ok=True)
            self._read_checkpoint(known)
            maps = next(item for item in _numbered(path / MAPS) if not item.exists())
            self.bag = RunBag(maps, scene, data)
            if self.checkpoint is not None and former is not None:
                self.bag.copy(former, self.checkpoint.time)
            self._begun = wall_clock.monotonic()
            self.put({'maps': maps.name})
            if former is not None and former.is_dir():
                # the new bag has its maps up to the checkpoint
                shutil.rmtree(former)

    def keep(self, checkpoint: Checkpoint) -> None:
        """Store the state from which the run can be resumed.

        Raises:
            LavaError: If it cannot be written.
        """
        self.bag.flush()
        write_output('--output', self.path / CHECKPOINT, checkpoint.to_bytes())
        self.put({})

    @property
    def elapsed(self) -> float:
        """Wall time of the run, including its earlier parts [s]."""
        return self.wall_time + wall_clock.monotonic() - self._begun

    def finish(self, record: Mapping[str, Any]) -> dict[str, Any]:
        """Close the bag, write ``run.json`` and remove the state; return the whole record.

        Raises:
            LavaError: If a file cannot be written.
        """
        with refusing('--output', str(self.path), 'a folder to write to', OSError):
            self.bag.close()
            self.put({**record, 'status': FINISHED})
            (self.path / CHECKPOINT).unlink(missing_ok=True)
        return {'folder': str(self.path), **self.record}

    def close(self) -> None:
        """Close the bag of an interrupted run.

        Raises:
            LavaError: If it cannot be written.
        """
        with refusing('--output', str(self.path), 'a folder to write to', OSError):
            self.bag.close()

    def put(self, changes: Mapping[str, Any]) -> None:
        """Write ``run.json`` with some values changed.

        Raises:
            LavaError: If it cannot be written.
        """
        self.record = {
            'version': VERSION, **self.record, 'wall_time_s': self.elapsed, **changes,
            'node': self.bag.node.name, 'topics': self.bag.layer_topics,
        }
        text = json.dumps(self.record, indent=1) + '\n'
        write_output('--output', self.path / RUN_FILE, text)

    def _read_checkpoint(self, known: Mapping[str, Any]) -> None:
        file = self.path / CHECKPOINT
        if not known or not file.is_file():
            return
        self.checkpoint = from_bytes(file.read_bytes())
        self.wall_time = float(known['wall_time_s'])
        models = [item['program']['model'] for item in (known, self.record)]
        if models[0] != models[1]:
            _LOG.warning(
                '{} was begun with model {}, and continues with model {}: the result is that of '
                'neither'.format(self.path, *models)
            )
        self.record = dict(known)


def read_record(path: Path) -> dict[str, Any]:
    """Read the ``run.json`` of a folder.

    Raises:
        LavaError: If it cannot be read or is not that of a run.
    """
    expected = 'a run.json that lava run has written'
    with refusing('run', str(path), expected, OSError, KeyError, TypeError, ValueError):
        with open_input(path / RUN_FILE) as file:
            record: dict[str, Any] = parse_json(RUN_FILE, file.read())
        if record['version'] > VERSION:
            raise LavaError(f'version of {path / RUN_FILE}', record['version'], f'{VERSION}')
        return record


def unused_folder(parent: Path, name: str, identity: str) -> Path:
    """Return the first folder of a name, with a number if needed, that a run can use.

    It is new, empty, or that of an interrupted run with the same identity.
    """
    return next(
        path for path in _numbered(parent / name)
        if _is_usable(path, read_record(path) if (path / RUN_FILE).is_file() else {}, identity)
    )


def _numbered(path: Path) -> Iterator[Path]:
    """Yield a path, and then the path with the numbers from 2 in its name."""
    yield path
    for number in count(2):
        yield path.with_name(f'{path.name}_{number}')


def _is_usable(path: Path, known: Mapping[str, Any], identity: str) -> bool:
    """Return True if a run with an identity may use a folder."""
    if known:
        return known.get('status') == RUNNING and known.get('identity') == identity
    return not path.exists() or (path.is_dir() and not any(path.iterdir()))


class KeepSink(Sink):
    """Stores the state of a run at intervals of wall time."""

    def __init__(self, folder: RunFolder) -> None:
        """Initialize with the folder."""
        self._folder = folder
        self.wall_due = wall_clock.monotonic() + KEEP_EVERY

    def observe(self, simulation: Any, time: float) -> Iterable[object]:
        """Store the state."""
        self._folder.keep(simulation.checkpoint())
        self.wall_due = wall_clock.monotonic() + KEEP_EVERY
        return ()
