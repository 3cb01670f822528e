# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes from the arguments of a command, and the default scene."""

import argparse
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from datetime import datetime
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.cli.options import seconds_of
from lava_ros.cli.scene_options import RATE_OPTIONS
from lava_ros.errors import LavaError
from lava_ros.files.columns import angle
from lava_ros.hindcast.tables import series_of
from lava_ros.scene import (
    date_text,
    KELVIN,
    read_scene,
    Scene,
    scene_from_dict,
    Terrain,
    with_changes,
)
from lava_ros.scene.effusion_rates import (
    check_start,
    error_of_rates,
    Options,
    RateTable,
    read_effusion_rates,
    series_of_rates,
)
from lava_ros.scene.likely_places import likely_place
from lava_ros.scene.plausibility import check_date, doubts_of_scene, report
from lava_ros.scene.projection import in_degrees, projected
from lava_ros.scene.reshaping import finer
from lava_ros.scene.scene import onset_from
from lava_ros.scene.terrain_files import demo_terrain, load_terrain
from lava_ros.scene.vent_files import read_vents, VentRow
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolution_of

_LOG = logging.getLogger(__name__)

#: Vents of the demo, (x, y) [m] and effusion rate [m3/s]: one in the crater, which is open to the
#: north, and one on each side of its opening.
DEMO_VENTS = (
    (4050.0, 3300.0, 60.0),
    (3200.0, 4300.0, 20.0),
    (5300.0, 4200.0, 20.0),
)

#: Default effusion rate [m3/s] and maximum default radius [m] of a vent.
SUMMIT_DISCHARGE, SUMMIT_RADIUS = 50.0, 20.0

#: Maximum side of a cell over the particle spacing, and maximum number of cells after a division.
CELL, MAX_CELLS = 3.0, 1_000_000


