# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava forecast-demo`: a forecast before and after an outline is seen."""

import argparse
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import partial
import os
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

import numpy as np

from lava_ros import validation
from lava_ros.cli.options import argument, command
from lava_ros.cli.output import write_json
from lava_ros.cli.ros import Child, ChildError, domain_of, require_ros, running_node
from lava_ros.files import file_to_write, PICTURES
from lava_ros.forecast.picture import draw_narrowing
from lava_ros.forecast.scores import brier_score, entropy
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.terrain_files import demo_terrain
from lava_ros.scene.uncertainty import Displacement, Distribution, Uncertainty
from lava_ros.simulation import Simulation
from lava_ros.simulation.presets import preset_accuracy

if TYPE_CHECKING:
    from lava_ros.ros.monitor import ForecastWatch, HeardGrid

#: How far forecasts look [s], and simulated seconds in a second.
HORIZON, SPEED = 3600.0, 40.0

#: Simulated time at which the outline of the lava is observed [s].
SEEN_AT = 1200.0

#: Distance between particles [m].
SPACING = 20.0

#: A vent in the crater of Mount St. Helens, as the observatory first takes it to be.
VENT = Vent((4050.0, 3300.0), 60.0, radius=40.0, name='crater')
LAVA = Lava(viscosity=2e4)

#: The uncertainty that it assumes.
UNCERTAINTY = Uncertainty(
    discharge=Distribution('lognormal', (1.0, 1.8)),
    viscosity=Distribution('loguniform', (0.4, 2.5)),
    position=Displacement(radius=60.0),
)

#: Factors of the real flow, which it does not know: more lava, of lower viscosity.
TRUE_DISCHARGE, TRUE_VISCOSITY = 1.7, 0.6

#: Longest wait for anything [s].
PATIENCE = 300.0

#: Probabilities [%] between which a cell is undecided.
UNDECIDED = (5, 95)


@command(
    argument('--members', 'N', 'number of members of an ensemble', 16),
    argument(
        '--picture', 'FILE', 'picture to write of the probabilities before and after',
        'forecast.png',
    ),
    argument('--speed', 'X', 'run X times as fast as real time', SPEED),
    '--device', '--domain', '--json',
)
def forecast_demo(args: argparse.Namespace) -> int:
    """Open a vent, live in ROS 2, and narrow the forecast with an observed outline.

    The command starts a node that computes forecasts and ensembles, opens a vent over DDS, and
    prints how long the first forecast takes. It then sends the node the outline of a flow whose
    effusion rate and viscosity the node does not know, and draws the probabilities before and
    after it.
    """
    require_ros()
    members = validation.whole('--members', args.members, at_least=2, at_most=10_000)
    speed = validation.number('--speed', args.speed, at_least=1.0, at_most=200.0)
    domain = domain_of(args.domain)
    # for this process and for the node
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    file_to_write('--picture', args.picture, PICTURES)
    scene = Scene(demo_terrain(), (VENT,), LAVA, uncertainty=UNCERTAINTY)
    truth = _Truth(scene, args.device)
    try:
        result, maps = _narrowed(scene, truth, members, speed, args.device, domain)
    except ChildError as error:
        print(f'lava forecast-demo: {error}')
        return 1
    draw_narrowing(scene, maps, seen=truth.seen, came=truth.came, output=Path(args.picture))
    result['picture'] = args.picture
    write_json(result, args.json)
    _print(result)
    return 0


class _Truth:
    """The real flow, which the node does not know.

    Attributes:
        seen: Where its lava is at ``SEEN_AT``, bool, shape [rows, columns].
        came: Where its lava has come up to the end, bool, same shape.
    """

    def __init__(self, scene: Scene, device: str | None) -> None:
        vent = replace(VENT, discharge=TRUE_DISCHARGE * VENT.peak)
        lava = replace(scene.lava, viscosity=TRUE_VISCOSITY * scene.lava.viscosity)
        accuracy = preset_accuracy('draft', spacing=SPACING)
        # it compiles the node's kernels, so that nobody waits for them later
        self._simulation = Simulation(
            replace(scene, vents=(vent,), lava=lava), accuracy=accuracy, device=device
        )
        self.came = self.seen = self._reached(SEEN_AT)

    def run_to(self, end: float) -> None:
        """Simulate up to a time [s]."""
        self.came = self._reached(end)

    def _reached(self, time: float) -> np.ndarray:
        self._simulation.advance(time)
        return self._simulation.snapshot().inundated


