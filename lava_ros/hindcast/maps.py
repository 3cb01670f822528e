# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""The maps of a hindcast as GeoTIFF, and a picture of how it compares with what was mapped."""

from pathlib import Path

import numpy as np

import lava_ros
from lava_ros.forecast.picture import frame_of
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.replicates import Agreement
from lava_ros.hindcast.run import Result
from lava_ros.hindcast.score import covered_by, Score
from lava_ros.maps.gis import NODATA_BYTE, write_grid
from lava_ros.maps.plot import area_words, duration
from lava_ros.maps.sheet import draw_sheet, Panel
from lava_ros.pages.runs import system_words
from lava_ros.simulation.snapshot import Snapshot

#: What a cell of the comparison says.
NEITHER, HIT, MISS, FALSE_ALARM, UNKNOWN = 0, 1, 2, 3, NODATA_BYTE


def comparison(snapshot: Snapshot, footprint: np.ndarray) -> np.ndarray:
    """Hits, misses and false alarms, uint8, shape [rows, columns]."""
    covered = covered_by(snapshot)
    codes = np.full(footprint.shape, NEITHER, np.uint8)
    codes[covered & footprint] = HIT
    codes[~covered & footprint] = MISS
    codes[covered & ~footprint] = FALSE_ALARM
    codes[~snapshot.terrain.has_data & ~footprint] = UNKNOWN
    return codes


def write_maps(
    case: Case, result: Result, folder: Path, several: Agreement | None = None
) -> list[Path]:
    """Write the maps of a hindcast, north up, on the grid of its elevation.

    ``several`` is the agreement of several runs; it adds a map of the share of them that covers
    each cell.

    Returns:
        The paths of the files.

    Raises:
        LavaError: rasterio is not installed, or a file cannot be written.
    """
    snapshot, terrain = result.snapshot, case.scene.terrain
    assert snapshot.arrived is not None
    dry = np.where(terrain.has_data, 0.0, np.nan)
    thickness = np.where(terrain.has_data, snapshot.thickness, np.nan)
    maps = {
        'thickness': (thickness, 'm', 'thickness of the lava at the end; 0: none'),
        'peak_thickness': (result.peak + dry, 'm', 'largest thickness in any map; 0: none'),
        'arrival': (snapshot.arrived, 's', 'time when lava came; no data: none came'),
        'temperature': (snapshot.temperature - 273.15, 'degC', 'temperature; no data: no lava'),
    }
    if several is not None:
        meaning = f'share of {len(several.scores)} runs whose lava came there'
        maps['runs'] = (several.share + dry, '1', meaning)
    files = [
        write_grid(folder / f'{name}.tif', values, terrain, unit=unit, meaning=meaning)
        for name, (values, unit, meaning) in maps.items()
    ]
    meaning = '0: neither, 1: hit, 2: miss, 3: false alarm'
    codes = comparison(snapshot, case.footprint)
    path = folder / 'comparison.tif'
    return [*files, write_grid(path, codes, terrain, unit='1', meaning=meaning)]


def draw_comparison(case: Case, snapshot: Snapshot, judged: Score, output: Path) -> None:
    """Draw hits, misses and false alarms of a flow at its end; the suffix chooses the format.

    Raises:
        LavaError: matplotlib is not installed, or the picture cannot be written.
    """
    codes = comparison(snapshot, case.footprint).astype(np.float64)
    codes[(codes < HIT) | (codes > FALSE_ALARM)] = np.nan
    cell = case.scene.terrain.resolution**2
    areas = {'hit': judged.hits, 'miss': judged.misses, 'false alarm': judged.false_alarms}
    vents = case.scene.vents
    fissures = [(vent.position, vent.end) for vent in vents if vent.end is not None]
    facts = {
        'mapped': f'{area_words(case.area)}, {case.volume / 1e6:.3g} million m³ in '
        f'{duration(case.duration)}',
        'model': f'lava_ros {lava_ros.__version__}, depth-averaged lava as particles',
        'coordinates': system_words(case.scene.terrain.epsg),
    }
    if case.source:
        facts['source'] = case.source
    draw_sheet(
        [Panel(frame_of(case.scene), 'comparison', codes, fissures=fissures)],
        output,
        title=case.title,
        subtitle='  ·  '.join(
            [
                f'Jaccard {judged.jaccard:.3f}',
                *(f'{name} {area_words(count * cell)}' for name, count in areas.items()),
            ]
        ),
        notes=facts,
    )