def terrain_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of ``load_terrain`` in the arguments.

    Raises:
        LavaError: If --nodata is neither a number nor ``none``.
    """
    given: dict[str, Any] = {'epsg': args.epsg, 'nodata': args.nodata}
    if args.nodata not in (None, 'none'):
        try:
            given['nodata'] = float(args.nodata)
        except ValueError:
            raise LavaError('--nodata', args.nodata, 'a number, or none') from None
    for name in ('fill_holes', 'insist', 'sea_level'):
        value = getattr(args, name, None)
        # 0 m is a sea level
        given[name] = None if value is False else value
    return {name: value for name, value in given.items() if value is not None}


def vents_as_given(args: argparse.Namespace, terrain: Terrain) -> list[VentRow]:
    """Return the vents in the arguments, if any.

    Raises:
        LavaError: If an argument or a file is not valid.
    """
    if args.vent and args.vents:
        raise validation.conflict('--vent', '--vents')
    if args.vents:
        return list(_vents_of(args.vents, args.discharge, terrain))
    rate = None if isinstance(args.discharge, str) else args.discharge
    return [
        VentRow(
            f'vent {index}', place_as_typed('--vent', text, terrain, on_terrain=True),
            discharge=rate,
        )
        for index, text in enumerate(args.vent or ())
    ]


def _vents_of(path: str, rate: float | str | None, terrain: Terrain) -> Iterator[VentRow]:
    for vent in read_vents('--vents', path, terrain):
        if vent.discharge is not None and rate is not None:
            raise validation.conflict('--effusion-rate', f'the effusion rates in {path}')
        for place in vent.places:
            if not terrain.covers(*terrain.to_map(*place)):
                shown = 'easting {:.10g}, northing {:.10g}'.format(*place)
                expected = f'a place {terrain.bounds(projected=True)}'
                expected += likely_place(terrain, *place)
                raise LavaError(f'a vent of {path} ({vent.name})', shown, expected)
        if vent.discharge is None and isinstance(rate, float):
            vent = replace(vent, discharge=rate * vent.part)
        yield vent


def scene_from_arguments(args: argparse.Namespace) -> Scene:
    """Make the scene of the arguments, with cells of at most ``CELL`` times the particle spacing.

    Raises:
        LavaError: If an argument or a file is not valid.
    """
    scene = scene_as_given(args)
    spacing = resolution_of(scene, preset_accuracy(DEFAULT)).spacing
    factor = math.ceil(scene.terrain.resolution / (CELL * spacing))
    most = math.isqrt(MAX_CELLS // scene.terrain.elevation.size)
    return scene.on(lambda terrain: finer(terrain, max(min(factor, most), 1)))


def scene_as_given(args: argparse.Namespace) -> Scene:
    """Make the scene of the arguments, and log the positions of its vents.

    A terrain without a scene gets a vent on its highest point away from the borders.

    Raises:
        LavaError: If an argument or a file is not valid.
    """
    given = terrain_options(args)
    terrain = load_terrain(args.terrain, **given) if args.terrain else None
    data: dict[str, Any] = {}
    if args.scene:
        data, terrain = read_scene(args.scene, terrain=terrain, options=given)
    elif terrain is None:
        for name, value in given.items():
            if name == 'insist':
                continue
            expected = 'left out without --terrain or a scene'
            raise LavaError(f'--{name.replace("_", "-")}', value, expected)
        terrain = demo_terrain()
        data['vents'] = [
            {'position': (x, y), 'discharge': discharge, 'radius': 20.0, 'name': f'vent {index}'}
            for index, (x, y, discharge) in enumerate(DEMO_VENTS)
        ]
    elif not getattr(args, 'no_vents', False):
        data['vents'] = [_usual_vent(terrain, position=_summit(terrain), name='summit')]
    data['insist'] = data.get('insist', False) or bool(args.insist)
    changes, terrain = with_changes(_changes_of(args), Path(), terrain, given, prefix='')
    for name, items in changes.items():
        data[name] = [*data.get(name, []), *items]
    data['events'] = sorted(data.get('events', []), key=lambda event: event.time)
    vents = vents_as_given(args, terrain)
    rates, origin = _rates_of(args)
    if vents and rates:
        # the rates of a table are divided among the vents as in a case
        series = series_of(tuple(vents), rates)
        vents = [
            replace(vent, discharge=own) for vent, own in zip(vents, series, strict=True)
        ]
    for vent in () if rates else vents:
        is_own = args.discharge is None and vent.discharge is not None
        if not is_own and not math.isclose(vent.share, vent.part):
            expected = 'none without a table that vents divide: --effusion-rate FILE'
            raise LavaError(f'share of {vent.name!r}', vent.share / vent.part, expected)
    if vents:
        data['vents'] = [_described(vent, terrain) for vent in vents]
    if args.material is not None:
        data['lava'] = {'material': args.material}
    if vents or args.discharge is not None:
        # the error in a table of the scene is that of the rates that are replaced
        data['rate_error'] = error_of_rates(rates, args.measured)
    data |= _onset_of(args, data, origin)
    scene = scene_from_dict(data, terrain)
    if args.discharge is not None and not vents:
        if not scene.vents:
            raise validation.dependence('--effusion-rate', 'a vent in the scene, or --vent')
        rate = args.discharge
        if rates:
            rate = [(time, q / len(scene.vents)) for time, q in series_of_rates(rates)]
        changed = (replace(vent, discharge=rate) for vent in scene.vents)
        scene = replace(scene, vents=tuple(changed))
        report(doubts_of_scene(scene), insist=data['insist'])
    _log_scene(scene)
    return scene


def _changes_of(args: argparse.Namespace) -> dict[str, Any]:
    changes: dict[str, Any] = {}
    shared = {'thickness': args.emplaced_thickness, 'as': args.emplaced_as}
    shared = {name: value for name, value in shared.items() if value is not None}
    if args.emplaced_flow:
        changes['emplaced_flows'] = [{'file': file, **shared} for file in args.emplaced_flow]
    for name in shared:
        if not args.emplaced_flow:
            raise validation.dependence(f'--emplaced-{name}', '--emplaced-flow')
    if args.terrain_at:
        changes['events'] = [
            {'time': seconds_of('--terrain-at', time, may_be_zero=True), 'terrain': file}
            for time, file in args.terrain_at
        ]
    return changes


def _onset_of(
    args: argparse.Namespace, data: Mapping[str, Any], table: datetime | None
) -> dict[str, str]:
    """Return the onset of a scene: of its table of rates, of the option, or of its file.

    Raises:
        LavaError: If the option is not a date, or is not that of the rates of the file.
    """
    given, field = Options(start=args.eruption_start).origin, '--start'
    if given is not None and table is None:
        # the reader of a table checks the date
        check_date(field, given)
    known = table or given
    if known is None:
        return {}
    has_own = any(
        isinstance(vent.get('effusion_rate', vent.get('discharge')), list | tuple)
        for vent in data.get('vents', ()) if isinstance(vent, Mapping)
    )
    own = onset_from('scene', data)
    is_replaced = args.discharge is not None or args.vent or args.vents
    if own not in (None, known) and has_own and not is_replaced:
        assert own is not None
        expected = f'{date_text(own)}, the time 0 of the effusion rates of {args.scene}'
        raise LavaError(field, args.eruption_start, expected)
    return {'onset': date_text(known)}


def _rates_of(args: argparse.Namespace) -> RateTable:
    given = {name: getattr(args, name) for name in RATE_OPTIONS if getattr(args, name) is not None}
    if isinstance(args.discharge, str):
        if not Path(args.discharge).exists() and args.discharge[:1] in '+-0123456789':
            validation.number('--effusion-rate', args.discharge, unit='m3/s')
        given['start'] = given.pop('eruption_start', None)
        table = read_effusion_rates('--effusion-rate', args.discharge, Options(**given))
        check_start('--effusion-rate', table.intervals)
        return table
    for name in given:
        # a constant rate has a start, too
        if name != 'eruption_start':
            option = f'--{name.replace("_", "-")}'
            raise validation.dependence(option, 'a table of effusion rates (--effusion-rate FILE)')
    return RateTable(())


def place_as_typed(
    option: str, text: str, terrain: Terrain, *, on_terrain: bool = False
) -> tuple[float, float]:
    """Return easting and northing of a place, given as such or as longitude and latitude.

    Raises:
        LavaError: If the text is not a place, or with ``on_terrain`` is off the terrain.
    """
    x, y = _coordinates(option, text)
    is_geographic = in_degrees(terrain, (x, y))
    place = projected(terrain, x, y) if is_geographic else (x, y)
    if on_terrain and not terrain.covers(*terrain.to_map(*place)):
        expected = f'a place {terrain.bounds(projected=True)}'
        if is_geographic:
            expected += '; this is easting {:.0f}, northing {:.0f}'.format(*place)
        expected += likely_place(terrain, x, y)
        raise LavaError(option, text.strip(), expected)
    return place


def _coordinates(option: str, text: str) -> tuple[float, float]:
    """Return the two numbers of a place; degrees with hemispheres may be in either order."""
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
    expected = 'longitude,latitude [degrees] or easting,northing [m]'
    parts = text.split(',')
    if len(parts) == 4 and all(part.strip(' +-').isdecimal() for part in parts):
        expected += ', with decimal points: {}.{},{}.{}'.format(*map(str.strip, parts))
    raise LavaError(option, text.strip(), expected)


def log_resolution(
    scene: Scene, accuracy: Accuracy, forced: Mapping[str, bool], horizon: float,
    threshold: float | None = None,
) -> None:
    """Log warnings about the expected flow up to a horizon [s].

    ``forced`` are the effects that a user has switched on or off, by name, and ``threshold`` the
    least thickness of lava that counts [m], if the user has given it.
    """
    for text in resolution_of(scene, accuracy, forced, horizon=horizon).warnings(threshold):
        _LOG.warning(text)


def _log_scene(scene: Scene) -> None:
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
    ground = np.where(terrain.has_data, terrain.elevation, -np.inf)
    rows, columns = terrain.shape
    inner = np.full_like(ground, -np.inf)
    here = np.s_[rows // 8 : rows - rows // 8, columns // 8 : columns - columns // 8]
    inner[here] = ground[here]
    highest = np.argmax(inner if np.isfinite(inner).any() else ground)
    row, column = np.unravel_index(int(highest), terrain.shape)
    x, y = terrain.origin
    return (x + (column + 0.5) * terrain.resolution, y + (row + 0.5) * terrain.resolution)
