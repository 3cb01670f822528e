# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The options of `lava run`, checked and in SI units."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

from lava_ros import validation
from lava_ros.cli.options import forced_effects, HORIZON, seconds_of
from lava_ros.cli.planned import target_of
from lava_ros.cli.scene_options import is_case
from lava_ros.cli.scenes import settle_method, source_of
from lava_ros.errors import LavaError
from lava_ros.hindcast.run import Settings
from lava_ros.scene import Scene
from lava_ros.scene.source import SceneSource

#: Maximum number of maps.
MAX_MAPS = 10_000

#: Name of the folder of the demonstration.
DEMO = 'st_helens'


@dataclass(frozen=True)
class RunOptions:
    """Checked options of a run, in SI units.

    Attributes:
        source: Where the scene comes from.
        name: Name of the scene, for folders.
        is_case: True for the folder of a mapped eruption.
        until: Simulated time at which a run ends [s].
        maps: Number of maps, evenly spaced.
        at: Simulated times of further maps [s].
        places: Files of places.
        method: Carriers of the lava, or ``auto``.
        preset: Preset of the accuracy.
        spacing: Particle spacing [m]; None for that of the preset.
        target: Wall time or error to stay below (``planned.target_of``); empty for neither.
        forced: Effects forced on or off, by name; of a case with those that are off by default.
        threshold: Thickness at or above which lava has arrived [m]; None for the automatic one.
        device: Warp device; None for the first GPU, or the CPU without one.
        output: The folder; None for an unused one in ``runs/``.
        json: File of the result; ``-`` for stdout, None for none.
        barriers: File of barriers; None for none.
        built: Simulated time at which the barriers are built [s].
        members: Number of ensemble members; 0 for a single run.
        seed: Seed of the random numbers.
        susceptibility: Raster of the likelihood that the vent opens in a cell; None for none.
        observed: File of observed lava; None for none.
        observed_at: Its simulated time [s].
        posterior: Number of members near those that agree with it; None for none.
        workers: Number of processes; None for the default.
        scheduler: Address of a Dask scheduler; None for none.
        formats: Formats of files in addition to GeoTIFF; None for the default.
        runs: Number of runs of a mapped eruption.
        mobility_limit: Maximum of speed over slope [m/s]; None for the default.
    """

    source: SceneSource
    name: str
    is_case: bool
    until: float
    maps: int
    at: Sequence[float]
    places: Sequence[str]
    method: str
    preset: str
    spacing: float | None
    target: Mapping[str, float]
    forced: Mapping[str, bool]
    threshold: float | None
    device: str | None
    output: Path | None
    json: str | None
    barriers: str | None
    built: float
    members: int
    seed: int
    susceptibility: str | None
    observed: str | None
    observed_at: float | None
    posterior: int | None
    workers: int | None
    scheduler: str | None
    formats: Sequence[str] | None
    runs: int
    mobility_limit: float | None


def run_options(args: argparse.Namespace, preset: str) -> RunOptions:
    """Return the options in parsed arguments, with a preset unless one is given.

    Raises:
        LavaError: If an option is not valid, or needs another one.
    """
    until = seconds_of('--until', args.until or HORIZON)
    if args.threshold is not None:
        validation.number('--threshold', args.threshold, above=0.0, unit='m')
    if not args.barriers and args.barriers_at is not None:
        raise validation.dependence('--barriers-at', '--barriers')
    forced = forced_effects(args)
    if is_case(args):
        # every choice of the command, such as that of the method, is for the effects of the run
        forced = Settings(forced=forced).effects
    names = {item.name for item in fields(RunOptions)}
    unchanged = {name: value for name, value in vars(args).items() if name in names}
    return RunOptions(**unchanged | {
        'source': source_of(args),
        'name': Path(args.scene or args.terrain or DEMO).resolve().stem,
        'is_case': is_case(args),
        'until': until,
        'maps': validation.whole('--maps', args.maps, at_least=1, at_most=MAX_MAPS),
        'at': _times(args.at, until, args.until or HORIZON),
        'preset': args.preset or preset,
        'target': target_of(args),
        'forced': forced,
        'output': None if args.output is None else Path(args.output),
        'built': seconds_of('--barriers-at', args.barriers_at or '0', may_be_zero=True),
        'members': args.members or 0,
        'observed_at': _time_of_observation(args),
    })


def with_method(options: RunOptions, scene: Scene, horizon: float) -> RunOptions:
    """Return the options with the method and the device for a scene up to a horizon [s]."""
    method, device = settle_method(
        options.method, options.device, scene, horizon, options.forced, options.preset
    )
    return replace(options, method=method, device=device)


def _times(texts: Sequence[str], until: float, end: str) -> list[float]:
    """Return the times of maps [s], none after the end of the run."""
    times = []
    for text in texts:
        time = seconds_of('--at', text)
        if time > until:
            raise LavaError('--at', text, f'a time at or before --until, {end}')
        times.append(time)
    return times


def _time_of_observation(args: argparse.Namespace) -> float | None:
    """Return the simulated time of the observed lava [s], None without any."""
    if args.posterior is not None and args.observed is None:
        raise validation.dependence('--posterior', '--observed')
    if args.observed is None:
        if args.observed_at is not None:
            raise validation.dependence('--observed-at', '--observed')
        return None
    if args.observed_at is None:
        raise LavaError('--observed-at', None, 'the time of the observation: 6h, 90min')
    return seconds_of('--observed-at', args.observed_at)
