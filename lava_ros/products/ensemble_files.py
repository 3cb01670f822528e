# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The maps of an ensemble as files for GIS."""

from collections.abc import Collection, Mapping
from pathlib import Path

from lava_ros.files import vectors
from lava_ros.forecast.members import Plan
from lava_ros.layers.forecast import HazardMaps
from lava_ros.products import gis
from lava_ros.scene import Terrain
from lava_ros.scene.projection import coordinate_system
from lava_ros.simulation.numerical_error import NOT_MEASURED


def write_atlas(
    folder: Path,
    maps: HazardMaps,
    plan: Plan,
    origin: gis.Provenance,
    tags: Mapping[str, str],
    formats: Collection[str] | None = None,
) -> list[Path]:
    """Write the maps of an ensemble to a folder, replacing files of the same names.

    The maps are probability, arrival times, expected peak thickness, the worst case of all
    members, and elevation, as GeoTIFF. ``formats`` are further formats, of ``export.FORMATS``;
    vector formats contain contours of probability and isochrones. None stands for GeoJSON if the
    terrain's coordinate system is known, otherwise for no further format. Formats that the folder
    already has are written again, so that all files have the same members.

    Returns:
        The paths of the files.

    Raises:
        LavaError: If a file cannot be written, or a library for a format is missing.
    """
    terrain = plan.scene.terrain
    tags = {
        'members': str(maps.members),
        'effective_members': repr(maps.effective_members),
        'horizon_s': repr(plan.horizon),
        'inundation_threshold_m': repr(plan.threshold),
        'arrival_error_s': repr(maps.arrival_error),
        **{
            f'inundated_area_p{100.0 * fraction:.0f}_m2': repr(area)
            for fraction, area in maps.areas(terrain.resolution).items()
        },
        **tags,
        **reliability_tags(maps, terrain),
    }
    layers = {
        'inundation_probability': maps.probability,
        'expected_peak_thickness': maps.thickness,
        'elevation': terrain.elevation,
    }
    if maps.worst is not None:
        layers['arrival_time_earliest'] = maps.worst.arrival
        layers['largest_peak_thickness'] = maps.worst.thickness
    known = {'inundation_threshold_m': plan.threshold}
    shapes = {'inundation_probability': gis.probabilities(maps.probability, terrain, **known)}
    for fraction, values in maps.arrival.items():
        name = f'arrival_time_p{round(100 * fraction)}'
        layers[name] = values
        shapes[name] = gis.isochrones(values, terrain, origin.onset, **known)
    written = [
        # the style belongs to its GeoTIFF
        gis.write_grid(folder / f'{name}.tif', name, values, terrain, origin, tags)[0]
        for name, values in layers.items()
    ]
    if formats is None:
        formats = gis.usual_formats(coordinate_system(terrain.epsg, terrain.wkt))
    earlier = [
        path for stem in (*shapes, *gis.STEMS) for path in folder.glob(f'{stem}.*')
        if path.suffix[1:] in (*vectors.WRITTEN, 'nc')
    ]
    formats = dict.fromkeys([*formats, *(path.suffix[1:] for path in earlier)])
    title = f'lava flow, {maps.members} members'
    tagged = {name: (values, tags) for name, values in layers.items()}
    shared = gis.write_formats(folder, formats, shapes, tagged, terrain, title, origin)
    for path in earlier:
        # a Shapefile of an area that no longer exists
        if path not in shared:
            path.unlink(missing_ok=True)
    return [*written, *shared]


def reliability_tags(maps: HazardMaps, terrain: Terrain) -> dict[str, str]:
    """Return the tags with the limits and the errors of the maps of an ensemble."""
    tags = {'unseen_percent': f'{maps.unseen:.3g}'}
    for name, percent in maps.limits()['arrives_before_percent'].items():
        tags[f'arrives_before_{name}_percent'] = f'{percent:.3g}'
    if maps.worst is not None:
        tags['inundated_area_worst_m2'] = repr(maps.worst_area(terrain.resolution))
    error = maps.spacing_error
    tags['spacing_error'] = NOT_MEASURED if error is None else error.text()
    tags['is_usable'] = 'unknown' if error is None else str(error.is_usable).lower()
    return tags
