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

"""The maps of an ensemble as GeoTIFF files, and in the other formats of ``gis.py``."""

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from lava_ros.forecast.members import Plan
from lava_ros.maps import gis
from lava_ros.maps.forecast import HazardMaps


def write_atlas(
    folder: Path,
    maps: HazardMaps,
    plan: Plan,
    tags: Mapping[str, str],
    formats: Collection[str] | None = None,
) -> list[Path]:
    """Write the maps of an ensemble to a folder, replacing files of the same names.

    The maps are probability, arrival times, expected thickness and elevation, each as GeoTIFF.
    ``formats`` are further formats, of ``export.FORMATS``; vector formats hold contours of
    probability and isochrones. None stands for GeoJSON where the terrain's coordinate system is
    known, else for no further format.

    Returns:
        The paths of the files.

    Raises:
        LavaError: A file cannot be written, or a library for a format is missing.
    """
    place = gis.place_of(plan.scene.terrain)
    tags = {
        'members': str(maps.members),
        'effective_members': repr(maps.effective_members),
        'horizon_s': repr(plan.horizon),
        'threshold_m': repr(plan.threshold),
        **tags,
    }
    written = []
    layers = _layers(maps, plan)
    for name, (values, unit, meaning) in layers.items():
        path = folder / f'{name}.tif'
        gis.write_map(path, values, place, name=name, unit=unit, meaning=meaning, tags=tags)
        written.append(path)
        gis.write_style(path, name, values)
    if formats is None:
        formats = () if place.crs is None else ('geojson',)
    shapes = {'inundation_probability': gis.probabilities(maps.probability, place)}
    for name in layers:
        if name.startswith('arrival'):
            shapes[name] = gis.isochrones(layers[name][0], place)
    title = f'lava flow, {maps.members} members'
    return [*written, *gis.write_formats(folder, formats, shapes, layers, place, title)]


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
        'elevation': (plan.scene.terrain.elevation, 'm', 'elevation of the ground without lava'),
    }
    for share, values in maps.arrival.items():
        percent = round(100 * share)
        layers[f'arrival_time_p{percent}'] = (
            values, 's',
            f'time by which {percent} % of the members had lava, to {maps.arrival_error:g} s; '
            f'no data: fewer had any within {hours:g} h',
        )
    return layers
