# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The table of the arrival of lava at places, of several commands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lava_ros.cli.console import table_lines

if TYPE_CHECKING:
    from lava_ros.layers.place_arrivals import ArrivalTable


def arrivals_at(files: Sequence[str], path: Path) -> ArrivalTable | None:
    """Return the arrivals at the places of files in a run on disk; None without files.

    Raises:
        LavaError: If the run or a file of places cannot be read.
    """
    from lava_ros.products.arrivals import table_of

    return table_of(path, files, field='--places') if files else None


def print_arrivals(table: ArrivalTable | None) -> None:
    """Print a table, unless it is None."""
    if table is not None:
        texts = table.as_texts()
        sides = ''.join('<' if name in ('place', 'note') else '>' for name in texts[0])
        print('\n'.join([table.summary, *table_lines(texts, sides)]))
