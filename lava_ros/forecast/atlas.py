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

"""The maps of an ensemble as GeoTIFF files."""

from collections.abc import Mapping
import json
from pathlib import Path

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.forecast.members import Plan
from lava_ros.forecast.probability import HazardMaps
from lava_ros.geotiff import coordinate_system, NODATA, write_map


def write_atlas(
    folder: Path, maps: HazardMaps, plan: Plan, tags: Mapping[str, str]
) -> list[Path]:
    """Write probability, arrival times and expected thickness.

    Args:
        folder: Where the files go; those of the same name are replaced.
        maps: The maps.
        plan: What they are of.
        tags: What else is to be known, by name.

    Raises:
        LavaError: A file cannot be written.
    """
    terrain = plan.scene.terrain
    crs = coordinate_system(terrain.epsg)
    corner = (terrain.origin[0] + terrain.offset[0], terrain.origin[1] + terrain.offset[1])
    tags = {
        'members': str(maps.members),
        'effective_members': repr(maps.effective_members),
        'horizon_s': repr(plan.horizon),
        'threshold_m': repr(plan.threshold),
        **tags,
    }
    written = []
    for name, (values, unit, meaning) in _layers(maps, plan).items():
        path = folder / f'{name}.tif'
        write_map(
            path,
            np.where(np.isfinite(values), values, NODATA).astype(np.float32),
            corner=corner,
            resolution=terrain.resolution,
            crs=crs,
            name=name,
            unit=unit,
            meaning=meaning,
            tags=tags,
        )
        written.append(path)
    return written


def _layers(maps: HazardMaps, plan: Plan) -> dict[str, tuple[np.ndarray, str, str]]:
    hours = plan.horizon / 3600.0
    layers = {
        'inundation_probability': (
            maps.probability, '%',
            f'probability that lava as thick as the threshold comes within {hours:g} h',
        ),
        'expected_thickness': (
            maps.thickness, 'm', 'mean over the members of the largest thickness of the lava'
        ),
    }
    for share, values in maps.arrival.items():
        percent = round(100 * share)
        layers[f'arrival_time_p{percent}'] = (
            values, 's',
            f'time by which {percent} % of the members had lava, to {maps.arrival_error:g} s; '
            f'no data: fewer had any within {hours:g} h',
        )
    return layers


def write_report(path: str | Path, report: Mapping[str, object]) -> None:
    """Write what an ensemble was and said as JSON.

    Raises:
        LavaError: The file cannot be written.
    """
    text = json.dumps(report, indent=1, allow_nan=False)
    try:
        Path(path).write_text(text + '\n', encoding='utf-8')
    except OSError as error:
        raise LavaError('--json', str(path), f'a file to write ({error})') from error
