# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare plans of `lava plan` for scenes and times with their runs.

A row has the time that planning takes, the time of the run that is planned, and its numerical
error, as the plan states it and as the partner runs of the planned run measure it. The run has the
effects of the pilots. Times are CPU times, after all kernels are compiled:

    python docs/benchmarks/plan.py plan.csv

    python docs/benchmarks/plan.py plan_sampling.csv --sampling

writes the errors of the probabilities of small ensembles relative to a large one.
"""

import argparse
from dataclasses import dataclass
import math
from pathlib import Path
import shlex
import sys
import time

from bench_scenes import scenes
import numpy as np
from plan_scenes import held_out

from lava_ros.errors import LavaError
from lava_ros.forecast.members import make_plan, run_members
from lava_ros.forecast.partner_runs import measure_error
from lava_ros.forecast.pilot_runs import accuracy_at, run_at
from lava_ros.forecast.planning import plan_runs, sampling_error
from lava_ros.forecast.probability import footprint_by, footprint_of
from lava_ros.forecast.sampling import draw_members
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation.selection import effects_for
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Scenes, the available time [s], the fraction of their horizon, and the number of members.
CASES = (
    ('plain', 2.0, 1.0, 1),
    ('plain', 8.0, 1.0, 1),
    ('plain', 8.0, 1.0, 16),
    ('gentle_slope', 4.0, 1.0, 1),
    ('valley', 2.5, 1.0, 1),
    ('valley', 4.0, 1.0, 1),
    ('ridge', 2.0, 1.0, 1),
    ('ridge', 6.0, 1.0, 1),
    ('rough', 3.0, 1.0, 1),
    ('rough', 6.0, 1.0, 1),
    ('crater', 5.0, 1.0, 1),
    ('crater', 8.0, 1.0, 1),
    ('fast', 3.0, 1.0, 1),
    ('fast', 8.0, 1.0, 1),
    ('fast', 8.0, 1.0, 4),
    ('dome', 3.0, 1.0, 1),
    ('dome', 6.0, 1.0, 1),
    ('strong', 5.0, 1.0, 1),
    ('lobe', 8.0, 0.25, 1),
    ('fissure', 5.0, 1.0, 1),
    ('mountain', 4.0, 1.0, 1),
    ('mountain', 6.0, 1.0, 1),
)

#: Cases of held-out scenes, which were not used to choose constants of the method.
HELD_OUT = (
    ('terrace', 2.5, 1.0, 1),
    ('terrace', 6.0, 1.0, 1),
    ('cone', 4.0, 1.0, 1),
    ('cone', 8.0, 1.0, 4),
    ('saddle', 3.0, 1.0, 1),
    ('gullies', 5.0, 1.0, 1),
    ('thick', 5.0, 1.0, 1),
    ('thinning', 4.0, 1.0, 1),
    ('hills', 6.0, 1.0, 1),
    ('waning', 3.0, 1.0, 1),
    ('waning', 10.0, 1.0, 1),
    ('steep', 4.0, 1.0, 1),
    ('pond', 4.0, 1.0, 1),
    ('pond', 8.0, 0.5, 1),
)

#: Number of all members, sizes of their ensembles, and sizes that are also drawn as one ensemble.
MEMBERS, SIZES, BALANCED = 256, (8, 16, 32), (16,)


@dataclass(frozen=True)
class Row:
    """A plan and its run: a row of the CSV. Errors are those of the inundated area."""

    scene: str
    held_out: bool
    within_s: float
    members: int
    horizon_s: float
    preset: str
    spacing_m: float
    is_finest: bool
    pilots: int
    planning_s: float
    planning_of_time_percent: float
    planned_s: float
    taken_s: float
    taken_of_time_percent: float
    particles_planned_percent: float
    particles_measured_percent: float
    ground_planned_percent: float
    ground_measured_percent: float
    error_planned_percent: float
    error_measured_percent: float


def measure(name, within, fraction, members):
    """Plan, run and measure; return a row."""
    item = next(item for item in (*scenes(), *held_out()) if item.name == name)
    scene, horizon, clock = item.scene, fraction * item.horizon, time.process_time
    plan = plan_runs(
        scene, within=within, horizon=horizon, members=members, device='cpu', clock=clock
    )
    accuracy = accuracy_at(scene, 1.0, horizon)
    effects = effects_for(scene, accuracy=accuracy, horizon=horizon)
    run = run_at(scene, plan.refinement, horizon, device='cpu', effects=effects, clock=clock)
    found = measure_error(
        scene, run.areas, horizon, accuracy=accuracy_at(scene, plan.refinement, horizon),
        effects=effects, horizon=horizon, device='cpu',
    ).inundated
    planned, taken = plan.numerical_error.inundated, plan.members * run.wall_time
    return Row(
        scene=name,
        held_out=name in {other.name for other in held_out()},
        within_s=within,
        members=plan.members,
        horizon_s=horizon,
        preset=plan.preset,
        spacing_m=plan.spacing,
        is_finest=plan.is_finest,
        pilots=plan.pilots,
        planning_s=plan.spent,
        planning_of_time_percent=100.0 * plan.spent / within,
        planned_s=plan.wall_time,
        taken_s=taken,
        taken_of_time_percent=100.0 * taken / within,
        particles_planned_percent=100.0 * planned.particles,
        particles_measured_percent=100.0 * found.particles,
        ground_planned_percent=100.0 * planned.ground,
        ground_measured_percent=100.0 * found.ground,
        error_planned_percent=100.0 * planned.total,
        error_measured_percent=100.0 * found.total,
    )


def hill():
    """Return a slope with gentle valleys and a flow with uncertain quantities."""
    y, x = np.mgrid[0:40, 0:40] * 20.0
    return Scene(
        Terrain(1500.0 - 0.15 * y + 20.0 * np.sin(x / 150.0), 20.0),
        (Vent((400.0, 200.0), 20.0, radius=30.0),),
        Lava.paper(viscosity=1e4),
        uncertainty=uncertainty_from_dict({
            'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'viscosity': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'position': {'deviation': 40.0},
        }),
    )


def sampling():
    """Yield the errors of ensembles relative to all members, at probabilities of 40 to 60 %."""
    scene, horizon = hill(), 1200.0
    plan = make_plan(scene, horizon=horizon, accuracy=accuracy_at(scene, 0.3, horizon))

    def reached(members):
        fields = run_members(plan, members, device='cpu')
        return np.array([footprint_by(footprint_of(item, plan), plan, horizon) for item in fields])

    # different seeds: members of one seed are balanced, with smaller errors than random ones
    drawn = reached([draw_members(scene, 1, seed=seed)[0] for seed in range(MEMBERS)])
    balanced = {
        size: [reached(draw_members(scene, size, seed=seed)) for seed in range(MEMBERS // size)]
        for size in BALANCED
    }
    probability = drawn.mean(axis=0)
    near = (probability > 0.4) & (probability < 0.6)

    def error(parts):
        means = np.array([part.mean(axis=0) for part in parts])[:, near]
        return 100.0 * math.sqrt(means.var(axis=0, ddof=1).mean())

    for size in SIZES:
        rows = [
            ('foreseen', 100.0 * sampling_error(size)),
            ('found, independent members', error(np.split(drawn, MEMBERS // size))),
        ]
        if size in balanced:
            rows.append(('found, members of `lava run`', error(balanced[size])))
        for kind, value in rows:
            yield {
                'quantity': f'error of a probability, {kind}', 'members': size, 'value': value,
                'unit': '%',
            }


def plans(names):
    """Yield the rows of all plans, or of those of some scenes."""
    for case in (*CASES, *HELD_OUT):
        if names is None or case[0] in names:
            try:
                row = measure(*case)
            except LavaError as error:
                print(f'{case[0]}, {case[1]:g} s: {error}', file=sys.stderr)
                continue
            print(
                f'{row.scene:13} {row.within_s:5.3g} s: planning {row.planning_s:.2g} s, run '
                f'{row.taken_s:.2g} s of {row.planned_s:.2g} s planned', flush=True,
            )
            yield vars(row)


def main():
    """Measure, and write the rows so far after each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--scene', action='append', metavar='NAME', help='run only these scenes')
    parser.add_argument('--sampling', action='store_true', help='measure ensembles instead')
    args = parser.parse_args()
    origin = {
        'machine': machine_name('cpu'),
        'command': f'python docs/benchmarks/plan.py {shlex.join(sys.argv[1:])}',
    }
    rows = []
    for row in sampling() if args.sampling else plans(args.scene):
        rows.append({**row, **origin})
        write_csv(rows, args.output)


if __name__ == '__main__':
    main()
