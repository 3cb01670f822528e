# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Narrow a forecast of the node with an outline that is observed.

    python3 examples/narrow_forecast.py --json forecast.json

The script starts the node without a vent, opens a vent in the crater of Mount St. Helens over DDS,
and prints how long the first forecast and all members of the ensemble take. Then it sends the node
the outline of a flow whose effusion rate and viscosity the node is not given, and draws the
probabilities before and after the outline.
"""

import argparse
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
import os
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

import numpy as np

from lava_ros import validation
from lava_ros.cli.console import write_json
from lava_ros.cli.ros import Child, ChildError, domain_of, require_ros, running_node
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write, PICTURES
from lava_ros.forecast.scores import brier_score, entropy
from lava_ros.layers.frame import frame_of
from lava_ros.products.sheet import draw_sheet, Panel
from lava_ros.runs.drive import drive
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.distributions import Displacement, Distribution
from lava_ros.scene.terrain_files import demo_terrain
from lava_ros.scene.uncertainty import Uncertainty
from lava_ros.simulation import Simulation
from lava_ros.simulation.presets import preset_accuracy

if TYPE_CHECKING:
    from forecast_watch import ForecastWatch, ReceivedGrid

#: Horizon of the forecasts [s], and simulated time per wall time [s/s].
HORIZON, SPEED = 3600.0, 40.0

#: Simulated time at which the outline of the lava is observed [s].
SEEN_AT = 1200.0

#: Distance between particles [m].
SPACING = 20.0

#: A vent in the crater of Mount St. Helens with the properties that the observatory assumes.
VENT = Vent((4050.0, 3300.0), 60.0, radius=40.0, name='crater')
LAVA = Lava.paper(viscosity=2e4)

#: The uncertainty that the observatory assumes.
UNCERTAINTY = Uncertainty(
    discharge=Distribution('lognormal', (1.0, 1.8)),
    viscosity=Distribution('loguniform', (0.4, 2.5)),
    position=Displacement(radius=60.0),
)

#: Factors of the real flow, unknown to the observatory: more lava, of lower viscosity.
TRUE_DISCHARGE, TRUE_VISCOSITY = 1.7, 0.6

#: Maximum wait for each step of the demo [s].
PATIENCE = 300.0

#: Probabilities [%] between which a cell is undecided.
UNDECIDED = (5, 95)


def main() -> int:
    """Open a vent in a ROS domain, narrow the node's forecast, and return the exit status."""
    parser = argparse.ArgumentParser(description='Narrow a forecast with an observed outline.')
    parser.add_argument('--members', type=int, default=16, help='members of an ensemble')
    parser.add_argument('--max-speed', type=float, default=SPEED, help='times real time')
    parser.add_argument('--picture', default='forecast.png', help='probabilities before and after')
    parser.add_argument('--device', help='computing device: cpu, cuda:0, ...')
    parser.add_argument('--domain', type=int, help='ROS domain ID (default: a free one)')
    parser.add_argument('--json', help='file for the figures')
    args = parser.parse_args()
    try:
        return narrow_forecast(args)
    except LavaError as error:
        parser.error(str(error))
    except ChildError as error:
        print(f'{parser.prog}: {error}', file=sys.stderr)
        return 1


