# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Output of commands: progress, tables, JSON, and text without control characters."""

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
import json
import os
from pathlib import Path
import sys
import time
from typing import Any, TextIO, TYPE_CHECKING

from lava_ros.errors import LavaError, printable, refusing
from lava_ros.files import file_to_write, write_output
from lava_ros.simulation.carriers import across_key, count_key, COUNTED, METHODS

if TYPE_CHECKING:
    from lava_ros.runs.sinks import ProgressSink

#: Version of the JSON of the commands.
JSON_VERSION = 1

#: Arguments that name output files.
OUTPUTS = ('json', 'output', 'picture')

#: Wall time after which progress is shown again [s].
_SHOW_EVERY = 0.2


class Printable:
    """A text stream that escapes what ``raw`` cannot show, and control characters.

    Names and texts in bags, cases and graphs are untrusted.
    """

    def __init__(self, stream: TextIO, data: TextIO | None = None) -> None:
        """Wrap a stream; JSON goes to ``data`` if it is given."""
        self.raw: TextIO = stream.raw if isinstance(stream, Printable) else stream
        self.data = data

    def write(self, text: str) -> int:
        """Write a text."""
        encoding = getattr(self.raw, 'encoding', None) or 'utf-8'
        shown = printable(text).encode(encoding, 'backslashreplace')
        return self.raw.write(shown.decode(encoding))

    def __getattr__(self, name: str) -> Any:
        """Return any other attribute of the stream."""
        return getattr(self.raw, name)


def terminal(stream: TextIO | None = None, **options: Any) -> Any:
    """Return a rich console that bypasses ``Printable``.

    The caller must therefore make untrusted text printable before passing it to the console.
    """
    from rich.console import Console

    stream = sys.stdout if stream is None else stream
    return Console(file=stream.raw if isinstance(stream, Printable) else stream, **options)


def check_outputs(args: argparse.Namespace) -> None:
    """Check that ``--json`` can be written, and that no output overwrites another named file.

    Raises:
        LavaError: If another argument names the same file, or ``--json`` is not a writable file
            whose name ends with .json.
    """
    named = {name: value for name, value in vars(args).items() if isinstance(value, str)}
    if named.get('json', '-') != '-':
        file_to_write('--json', named['json'], ('.json',))
    for output in named.keys() & set(OUTPUTS):
        for name, value in vars(args).items():
            if name != output and any(_is_same(named[output], item) for item in _texts(value)):
                raise LavaError(f'--{output}', named[output], f'a file other than {name}')


def _texts(value: object) -> Iterator[str]:
    """Yield the texts of an argument, which may be given several times or have several values."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for item in value:
            yield from _texts(item)


def write_json(data: Mapping[str, Any], *names: str | Path | None) -> None:
    """Write data as JSON to files, or to stdout for ``-``; None is ignored.

    ``version`` is that of the format (schemas/json_*.schema.json), unless the data have their own.
    ``main`` keeps all other output of a command with ``--json -`` from stdout.
    """
    # in ASCII, because a terminal may interpret characters at or above 128
    text = json.dumps({'version': JSON_VERSION, **data}, indent=1) + '\n'
    for name in names:
        if name == '-':
            print(text, end='', file=getattr(sys.stdout, 'data', None))
        elif name is not None:
            write_output('--json', name, text)


def with_units(data: Any, **units: str) -> Any:
    """Return plain data whose keys end with their unit, at any depth.

    Args:
        data: Plain data.
        units: Names of keys, separated by spaces, by their unit: ``m='spacing width'``.
    """
    if isinstance(data, Mapping):
        new = {name: f'{name}_{unit}' for unit, names in units.items() for name in names.split()}
        return {new.get(key, key): with_units(value, **units) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [with_units(value, **units) for value in data]
    return data


def accuracy_as_dict(accuracy: Any) -> dict[str, Any]:
    """Return an accuracy as plain data with units."""
    return {key_of(one): getattr(accuracy, one.name) for one in fields(accuracy)}


def key_of(one: Any) -> str:
    """Return the JSON key of a field of a dataclass: its name, and its unit if it has one."""
    unit = one.metadata.get('unit', '').replace('/', '_per_')
    return f'{one.name}_{unit}' if unit else str(one.name)


def table_lines(rows: Sequence[Sequence[str]], sides: str) -> list[str]:
    """Format rows as the lines of a table; each column is as wide as its widest cell.

    ``sides`` has one character for each column: ``<`` aligns it left, ``>`` right.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        '  '.join(
            f'{cell:{side}{width}}' for cell, side, width in zip(row, sides, widths, strict=True)
        ).rstrip()
        for row in rows
    ]


