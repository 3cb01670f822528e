# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Comparison of two ensembles of the same members, with and without barriers."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.files import write_output
from lava_ros.files.csv import format_table
from lava_ros.layers.numbers import area_words, duration
from lava_ros.products.arrivals import table_of
from lava_ros.products.gis import PROBABILITIES, Provenance, write_grid
from lava_ros.products.run_page import read_run
from lava_ros.products.sheet import draw_sheet
from lava_ros.scene.features import read_features

#: Files of a comparison: the map of the difference, the picture, and the table of places.
CHANGE, PICTURE, TABLE = 'probability_change', 'barriers.png', 'places.csv'

#: Columns of the table of places: each place, and its values without and with barriers.
_VALUES = ('probability_percent', 'arrival_p10_s', 'arrival_p50_s', 'arrival_p90_s')
_CASES = ('without', 'with')
COLUMNS = ('name', 'kind', *(f'{value}_{case}' for value in _VALUES for case in _CASES))


def compare_ensembles(
    without: Path, with_barriers: Path, output: Path, *, places: Sequence[str] = (),
    lines: Sequence[str] = (), built: float = 0.0, origin: Provenance,
) -> dict[str, Any]:
    """Compare two ensembles, and write maps, a picture, and a table of places.

    Args:
        without: Folder of the ensemble without barriers.
        with_barriers: Folder of the ensemble with barriers.
        output: Folder for the files.
        places: Files of points, lines and areas; without files there is no table.
        lines: Files of barriers that are built later and are not part of the terrain.
        built: Simulated time at which the barriers are built [s].
        origin: Origin of the maps, for their tags.

    Returns:
        Areas by minimum probability [m2] and places, without and with barriers, and the written
        ``files``.

    Raises:
        LavaError: If an ensemble or a file of places cannot be read, or a file cannot be written.
    """
    runs = [read_run(path) for path in (without, with_barriers)]
    likely = [np.nan_to_num(run.panels['inundation_probability'].values) for run in runs]
    terrain = runs[1].terrain
    change = np.where(terrain.has_data, likely[1] - likely[0], np.nan)
    files = write_grid(output / f'{CHANGE}.tif', CHANGE, change, terrain, origin)[:1]
    areas = {
        f'at least {least:g} %': {
            name: run.ensemble.areas[least]
            for name, run in zip(_CASES, runs, strict=True) if run.ensemble is not None
        }
        for least in PROBABILITIES
    }
    panels = [
        replace(run.panels['inundation_probability'], title=title)
        for run, title in zip(runs, ('Without barriers', 'With barriers'), strict=True)
    ]
    shown = np.where(change != 0.0, change, np.nan)
    panels.append(replace(panels[1], source='change', values=shown, title='Change'))
    texts = [area_words(areas['at least 50 %'][case]) for case in _CASES]
    subtitle = f'{texts[0]} at 50 % or more without barriers, {texts[1]} with barriers'
    draw_sheet(
        panels, output / PICTURE, title=f'Effect of barriers: {runs[0].title}',
        subtitle=f'{subtitle} built after {duration(built)}' if built else subtitle,
        overlays={
            Path(path).stem: read_features('--places', path, terrain)
            for path in (*places, *lines)
        },
        notes={
            term: text for term, text in runs[1].facts.items()
            if term in ('effusion rate', 'lava', 'runs', 'inundation', 'warning', 'model')
        },
    )
    files.append(output / PICTURE)
    rows = []
    if places:
        tables = [
            table_of(path, places, field='--places').as_dict()['places']
            for path in (without, with_barriers)
        ]
        rows = [
            {
                'name': one['name'], 'kind': one['kind'],
                **{
                    f'{value}_{case}': row[value]
                    for value in _VALUES for case, row in (('without', one), ('with', other))
                },
            }
            for one, other in zip(*tables, strict=True)
        ]
        write_output('--output', output / TABLE, format_table(COLUMNS, rows))
        files.append(output / TABLE)
    return {'area_m2': areas, 'places': rows, 'files': [str(path) for path in files]}


def place_texts(rows: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Format the table of places for people: titles, then a row for each place."""
    titles = ('place', 'probability without', 'with', 'arrival (50 %) without', 'with')

    def probability(value: float | None) -> str:
        return '-' if value is None else f'{value:.0f} %'

    def moment(value: float | None) -> str:
        return '-' if value is None else duration(value)

    return [titles, *(
        (
            row['name'], *(probability(row[f'probability_percent_{case}']) for case in _CASES),
            *(moment(row[f'arrival_p50_s_{case}']) for case in _CASES),
        )
        for row in rows
    )]
