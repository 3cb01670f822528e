# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The run that the arguments of `lava run` ask for."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from lava_ros import validation
from lava_ros.cli.options import device_named, forced_effects, seconds_of
from lava_ros.cli.planned import planned, target_of
from lava_ros.cli.scenes import log_resolution, sourced_scene
from lava_ros.errors import LavaError
from lava_ros.runs.scene_run import Request
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import effects_for

if TYPE_CHECKING:
    from lava_ros.scene import Scene

#: Maximum number of maps.
MAX_MAPS = 10_000


def request_of(args: argparse.Namespace) -> Request:
    """Return the run of the arguments, and log warnings about its scene.

    Raises:
        LavaError: If an argument or a file is not valid.
    """
    until, forced = seconds_of('--until', args.until), forced_effects(args)
    target = target_of(args)
    if args.threshold is not None:
        validation.number('--threshold', args.threshold, above=0.0, unit='m')
    device = device_named(args.device)
    sourced = sourced_scene(args)
    scene = sourced.scene

    def accuracy() -> tuple[str, Accuracy]:
        preset, spacing = args.preset, args.spacing
        if target:
            found = planned(scene, target, until, forced, device, method=args.method)
            preset, spacing = found.preset, found.spacing
        elif spacing is None and args.method == 'particles':
            spacing = _spacing_of(preset, scene, forced, until, device)
        chosen = replace(preset_accuracy(preset, spacing=spacing), method=args.method)
        if args.threshold is not None:
            chosen = replace(chosen, threshold=args.threshold)
        log_resolution(scene, chosen, forced, until, args.threshold)
        return preset, chosen

    return Request(
        scene,
        name=Path(args.scene or args.terrain or 'st_helens').stem,
        until=until,
        times=_map_times(args, until),
        settings={
            'method': args.method, 'preset': args.preset, 'spacing_m': args.spacing,
            'within_s': target.get('within'), 'error': target.get('error'),
            'threshold_m': args.threshold,
        },
        accuracy=accuracy,
        forced=forced,
        device=device,
        inputs=sourced.digests(),
        remarks=sourced.remarks,
        output=None if args.output is None else Path(args.output),
    )


def _spacing_of(
    preset: str, scene: Scene, forced: Mapping[str, bool], until: float, device: str
) -> float:
    """Return the spacing of a preset for a scene, from pilot runs [m]."""
    from lava_ros.forecast.preset_spacing import choose_spacing

    accuracy = resolved_accuracy(preset_accuracy(preset), scene, forced, horizon=until)
    choice = choose_spacing(
        scene, preset, accuracy, horizon=until, device=device,
        effects=effects_for(scene, forced, accuracy=accuracy, horizon=until),
    )
    print(choice.text())
    return choice.spacing


def _map_times(args: argparse.Namespace, until: float) -> list[float]:
    """Return the times of the maps [s], the last one at the end."""
    count = validation.whole('--maps', args.maps, at_least=1, at_most=MAX_MAPS)
    times = {until * number / count for number in range(1, count)} | {until}
    for text in args.at:
        time = seconds_of('--at', text)
        if time > until:
            raise LavaError('--at', text, f'a time at or before --until, {args.until}')
        times.add(time)
    return sorted(times)