def print_facts(rows: Iterable[tuple[str, object]]) -> None:
    """Print names and values in two columns."""
    for name, value in rows:
        print(f'{name:32} {value}')


def flow_facts(
    record: Mapping[str, Any], resolution: Mapping[str, Any], method: str = METHODS[0]
) -> list[tuple[str, str]]:
    """Describe a simulated flow: its resolution, error, areas and volumes.

    Args:
        record: Results with the keys of ``run.json``.
        resolution: Mapping with ``spacing_m`` [m] and ``across_key``, None if unknown.
        method: Carriers of the lava (``Accuracy.method``).
    """
    from lava_ros.layers.numbers import area_words
    from lava_ros.simulation.output.budget import VolumeBudget

    across, are_cells = resolution[across_key(method)], method == 'cells'
    budget = VolumeBudget.from_texts({name: str(value) for name, value in record.items()})
    assert budget is not None
    return [
        (COUNTED[method],
         f'{record[count_key(method)]:,}, {"of " * are_cells}{resolution["spacing_m"]:.3g} m'
         f'{"" if are_cells else " apart"}'),
        (f'{method} across the flow', 'unknown' if across is None else f'{across:.2g}'),
        # absent from folders of older versions
        *([('kind of flow', record['flow_kind'])] if record.get('flow_kind') else []),
        ('numerical error', record['numerical_error_text']),
        ('inundated area', area_words(record['inundated_area_m2'])),
        ('standing area', area_words(record['standing_area_m2'])),
        *((f'volume {name}', value) for name, value in budget.rows()),
    ]


def made_folder(name: str | Path) -> Path:
    """Create the folder that ``--output`` names, unless it exists.

    Raises:
        LavaError: If it cannot be created.
    """
    folder = Path(name)
    with refusing('--output', str(name), 'a writable folder', OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def _is_same(one: str, other: str) -> bool:
    try:
        return os.path.samefile(one, other)
    except (OSError, ValueError):
        return False


class Progress:
    """A progress bar with the remaining time in a terminal, otherwise a line for each tenth."""

    def __init__(self, stream: TextIO | None = None, *, has_lines: bool = True) -> None:
        """Show progress on a stream, by default stdout; ``has_lines`` is for long work."""
        self._stream = sys.stdout if stream is None else stream
        self._tenths = -1 if has_lines or self._stream.isatty() else 10
        self._started = self._due = time.monotonic()
        self._bar = None
        if self._stream.isatty():
            from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            self._bar = Bar(
                TextColumn('{task.description}', markup=False),
                BarColumn(bar_width=None),
                TextColumn('{task.percentage:3.0f} %'),
                TimeRemainingColumn(compact=True),
                console=terminal(self._stream),
                transient=True,
                # do not redirect prints if stdout is not the terminal
                redirect_stdout=sys.stdout.isatty(),
            )
            self._task = self._bar.add_task('compiling', total=1.0)

    def __enter__(self) -> 'Progress':
        """Show the bar."""
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.stop()

    @property
    def is_due(self) -> bool:
        """Return True if what is shown is old enough to be replaced."""
        return time.monotonic() > self._due

    def sink(self, until: float) -> 'ProgressSink':
        """Return a sink that shows the simulated time of a run up to a time [s]."""
        from lava_ros.layers.numbers import duration
        from lava_ros.runs.sinks import ProgressSink

        return ProgressSink(
            lambda time: self.show(duration(time), time / until), until, lambda: self.is_due
        )

    def show(self, what: str, done: float) -> None:
        """Show the current activity, and the completed fraction of the work."""
        self._due = time.monotonic() + _SHOW_EVERY
        if self._bar is not None:
            self._bar.update(self._task, completed=done, description=printable(what))
            return
        tenths = int(10.0 * done)
        if tenths > self._tenths:
            self._tenths = tenths
            elapsed = time.monotonic() - self._started
            left = f', {elapsed / done - elapsed:.0f} s left' if 0.05 < done < 1.0 else ''
            print(f'{10 * tenths:3d} %  {what}{left}', file=self._stream, flush=True)
