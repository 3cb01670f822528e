# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The scene that a command's arguments name, and the one there is without them."""

import argparse
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
import logging
import math
from typing import Any

import numpy as np

from lava_ros.cli.options import Argument, argument
from lava_ros.errors import LavaError
from lava_ros.files.columns import angle
from lava_ros.hindcast.tables import series_of
from lava_ros.scene import KELVIN, read_scene, Scene, scene_from_dict, Terrain
from lava_ros.scene.effusion_rates import (
    error_of_rates,
    GAPS,
    Interval,
    Options,
    read_effusion_rates,
    series_of_rates,
)
from lava_ros.scene.materials import DEFAULT as DEFAULT_MATERIAL
from lava_ros.scene.projection import is_degrees, projected
from lava_ros.scene.reshaping import finer
from lava_ros.scene.terrain_files import demo_terrain, load_terrain
from lava_ros.scene.vent_files import read_vents, VentRow
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolution_of

_LOG = logging.getLogger(__name__)

#: Vents of the demo, (x, y) [m] and effusion rate [m3/s]: in the crater, which is open to the
#: north, and on either side of its opening.
DEMO_VENTS = (
    (4050.0, 3300.0, 60.0),
    (3200.0, 4300.0, 20.0),
    (5300.0, 4200.0, 20.0),
)

#: Default effusion rate [m3/s] and largest default radius [m] of a vent.
SUMMIT_DISCHARGE, SUMMIT_RADIUS = 50.0, 20.0

#: Largest side of a map's cells over the spacing of particles, and most cells after a division.
CELL, MOST_CELLS = 3.0, 1_000_000


def vent_arguments(of: str) -> tuple[Argument, ...]:
    """The arguments that replace vents and lava of a scene, or of what else has some."""
    usual, lava = '', ''
    if of == 'scene':
        usual = ' (default without a scene: the summit)'
        lava = f' (default where it names none: {DEFAULT_MATERIAL})'
    return (
        argument(
            '--vent', 'LON,LAT', 'position of a vent: longitude,latitude or easting,northing; '
            f'replaces the vents of the {of}; may be repeated{usual}', action='append',
        ),
        argument(
            '--vents', 'FILE', 'file of points and lines (fissures), which replace the vents of '
            f'the {of}: GeoJSON, GeoPackage, Shapefile, KML, or .csv with x,y or lon,lat (of a '
            'fissure also x_end,y_end or lon_end,lat_end); it may give the name, effusion_rate '
            '[m3/s], radius [m] and temperature [K] of each (docs/FORMATS.md)',
        ),
        argument(
            '--effusion-rate --discharge', 'Q', 'effusion rate of each vent [m3/s]'
            + (', or a table of the rates of all vents together (docs/FORMATS.md)'
               if of == 'scene' else ''),
            type=_rate, dest='discharge',
        ),
        argument(
            '--material', 'NAME', "lava by name ('lava materials' lists them); replaces the lava "
            f'of the {of}{lava}',
        ),
    )


def _rate(text: str) -> float | str:
    """A rate, or the name of a table."""
    try:
        return float(text)
    except ValueError:
        return text


#: Options that say how a table of effusion rates is read.
RATE_OPTIONS = ('eruption_start', 'gaps', 'porosity')

_TABLE = (
    argument(
        '--eruption-start', 'DATE', 'start of the eruption, 2021-09-19T14:10:00Z, for a table of '
        'effusion rates with dates (default: the first date)',
    ),
    argument(
        '--gaps', None, 'effusion rate in the gaps of a table: zero, or interpolate between its '
        'neighbours (default: zero, with a warning)', choices=GAPS,
    ),
    argument(
        '--porosity', 'P', 'fraction of bubbles in the lava, for a table of dense-rock effusion '
        'rates (default: the rates are bulk rates)', float,
    ),
)

_FILE = 'scene file (YAML): terrain, vents and lava'

_PARTS: tuple[str | Argument, ...] = (
    argument(
        '--terrain', 'FILE', 'elevation: GeoTIFF or another raster (docs/FORMATS.md), or npz; '
        "replaces the scene's terrain (default without a scene: Mount St. Helens, 7.8 x 7.8 km)",
    ),
    '--epsg',
    '--nodata',
    argument(
        '--fill-holes', None, 'fill pits and inner cells without data from the cells around them',
        action='store_true',
    ),
    *vent_arguments('scene'),
    *_TABLE,
)

#: The arguments that choose a scene: its file without a flag, or with one.
SCENE = (argument('scene', 'SCENE', _FILE, nargs='?'), *_PARTS)
SCENE_OPTIONS = (argument('--scene', 'FILE', _FILE), *_PARTS)


