# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scenes from the arguments of a command."""

import argparse
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
import logging
import math
from typing import Any, TYPE_CHECKING

import numpy as np

from lava_ros import validation
from lava_ros.cli.options import Argument, seconds_of
from lava_ros.cli.scene_options import is_case, refuse_for_case
from lava_ros.errors import LavaError, Typed
from lava_ros.layers.numbers import duration
from lava_ros.scene import KELVIN, Scene
from lava_ros.scene.reshaping import finer
from lava_ros.scene.source import SceneSource, SourcedScene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.method import settled_method
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolution_of

if TYPE_CHECKING:
    from lava_ros.hindcast.case import Case

_LOG = logging.getLogger(__name__)

#: Maximum side of a cell over the particle spacing, and maximum number of cells after a division.
CELL, MAX_CELLS = 3.0, 1_000_000

#: Fields of a source whose arguments have another name.
_ARGUMENTS = {'path': 'scene', 'effusion_rate': 'discharge', 'start': 'eruption_start'}

#: Names of the fields of a source on the command line.
WORDS = {
    item.name: f'--{item.name.replace("_", "-")}' for item in fields(SceneSource)
} | {'path': 'scene', 'events': '--terrain-at', 'emplaced_flows': '--emplaced-flow'}


def source_of(args: argparse.Namespace) -> SceneSource:
    """Return the source of the scene that the arguments describe.

    Raises:
        LavaError: If an argument has no effect without another one.
    """
    known = {
        item.name: getattr(args, _ARGUMENTS.get(item.name, item.name), None)
        for item in fields(SceneSource)
    }
    given: dict[str, Any] = {
        name: value for name, value in known.items() if value is not None and value is not False
    }
    if isinstance(given.get('from_outline'), str):
        # a time in s, or a date
        with suppress(ValueError):
            text = given['from_outline']
            given['from_outline'] = Typed(float(text), text)
    shared = {
        'thickness': args.emplaced_thickness, 'volume': args.emplaced_volume,
        'solidified': args.emplaced_solidified, 'as': args.emplaced_as,
    }
    shared = {name: value for name, value in shared.items() if value is not None}
    if args.emplaced_flow:
        given['emplaced_flows'] = [{'file': file, **shared} for file in args.emplaced_flow]
    for name in shared:
        if not args.emplaced_flow:
            raise validation.dependence(f'--emplaced-{name}', '--emplaced-flow')
    given['events'] = [
        {'time': seconds_of('--terrain-at', time, may_be_zero=True), 'terrain': file}
        for time, file in args.terrain_at or ()
    ]
    given['has_vents'] = not getattr(args, 'no_vents', False)
    return SceneSource(**given, words=WORDS)


def sourced_scene(source: SceneSource, *, as_given: bool = False) -> SourcedScene:
    """Make the scene of a source, and log its vents.

    Its cells are at most ``CELL`` times the particle spacing, or those of its terrain with
    ``as_given``.

    Raises:
        LavaError: If a file is not valid.
    """
    found = source.load()
    scene = found.scene
    _log_vents(scene)
    if as_given:
        return found
    spacing = resolution_of(scene, preset_accuracy(DEFAULT)).spacing
    factor = math.ceil(scene.terrain.resolution / (CELL * spacing))
    most = math.isqrt(MAX_CELLS // scene.terrain.elevation.size)
    fine = scene.on(lambda terrain: finer(terrain, max(min(factor, most), 1)))
    return replace(found, scene=fine)


def sourced_case(source: SceneSource) -> 'Case':
    """Read the case of a source, which is a folder.

    Raises:
        LavaError: If a file is not valid, or the source has another table of effusion rates.
    """
    if isinstance(source.effusion_rate, str):
        expected = 'one number [m3/s]: the effusion rates of a case are those of its table'
        raise LavaError('--effusion-rate', source.effusion_rate, expected)
    # loads the solver
    from lava_ros.hindcast.case import load_case

    return load_case(source)


def case_from_arguments(args: argparse.Namespace, declared: Sequence[Argument]) -> 'Case | None':
    """Read the case of the arguments; None if they describe a scene.

    Args:
        args: The parsed arguments.
        declared: The arguments of the command.

    Raises:
        LavaError: If an option is given that a case replaces, or the case is not valid.
    """
    if not is_case(args):
        return None
    refuse_for_case(args, declared)
    return sourced_case(source_of(args))


def scene_from_arguments(args: argparse.Namespace, *, as_given: bool = False) -> Scene:
    """Make the scene of the arguments, as ``sourced_scene``."""
    return sourced_scene(source_of(args), as_given=as_given).scene


def settle_method(
    method: str, device: str | None, scene: Scene, horizon: float, forced: Mapping[str, bool],
    preset: str = DEFAULT,
) -> tuple[str, str | None]:
    """Return the method and the device for a scene up to a horizon [s].

    Method ``auto`` chooses by the scene. Without a device, cells run on a CPU.
    """
    choice = settled_method(method, scene, preset_accuracy(preset), forced, horizon=horizon)
    if choice.reason:
        print(choice.text())
    return choice.method, device or ('cpu' if choice.method == 'cells' else None)


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


def log_late(scene: Scene, until: float) -> list[str]:
    """Log and return warnings about what the scene has only after a run up to a time [s]."""
    end = f'after the end of the run, {duration(until)}'
    texts = [
        f'{event.text} at {duration(event.time)} comes {end}, and has no effect'
        for event in scene.events if event.time >= until
    ]
    texts += [
        f'the effusion of {vent.name or "a vent"} begins at {duration(opening)}, {end}'
        for vent in scene.vents
        if not vent.volume_between(0.0, until) and (opening := vent.next_opening(until)) < math.inf
    ]
    for text in texts:
        _LOG.warning(text)
    return texts


def _log_vents(scene: Scene) -> None:
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
