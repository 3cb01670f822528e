# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The run that the options of `lava run` ask for, and a run with progress."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
import sys

from lava_ros.cli.console import Progress
from lava_ros.cli.options import device_named
from lava_ros.cli.planned import planned
from lava_ros.cli.run_options import RunOptions, with_method
from lava_ros.cli.scenes import log_late, log_resolution, sourced_scene
from lava_ros.forecast.preset_spacing import choose_spacing
from lava_ros.runs.scene_run import Request, SceneRun
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import effects_for


def request_of(options: RunOptions) -> Request:
    """Return the run of the options, and log warnings about its scene.

    Raises:
        LavaError: If a file is not valid.
    """
    until, forced, target = options.until, options.forced, options.target
    sourced = sourced_scene(options.source)
    scene = sourced.scene
    options = with_method(options, scene, until)
    device = device_named(options.device, options.method)

    def accuracy() -> tuple[str, Accuracy]:
        preset, spacing = options.preset, options.spacing
        if target:
            found = planned(scene, target, until, forced, device, method=options.method)
            preset, spacing = found.preset, found.spacing
        elif spacing is None and options.method == 'particles':
            spacing = _spacing_of(preset, scene, forced, until, device)
        chosen = replace(preset_accuracy(preset, spacing=spacing), method=options.method)
        if options.threshold is not None:
            chosen = replace(chosen, threshold=options.threshold)
        log_resolution(scene, chosen, forced, until, options.threshold)
        return preset, chosen

    even = (until * number / options.maps for number in range(1, options.maps))
    return Request(
        scene,
        name=options.name,
        until=until,
        times=sorted({until, *even, *options.at}),
        settings={
            'method': options.method, 'preset': options.preset, 'spacing_m': options.spacing,
            'within_s': target.get('within'), 'error': target.get('error'),
            'threshold_m': options.threshold,
        },
        accuracy=accuracy,
        forced=forced,
        device=device,
        inputs=sourced.digests(),
        remarks=[*sourced.remarks, *log_late(scene, until)],
        output=options.output,
    )


@contextmanager
def simulated(request: Request) -> Iterator[SceneRun]:
    """Run to the end with progress, or resume; the block writes what is made of the maps.

    Raises:
        LavaError: If the run cannot start, continue or write its maps.
    """
    with SceneRun(request) as made:
        if made.is_resumed:
            print(f'continuing the interrupted run in {made.folder.path}', file=sys.stderr)
        try:
            with Progress() as progress:
                made.run(progress.sink(request.until))
            yield made
        except KeyboardInterrupt:
            print('lava run: interrupted; the same command continues', file=sys.stderr)
            raise


def _spacing_of(
    preset: str, scene: Scene, forced: Mapping[str, bool], until: float, device: str
) -> float:
    """Return the spacing of a preset for a scene, from pilot runs [m]."""
    accuracy = resolved_accuracy(preset_accuracy(preset), scene, forced, horizon=until)
    choice = choose_spacing(
        scene, preset, accuracy, horizon=until, device=device,
        effects=effects_for(scene, forced, accuracy=accuracy, horizon=until),
    )
    print(choice.text())
    return choice.spacing