def terrain_options(args: argparse.Namespace) -> dict[str, Any]:
    """The options of ``load_terrain`` that the arguments give.

    Raises:
        LavaError: --nodata is neither a number nor ``none``.
    """
    given: dict[str, Any] = {'epsg': args.epsg, 'nodata': args.nodata}
    if args.nodata not in (None, 'none'):
        try:
            given['nodata'] = float(args.nodata)
        except ValueError:
            raise LavaError('--nodata', args.nodata, 'a number, or none') from None
    given['fill_holes'] = getattr(args, 'fill_holes', None) or None
    return {name: value for name, value in given.items() if value is not None}


def vents_as_given(args: argparse.Namespace, terrain: Terrain) -> list[VentRow]:
    """The vents that the arguments name, if any.

    Raises:
        LavaError: An argument or a file cannot be used.
    """
    if args.vent and args.vents:
        raise LavaError('--vent', args.vent[0], 'no --vent together with --vents')
    if args.vents:
        return list(_vents_of(args.vents, args.discharge, terrain))
    rate = None if isinstance(args.discharge, str) else args.discharge
    return [
        VentRow(f'vent {index}', _place(text, terrain), discharge=rate)
        for index, text in enumerate(args.vent or ())
    ]


def _vents_of(path: str, rate: float | str | None, terrain: Terrain) -> Iterator[VentRow]:
    """The vents of a file, each with its own effusion rate or else that of the command."""
    for vent in read_vents('--vents', path, terrain):
        if vent.discharge is not None and rate is not None:
            right = f'no --effusion-rate, since {path} has its own'
            raise LavaError('--effusion-rate', rate, right)
        for place in vent.places:
            if not terrain.covers(*terrain.to_map(*place)):
                shown = 'easting {:.10g}, northing {:.10g}'.format(*place)
                right = f'a place {terrain.bounds(projected=True)}'
                raise LavaError(f'a vent of {path} ({vent.name})', shown, right)
        if vent.discharge is None and isinstance(rate, float):
            vent = replace(vent, discharge=rate * vent.part)
        yield vent