def narrow_forecast(args: argparse.Namespace) -> int:
    """Narrow the node's forecast with an observed outline, and return the exit status.

    Raises:
        LavaError: If an argument is out of range, or the picture cannot be written.
        ChildError: If the node fails, or takes too long.
    """
    require_ros()
    members = validation.whole('--members', args.members, at_least=2, at_most=10_000)
    speed = validation.number('--max-speed', args.max_speed, at_least=1.0, at_most=200.0)
    file_to_write('--picture', args.picture, PICTURES)
    if args.json is not None:
        file_to_write('--json', args.json, ('.json',))
    domain = domain_of(args.domain)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    scene = Scene(demo_terrain(), (VENT,), LAVA, uncertainty=UNCERTAINTY)
    vent = replace(VENT, discharge=TRUE_DISCHARGE * VENT.peak)
    lava = replace(LAVA, viscosity=TRUE_VISCOSITY * LAVA.viscosity)
    # the real flow; it also compiles the node's kernels, which are then in the cache
    truth = Simulation(
        replace(scene, vents=(vent,), lava=lava),
        accuracy=preset_accuracy('draft', spacing=SPACING), device=args.device,
    )
    seen = _reached(truth, SEEN_AT)
    result, maps, came = _narrowed(scene, truth, seen, members, speed, domain)
    _draw(scene, maps, seen=seen, came=came, output=Path(args.picture))
    result['picture'] = args.picture
    write_json(result, args.json)
    _print(result)
    return 0


def _reached(simulation: Simulation, time: float) -> np.ndarray:
    """Return the footprint of the lava at a time [s], bool, shape [rows, columns]."""
    drive(simulation, time)
    return simulation.snapshot().footprint


def _narrowed(
    scene: Scene, truth: Simulation, seen: np.ndarray, members: int, speed: float, domain: int
) -> tuple[dict[str, Any], list[tuple[str, np.ndarray]], np.ndarray]:
    """Run a node from the vent to the second map of probabilities.

    Returns:
        The figures, titles and maps of probability before and after the outline, and the cells
        that the real flow ``truth`` inundates up to the horizon.

    Raises:
        ChildError: If the node fails, or takes too long.
    """
    from forecast_watch import ForecastWatch

    settings = {
        'device': truth.device,
        'preset': 'draft',
        'spacing': SPACING,
        'time_scale': speed,
        'forecast_horizon': HORIZON / 3600.0,
        # valid for long enough on a busy machine
        'forecast_max_age': 4.0 * HORIZON,
        'ensemble_members': members,
    }
    with (
        closing(ForecastWatch(domain)) as watch,
        running_node(replace(scene, vents=()), settings, domain) as node,
    ):
        wait = partial(_wait, watch, node)
        wait('to subscribe', lambda: watch.has_subscribers)
        # the first map shows that the process of the forecasts has started
        wait('for a first map', lambda: watch.arrivals)
        opened = watch.open_vents(scene.vents, scene.terrain)
        print('a vent opens', flush=True)
        arrival = wait('for a forecast', lambda: _with_lava(watch.arrivals, opened))
        _print_progress(arrival.received - opened, 'a forecast of the arrival time')
        first = wait('for a forecast', lambda: _with_lava(watch.probabilities, opened))
        _print_progress(first.received - opened, 'a first map of the probability')
        wait('for all members', lambda: _is_complete(watch, members))
        complete = time.monotonic()
        _print_progress(complete - opened, f'all {members} members')

        def now() -> float:
            return float(watch.values('simulation').get('simulated_time_s', 0.0))

        wait('for the flow', lambda: now() > SEEN_AT)
        before, status = watch.probabilities[-1], watch.values('ensemble')
        shown = watch.show_outline(seen, scene.terrain, watch.stamp_at(SEEN_AT))
        _print_progress(shown - opened, 'an outline is observed')
        wait(
            'to weigh the members',
            lambda: watch.values('ensemble').get('outlines') == '1'
            and watch.probabilities[-1].received > shown,
        )
        after = next(
            (item for item in watch.probabilities if item.received > shown
             and item.stamp_ns == before.stamp_ns),
            watch.probabilities[-1],
        )
        _print_progress(after.received - opened, 'a forecast with this outline')
        weighed = watch.values('ensemble')
        came = _reached(truth, float(status['start_time_s']) + HORIZON)
        result = {
            'forecast_after_s': round(arrival.received - opened, 2),
            'probability_after_s': round(first.received - opened, 2),
            'all_members_after_s': round(complete - opened, 2),
            'narrower_after_s': round(after.received - shown, 2),
            'is_same_ensemble': after.stamp_ns == before.stamp_ns,
            'members': members,
            'members_effective': float(weighed['members_left_by_outline']),
            'horizon_s': HORIZON,
            'seen_at_s': SEEN_AT,
            'device': watch.values('simulation').get('device', ''),
            'before': _scores(before.cells, before.cells, came, scene.terrain),
            'after': _scores(after.cells, before.cells, came, scene.terrain),
        }
    return result, [
        (f'{members} members', _probability(before.cells)),
        (f'after an outline at {SEEN_AT / 60.0:g} min', _probability(after.cells)),
    ], came