def _narrowed(
    scene: Scene, truth: _Truth, members: int, speed: float, device: str | None, domain: int
) -> tuple[dict[str, Any], list[tuple[str, np.ndarray]]]:
    """Run a node from the vent to the second map of probabilities.

    Returns:
        The figures, and titles and maps of probability before and after the outline.

    Raises:
        ChildError: The node failed, or took too long.
    """
    from lava_ros.ros.monitor import ForecastWatch

    settings = {
        'device': device or '',
        'preset': 'draft',
        'spacing': SPACING,
        'time_scale': speed,
        'forecast_horizon': HORIZON / 3600.0,
        # a busy machine takes its time
        'forecast_max_age': 4.0 * HORIZON,
        'ensemble_members': members,
    }
    with (
        closing(ForecastWatch(domain)) as watch,
        running_node(replace(scene, vents=()), settings, domain) as node,
    ):
        wait = partial(_wait, watch, node)
        wait('to hear it', lambda: watch.is_heard)
        # by then the process of the forecasts has started
        wait('for a first map', lambda: watch.arrivals)
        opened = watch.open_vents(scene.vents, scene.terrain)
        print('a vent opens', flush=True)
        arrival = wait('for a forecast', lambda: _with_lava(watch.arrivals, opened))
        _tell(arrival.heard - opened, 'a forecast of when lava comes')
        first = wait('for a forecast', lambda: _with_lava(watch.probabilities, opened))
        _tell(first.heard - opened, 'a first map of how likely')
        wait('for all members', lambda: _is_complete(watch, members))
        complete = time.monotonic()
        _tell(complete - opened, f'all {members} members')

        def now() -> float:
            return float(watch.values('simulation').get('simulated_time_s', 0.0))

        wait('for the flow', lambda: now() > SEEN_AT)
        # ROS time of the simulated time that has just passed
        late = round(1e9 * (now() - SEEN_AT) / speed)
        stamp_ns = int(watch.values('simulation')['stamp_ns']) - late
        before, status = watch.probabilities[-1], watch.values('ensemble')
        shown = watch.show_outline(truth.seen, scene.terrain, stamp_ns)
        _tell(shown - opened, 'an outline is seen')
        wait(
            'to weigh the members',
            lambda: watch.values('ensemble').get('outlines') == '1'
            and watch.probabilities[-1].heard > shown,
        )
        after = next(
            (item for item in watch.probabilities if item.heard > shown
             and item.stamp_ns == before.stamp_ns),
            watch.probabilities[-1],
        )
        _tell(after.heard - opened, 'the probabilities are narrower')
        weighed = watch.values('ensemble')
        truth.run_to(float(status['start_time_s']) + HORIZON)
        result = {
            'forecast_after_s': round(arrival.heard - opened, 2),
            'probability_after_s': round(first.heard - opened, 2),
            'all_members_after_s': round(complete - opened, 2),
            'narrower_after_s': round(after.heard - shown, 2),
            'is_same_ensemble': after.stamp_ns == before.stamp_ns,
            'members': members,
            'members_effective': float(weighed['members_effective']),
            'horizon_s': HORIZON,
            'seen_at_s': SEEN_AT,
            'device': watch.values('simulation').get('device', ''),
            'before': _scores(before.cells, before.cells, truth.came, scene.terrain),
            'after': _scores(after.cells, before.cells, truth.came, scene.terrain),
        }
    return result, [
        (f'{members} members', _probability(before.cells)),
        (f'after an outline at {SEEN_AT / 60.0:g} min', _probability(after.cells)),
    ]


def _tell(seconds: float, what: str) -> None:
    print(f'{seconds:6.1f} s  {what}', flush=True)


def _wait(watch: 'ForecastWatch', node: Child, what: str, found: Callable[[], Any]) -> Any:
    """Listen until something is found, and return it."""
    end = time.monotonic() + PATIENCE
    while not (result := found()):
        node.check()
        watch.listen(0.1)
        for task in ('simulation', 'inputs', 'forecast', 'ensemble'):
            said = watch.values(task)
            if said['error']:
                raise ChildError(node.failure(f'reports: {task}: {said["message"]}'))
        if time.monotonic() > end:
            raise ChildError(node.failure(f'took more than {PATIENCE:g} s {what}'))
    return result


def _with_lava(grids: list['HeardGrid'], since: float) -> 'HeardGrid | None':
    """The first grid with lava that came since a time [s]."""
    return next((item for item in grids if item.heard > since and item.cells.max() > 0), None)


def _is_complete(watch: 'ForecastWatch', members: int) -> bool:
    if not watch.probabilities:
        return False
    said, newest = watch.values('ensemble'), watch.probabilities[-1]
    is_shown = newest.cells.max() > 0 and said.get('frame_stamp_ns') == str(newest.stamp_ns)
    return is_shown and said.get('members') == str(members)


def _probability(cells: np.ndarray) -> np.ndarray:
    return np.where(cells < 0, np.nan, cells.astype(np.float64))


def _scores(
    cells: np.ndarray, before: np.ndarray, came: np.ndarray, terrain: Terrain
) -> dict[str, float]:
    """How undecided a map is, over the cells that had any lava before, and how right it was."""
    probability = _probability(cells) / 100.0
    here = before > 0
    low, high = UNDECIDED
    undecided = (cells > low) & (cells < high)
    return {
        'mean_entropy_bits': float(np.nanmean(entropy(probability[here]))),
        'undecided_m2': float(undecided.sum()) * terrain.resolution**2,
        'brier_score': brier_score(probability[here | came], came[here | came]),
    }


def _print(result: dict[str, Any]) -> None:
    before, after = result['before'], result['after']
    low, high = UNDECIDED
    for name, key, scale, unit in (
        ('mean entropy', 'mean_entropy_bits', 1.0, 'bit a cell'),
        (f'between {low} and {high} %', 'undecided_m2', 1e-6, 'km2'),
        ('Brier score against what came', 'brier_score', 1.0, ''),
    ):
        print(f'{name:>30}: {scale * before[key]:.3f} -> {scale * after[key]:.3f} {unit}')
    effective = result['members_effective']
    print(f'{"members":>30}: {result["members"]}, effective number {effective:.1f}')
    print(f'written to {result["picture"]}')