def scene_from_arguments(args: argparse.Namespace) -> Scene:
    """Make the scene that the arguments choose, with cells that are fine enough for the flow.

    Cells are divided until they are no wider than ``CELL`` times the spacing of the particles.

    Raises:
        LavaError: A file or an argument cannot be used.
    """
    scene = scene_as_given(args)
    spacing = resolution_of(scene, preset_accuracy(DEFAULT)).spacing
    factor = math.ceil(scene.terrain.resolution / (CELL * spacing))
    most = math.isqrt(MOST_CELLS // scene.terrain.elevation.size)
    return replace(scene, terrain=finer(scene.terrain, max(min(factor, most), 1)))


def scene_as_given(args: argparse.Namespace) -> Scene:
    """Make the scene that the arguments choose, and log where its vents are.

    A terrain without a scene gets a vent on its highest point away from the borders.

    Raises:
        LavaError: A file or an argument cannot be used.
    """
    given = terrain_options(args)
    terrain = load_terrain(args.terrain, **given) if args.terrain else None
    data: dict[str, Any] = {}
    if args.scene:
        data, terrain = read_scene(args.scene, terrain=terrain, options=given)
    elif terrain is None:
        for name, value in given.items():
            right = 'left out without --terrain or a scene'
            raise LavaError(f'--{name.replace("_", "-")}', value, right)
        terrain = demo_terrain()
        data['vents'] = [
            {'position': (x, y), 'discharge': discharge, 'radius': 20.0, 'name': f'vent {index}'}
            for index, (x, y, discharge) in enumerate(DEMO_VENTS)
        ]
    else:
        data['vents'] = [_usual_vent(terrain, position=_summit(terrain), name='summit')]
    vents = vents_as_given(args, terrain)
    rates = _rates_of(args)
    if vents and rates:
        # those of a table are divided like those of a case
        series = series_of(tuple(vents), rates)
        vents = [
            replace(vent, discharge=own) for vent, own in zip(vents, series, strict=True)
        ]
    for vent in () if rates else vents:
        is_own = args.discharge is None and vent.discharge is not None
        if not is_own and not math.isclose(vent.share, vent.part):
            right = 'none without a table that vents divide: --effusion-rate FILE'
            raise LavaError(f'share of {vent.name!r}', vent.share / vent.part, right)
    if vents:
        data['vents'] = [_described(vent, terrain) for vent in vents]
    if args.material is not None:
        data['lava'] = {'material': args.material}
    scene = scene_from_dict(data, terrain)
    if args.discharge is not None and not vents:
        if not scene.vents:
            right = 'no --effusion-rate for a scene without vents, or --vent'
            raise LavaError('--effusion-rate', args.discharge, right)
        rate = args.discharge
        if rates:
            rate = [(time, q / len(scene.vents)) for time, q in series_of_rates(rates)]
        changed = (replace(vent, discharge=rate) for vent in scene.vents)
        scene = replace(scene, vents=tuple(changed))
    error = error_of_rates(rates)
    if error is not None and scene.uncertainty.discharge is None:
        scene = replace(scene, uncertainty=replace(scene.uncertainty, discharge=error))
    _tell(scene)
    return scene


def _rates_of(args: argparse.Namespace) -> tuple[Interval, ...]:
    """The table of effusion rates that the arguments name, if any."""
    given = {name: getattr(args, name) for name in RATE_OPTIONS if getattr(args, name) is not None}
    if isinstance(args.discharge, str):
        given['start'] = given.pop('eruption_start', None)
        return read_effusion_rates('--effusion-rate', args.discharge, Options(**given))
    for name, value in given.items():
        option = f'--{name.replace("_", "-")}'
        raise LavaError(option, value, f'no {option} without a table: --effusion-rate FILE')
    return ()


def _place(text: str, terrain: Terrain) -> tuple[float, float]:
    """Easting and northing of what is typed for a vent: longitude, latitude where it can be."""
    x, y = _coordinates(text)
    is_geographic = terrain.has_system and is_degrees((x, y))
    place = projected(terrain, x, y) if is_geographic else (x, y)
    if not terrain.covers(*terrain.to_map(*place)):
        right = f'a place {terrain.bounds(projected=True)}'
        if is_geographic:
            right += '; this is easting {:.0f}, northing {:.0f}'.format(*place)
        raise LavaError('--vent', text.strip(), right)
    return place


def _coordinates(text: str) -> tuple[float, float]:
    """The two numbers of a place; the hemispheres of degrees may be in either order."""
    first, _, second = text.partition(',')
    try:
        x, y = float(first), float(second)
        if math.isfinite(x + y):
            return x, y
    except ValueError:
        if first.strip()[-1:].upper() in ('N', 'S') or first.strip()[:1].upper() in ('N', 'S'):
            first, second = second, first
        with suppress(LavaError):
            return angle('', first, 'longitude'), angle('', second, 'latitude')
    right = 'longitude,latitude [degrees] or easting,northing [m]'
    raise LavaError('--vent', text.strip(), right)


def _tell(scene: Scene) -> None:
    terrain = scene.terrain
    for vent in scene.vents:
        cell = terrain.cell_at(*vent.position)
        assert cell is not None
        east, north = np.add(vent.position, terrain.offset)
        _LOG.info(
            f'{vent.name or "vent"}: easting {east:.10g}, northing {north:.10g}, '
            f'{terrain.elevation[cell]:.0f} m high, {vent.peak:g} m3/s at most, '
            f'{vent.temperature - KELVIN:.0f} Celsius'
        )


def _usual_vent(terrain: Terrain, **known: Any) -> dict[str, Any]:
    """A vent as a scene file has it; what is not known of it is usual."""
    radius = min(2.0 * terrain.resolution, SUMMIT_RADIUS)
    return {'discharge': SUMMIT_DISCHARGE, 'radius': radius} | known


def _described(vent: VentRow, terrain: Terrain) -> dict[str, Any]:
    flux = SUMMIT_DISCHARGE * vent.part if vent.discharge is None else vent.discharge
    if isinstance(flux, float) and math.isfinite(vent.end):
        flux = ((max(vent.start, min(0.0, vent.end - 1.0)), flux), (vent.end, 0.0))
    elif isinstance(flux, float) and math.isfinite(vent.start):
        flux = ((vent.start, flux),)
    known = {
        'radius': vent.radius, 'temperature': vent.temperature, 'projected_end': vent.other_end,
    }
    return _usual_vent(
        terrain, name=vent.name, projected=vent.place, discharge=flux,
        **{name: value for name, value in known.items() if value is not None},
    )


def _summit(terrain: Terrain) -> tuple[float, float]:
    """Map position of the highest cell away from the borders."""
    ground = np.where(terrain.has_data, terrain.elevation, -np.inf)
    rows, columns = terrain.shape
    inner = np.full_like(ground, -np.inf)
    here = np.s_[rows // 8 : rows - rows // 8, columns // 8 : columns - columns // 8]
    inner[here] = ground[here]
    highest = np.argmax(inner if np.isfinite(inner).any() else ground)
    row, column = np.unravel_index(int(highest), terrain.shape)
    x, y = terrain.origin
    return (x + (column + 0.5) * terrain.resolution, y + (row + 0.5) * terrain.resolution)