def _print_progress(seconds: float, what: str) -> None:
    print(f'{seconds:6.1f} s  {what}', flush=True)


def _wait(watch: 'ForecastWatch', node: Child, what: str, found: Callable[[], Any]) -> Any:
    """Receive messages until ``found`` returns something, and return it."""
    end = time.monotonic() + PATIENCE
    while not (result := found()):
        node.check()
        watch.listen(0.1)
        for task in ('simulation', 'inputs', 'forecast', 'ensemble'):
            status = watch.values(task)
            if status['error']:
                raise ChildError(node.failure(f'reports: {task}: {status["message"]}'))
        if time.monotonic() > end:
            raise ChildError(node.failure(f'took more than {PATIENCE:g} s {what}'))
    return result


def _with_lava(grids: list['ReceivedGrid'], since: float) -> 'ReceivedGrid | None':
    return next((item for item in grids if item.received > since and item.cells.max() > 0), None)


def _is_complete(watch: 'ForecastWatch', members: int) -> bool:
    if not watch.probabilities:
        return False
    status, newest = watch.values('ensemble'), watch.probabilities[-1]
    is_shown = newest.cells.max() > 0 and status.get('frame_stamp_ns') == str(newest.stamp_ns)
    return is_shown and status.get('members') == str(members)


def _probability(cells: np.ndarray) -> np.ndarray:
    return np.where(cells < 0, np.nan, cells.astype(np.float64))


def _scores(
    cells: np.ndarray, before: np.ndarray, came: np.ndarray, terrain: Terrain
) -> dict[str, float]:
    """Return measures of uncertainty and error of a map, for cells with lava in ``before``."""
    probability = _probability(cells) / 100.0
    here = before > 0
    low, high = UNDECIDED
    undecided = (cells > low) & (cells < high)
    return {
        'mean_entropy_bits': float(np.nanmean(entropy(probability[here]))),
        'undecided_m2': float(undecided.sum()) * terrain.resolution**2,
        'brier_score': brier_score(probability[here | came], came[here | came]),
    }


def _draw(
    scene: Scene,
    maps: Sequence[tuple[str, np.ndarray]],
    *,
    seen: np.ndarray,
    came: np.ndarray,
    output: Path,
) -> None:
    """Draw maps of probability (titles, and 0 to 100) with the observed and the final outline."""
    frame, outlines = frame_of(scene), {'observed outline': seen, 'final outline': came}
    panels = [
        Panel(frame, 'probability', np.where(values > 0.0, values, np.nan), title,
              outlines=outlines)
        for title, values in maps
    ]
    draw_sheet(panels, output, title='Inundation probability before and after an outline')


def _print(result: dict[str, Any]) -> None:
    before, after = result['before'], result['after']
    low, high = UNDECIDED
    for name, key, scale, unit in (
        ('mean entropy', 'mean_entropy_bits', 1.0, 'bit a cell'),
        (f'between {low} and {high} %', 'undecided_m2', 1e-6, 'km2'),
        ('Brier score', 'brier_score', 1.0, ''),
    ):
        print(f'{name:>30}: {scale * before[key]:.3f} -> {scale * after[key]:.3f} {unit}')
    effective = result['members_effective']
    print(f'{"members":>30}: {result["members"]}, effective number {effective:.1f}')
    print(f'written to {result["picture"]}')


if __name__ == '__main__':
    sys.exit(main())
