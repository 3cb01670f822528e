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


"""The maps of a hindcast as GeoTIFF."""

from pathlib import Path

import numpy as np

from lava_ros.geotiff import NODATA_BYTE, write_grid
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.run import Result
from lava_ros.hindcast.score import THRESHOLD
from lava_ros.hindcast.several import Agreement

#: What a cell of the comparison says.
NEITHER, HIT, MISS, FALSE_ALARM, UNKNOWN = 0, 1, 2, 3, NODATA_BYTE


def comparison(thickness: np.ndarray, footprint: np.ndarray) -> np.ndarray:
    """Hits, misses and false alarms, uint8, shape [rows, columns]."""
    covered = np.nan_to_num(thickness) >= THRESHOLD
    codes = np.full(footprint.shape, NEITHER, np.uint8)
    codes[covered & footprint] = HIT
    codes[~covered & footprint] = MISS
    codes[covered & ~footprint] = FALSE_ALARM
    codes[np.isnan(thickness) & ~footprint] = UNKNOWN
    return codes


def write_maps(case: Case, result: Result, folder: Path) -> list[Path]:
    """Write the maps, north up, on the grid of the elevation.

    Args:
        case: The case.
        result: Its run.
        folder: Where the files go; there are ones of these names no longer.

    Returns:
        The files.

    Raises:
        LavaError: rasterio is not installed, or a file cannot be written.
    """
    snapshot, terrain = result.snapshot, case.scene.terrain
    dry = np.where(terrain.has_data, 0.0, np.nan)
    thickness = np.where(terrain.has_data, snapshot.thickness, np.nan)
    maps = {
        'thickness': (thickness, 'm', 'thickness of the lava at the end; 0: none'),
        'peak_thickness': (result.peak + dry, 'm', 'largest thickness in any map; 0: none'),
        'arrival': (result.arrival, 's', 'time of the first map with lava; no data: none came'),
        'temperature': (snapshot.temperature - 273.15, 'degC', 'temperature; no data: no lava'),
    }
    files = [
        write_grid(folder / f'{name}.tif', values, terrain, unit=unit, meaning=meaning)
        for name, (values, unit, meaning) in maps.items()
    ]
    meaning = '0: neither, 1: hit, 2: miss, 3: false alarm'
    codes = comparison(snapshot.thickness, case.footprint)
    path = folder / 'comparison.tif'
    return [*files, write_grid(path, codes, terrain, unit='1', meaning=meaning)]


def write_share(case: Case, several: Agreement, folder: Path) -> Path:
    """Write the share of several runs that cover each cell, north up.

    Raises:
        LavaError: rasterio is not installed, or the file cannot be written.
    """
    terrain = case.scene.terrain
    values = np.where(terrain.has_data, several.share, np.nan)
    meaning = f'share of {len(several.scores)} runs with lava at the end'
    return write_grid(folder / 'runs.tif', values, terrain, unit='1', meaning=meaning)
