# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The table of the arrival of lava at places, of several commands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TYPE_CHECKING

from lava_ros.cli.console import table_lines

if TYPE_CHECKING:
    from lava_ros.layers.place_arrivals import ArrivalTable
    from lava_ros.scene import Terrain


def check_places(files: Sequence[str], terrain: Terrain) -> None:
    """Raise LavaError, before a run, for a file of places that cannot be used."""
    from lava_ros.layers.places import places_on
    from lava_ros.scene.features import read_features

    for file in files:
        places_on(read_features('--places', file, terrain), terrain)


def add_arrivals(record: dict[str, Any], files: Sequence[str], path: Path) -> ArrivalTable | None:
    """Add the arrivals at the places of files in a run on disk to its record.

    Returns:
        Their table; None without files.

    Raises:
        LavaError: If the run or a file of places cannot be read.
    """
    if not files:
        return None
    table = table_of_files(path, files, field='--places')
    record['places'] = table.as_dict()['places']
    return table


def table_of_files(
    path: str | Path, files: Sequence[str], *, field: str, **options: Any
) -> ArrivalTable:
    """Return the arrivals at the places of files in a run on disk; files are read first.

    Args:
        path: A bag or the folder of an ensemble.
        files: Files for ``features.load_files``.
        field: Name of the files in errors.
        options: Options of ``products.arrivals.table_of``.

    Raises:
        LavaError: If a file or the run cannot be read.
    """
    from lava_ros.products.arrivals import table_of
    from lava_ros.scene.features import load_files

    features = [item for items in load_files(field, files).values() for item in items]
    return table_of(path, features, **options)


def print_arrivals(table: ArrivalTable | None) -> None:
    """Print a table, unless it is None."""
    if table is not None:
        texts = table.as_texts()
        sides = ''.join('<' if name in ('place', 'note') else '>' for name in texts[0])
        print('\n'.join([table.summary, *table_lines(texts, sides)]))
