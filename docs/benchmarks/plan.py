# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare plans of `lava plan` for scenes and times with their runs.

A plan is kept if its run takes 50 to 110 % of the available time, and if the predicted error is
half to twice the actual one. The error is that of the plan: of the cells that lava covers at the
horizon in the run or in the reference, the fraction covered in only one of them. The reference is
the majority of runs of the same scene with a ``FINER`` times finer spacing. Small displacements
decide where a flow divides: the error is the mean, and the time the median, of runs with vents
moved by centimetres. Members of an ensemble are such runs too, and their times are added.

Wall times are measured with each job on its own core, after all kernels are compiled and before
the first reference is run. Jobs disturb each other least if they use less than half of the cores.

The output is plan.csv, and plan_sampling.csv with the errors of the probabilities of small
ensembles relative to a large one:

    python docs/benchmarks/plan.py --device cpu --machine 'Intel Xeon, 1 core used of 40' --jobs 12
"""

import argparse
from concurrent.futures import as_completed, ProcessPoolExecutor
import csv
from dataclasses import dataclass, replace
import math
import multiprocessing
import os
from pathlib import Path
import statistics
import sys
import time

from bench_scenes import scenes
import numpy as np
from plan_scenes import held_out

from lava_ros.cli.console import write_json
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write
from lava_ros.forecast.members import make_plan, run_members
from lava_ros.forecast.pilot_runs import accuracy_at, run_at
from lava_ros.forecast.planning import plan_within, sampling_error
from lava_ros.forecast.probability import footprint_of, reached_by
from lava_ros.forecast.sampling import draw_members
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.verification.rows import as_plain, write_csv

FOLDER = Path(__file__).parent

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

#: Number of runs of a plan, and the distance between their vents [m].
RUNS, SHIFT = 3, 0.03

#: Refinement of the reference relative to the plan.
FINER = 4.0

#: Number of all members, sizes of their ensembles, and sizes that are also drawn as one ensemble.
MEMBERS, SIZES, BALANCED = 256, (8, 16, 32), (16,)


@dataclass(frozen=True)
class Row:
    """A plan and its result: a row of the CSV."""

    scene: str
    held_out: bool
    within_s: float
    members: int
    horizon_s: float
    preset: str
    spacing_m: float
    refinement: float
    forced: str
    pilots: int
    pilots_s: float
    foreseen_s: float
    taken_s: float
    taken_of_time_percent: float
    foreseen_error_percent: float
    error_percent: float
    error_deviation_percent: float
    foreseen_over_error: float
    sampling_error_percent: float
    time_kept: bool
    error_kept: bool
    runs: int
    reference_refinement: float
    reference_runs: int
    reference_device: str
    clock: str
    device: str
    machine: str
    command: str


def wrong(one, other):
    """Return the number of cells in only one set, divided by that of cells in either set."""
    return np.count_nonzero(one ^ other) / max(np.count_nonzero(one | other), 1)


def shifted(scene, distance):
    """Return the scene with all vents moved by a distance [m] along x and y."""

    def moved(place):
        return place and (place[0] + distance, place[1] + distance)

    vents = [
        replace(vent, position=moved(vent.position), end=moved(vent.end)) for vent in scene.vents
    ]
    return replace(scene, vents=tuple(vents))


def runs_of(scene, refinement, horizon, count, device, clock, forced=None, limit=math.inf):
    """Run a scene with its vents moved by centimetres, each run up to a wall time limit [s]."""
    return [
        run_at(
            shifted(scene, SHIFT * number), refinement, horizon,
            device=device, wall_limit=limit, effects=forced, clock=clock,
        )
        for number in range(count)
    ]


def scene_of(name):
    """Return a scene by its name."""
    return next(item for item in (*scenes(), *held_out()) if item.name == name)


def compile_for(name, options):
    """Compile all kernels of a scene, so that compilation does not disturb measurements."""
    scene = scene_of(name).scene
    for refinement in np.geomspace(0.2, 3.0, 8):
        for effects in (None, {'helmholtz': False}):
            run_at(
                scene, refinement, 0.01, device=options['device'], wall_limit=math.inf,
                effects=effects,
            )


def measure(name, within, fraction, members, options):
    """Plan and run; return a row without errors, and the covered cells of the runs."""
    item = scene_of(name)
    horizon = fraction * item.horizon
    clock = time.process_time if options['clock'] == 'process' else time.monotonic
    try:
        plan = plan_within(
            item.scene, within=within, horizon=horizon, members=members, device=options['device'],
            may_force=True, clock=clock,
        )
    except LavaError as error:
        return f'{name}, {within:g} s: {error}', []
    count = max(RUNS, members)
    runs = runs_of(
        item.scene, plan.refinement, horizon, count, options['device'], clock, plan.forced
    )
    times = [run.wall_time for run in runs]
    taken = statistics.median(times) if members == 1 else sum(times)
    # the finest plan may need less than the available time
    least = 0.0 if plan.is_finest else 1.0
    row = Row(
        scene=name,
        held_out=name in {other.name for other in held_out()},
        within_s=within,
        members=plan.members,
        horizon_s=horizon,
        preset=plan.preset,
        spacing_m=plan.spacing,
        refinement=plan.refinement,
        forced=' '.join(f'{name}={"on" if on else "off"}' for name, on in plan.forced.items()),
        pilots=plan.pilots,
        pilots_s=plan.spent,
        foreseen_s=plan.wall_time,
        taken_s=taken,
        taken_of_time_percent=100.0 * taken / within,
        foreseen_error_percent=100.0 * plan.error,
        error_percent=math.nan,
        error_deviation_percent=math.nan,
        foreseen_over_error=math.nan,
        sampling_error_percent=100.0 * plan.sampling_error,
        time_kept=bool(0.5 * least <= taken / within <= 1.1),
        error_kept=False,
        runs=count,
        reference_refinement=FINER * plan.refinement,
        reference_runs=options['references'],
        reference_device='',
        clock=options['clock'],
        device=options['device'],
        machine=options['machine'],
        command=options['command'],
    )
    return row, [run.covered[-1] for run in runs]


def judge(row, covered, device, limit):
    """Return the row with the errors of its runs, and the wall time of the reference [s].

    If a run of the reference exceeds the limit, the row is unchanged.
    """
    start = time.monotonic()
    references = runs_of(
        scene_of(row.scene).scene, row.reference_refinement, row.horizon_s, row.reference_runs,
        device, time.monotonic, limit=limit,
    )
    if not all(run.is_done for run in references):
        return row, time.monotonic() - start
    reference = np.mean([run.covered[-1] for run in references], axis=0) > 0.5
    errors = [100.0 * wrong(cells, reference) for cells in covered]
    error, foreseen = statistics.mean(errors), row.foreseen_error_percent
    row = replace(
        row,
        error_percent=error,
        error_deviation_percent=float(np.std(errors, ddof=1)),
        foreseen_over_error=foreseen / error if error else math.nan,
        error_kept=bool(0.5 * error <= foreseen <= 2.0 * error),
        reference_device=device,
    )
    return row, time.monotonic() - start


def keep_to(cores):
    """Pin a worker to its own core."""
    os.sched_setaffinity(0, {cores.get()})


def hill():
    """Return a slope with gentle valleys and a flow with uncertain quantities."""
    y, x = np.mgrid[0:40, 0:40] * 20.0
    return Scene(
        Terrain(1500.0 - 0.15 * y + 20.0 * np.sin(x / 150.0), 20.0),
        (Vent((400.0, 200.0), 20.0, radius=30.0),),
        Lava(viscosity=1e4),
        uncertainty=uncertainty_from_dict({
            'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'viscosity': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'position': {'deviation': 40.0},
        }),
    )


def sampling(machine, command):
    """Yield the errors of ensembles relative to all members, at probabilities of 40 to 60 %."""
    scene, horizon = hill(), 1200.0
    plan = make_plan(scene, horizon=horizon, accuracy=accuracy_at(scene, 0.3, horizon))

    def reached(members):
        fields = run_members(plan, members, device='cpu')
        return np.array([reached_by(footprint_of(item, plan), plan, horizon) for item in fields])

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
            rows.append(('found, members of `lava ensemble`', error(balanced[size])))
        for kind, value in rows:
            yield [f'error of a probability, {kind}', size, value, '%', machine, command]


def arguments():
    """Return the arguments of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--device', default='cpu')
    parser.add_argument(
        '--reference-device', action='append', help='device of the references; repeat for several'
    )
    parser.add_argument(
        '--references', type=int, default=3, help='runs of a reference, 0: time only'
    )
    parser.add_argument(
        '--reference-limit', type=float, default=math.inf, metavar='S',
        help='maximum wall time of a run of a reference [s]',
    )
    parser.add_argument('--machine', required=True, help='name of the machine in the table')
    parser.add_argument('--clock', choices=('wall', 'process'), default='wall')
    parser.add_argument('--scene', action='append', metavar='NAME', help='run only these scenes')
    parser.add_argument('--times', type=float, default=1.0, help='factor on the available time')
    parser.add_argument('--jobs', type=int, default=1, help='number of parallel scenes')
    parser.add_argument('--reference-jobs', type=int, default=1, help='parallel references')
    parser.add_argument('--output', type=Path, default=FOLDER / 'plan.csv')
    parser.add_argument('--json', type=Path, help='also write the table as JSON')
    parser.add_argument('--part', choices=('plans', 'sampling'), help='run only this part')
    args = parser.parse_args()
    for name in ('output', 'json'):
        if getattr(args, name):
            file_to_write(f'--{name}', getattr(args, name))
    return args


def main():
    """Measure and write the tables."""
    args = arguments()
    words = sys.argv[1:]
    for name in ('--output', '--json'):
        if name in words:
            # the output path is not part of the recorded command
            del words[words.index(name) : words.index(name) + 2]
    quoted = [repr(word) if ' ' in word else word for word in words]
    command = ' '.join(['python docs/benchmarks/plan.py', *quoted])
    options = {
        'device': args.device, 'references': args.references, 'machine': args.machine,
        'clock': args.clock, 'command': command,
    }
    if args.part != 'sampling':
        plans(args, options)
    if args.part != 'plans':
        head = ['quantity', 'members', 'value', 'unit', 'machine', 'command']
        lines = [head, *sampling(args.machine, command)]
        write(args.output.with_name('plan_sampling.csv'), lines)


def plans(args, options):
    """Measure plans and write their table."""
    work = [
        (name, args.times * within, fraction, members, options)
        for name, within, fraction, members in (*CASES, *HELD_OUT)
        if args.scene is None or name in args.scene
    ]
    # longest first
    work.sort(key=lambda item: -item[1])
    context = multiprocessing.get_context('spawn')
    cores = context.Queue()
    found = sorted(os.sched_getaffinity(0))
    jobs = min(args.jobs, len(found))
    # far apart: neighbouring numbers may be two threads of one core
    for core in found[:: len(found) // jobs][:jobs]:
        cores.put(core)
    rows, refused, covered = [], [], {}
    with ProcessPoolExecutor(jobs, context, keep_to, (cores,)) as pool:
        for future in [pool.submit(compile_for, name, options) for name in {w[0] for w in work}]:
            future.result()
        for future in as_completed([pool.submit(measure, *item) for item in work]):
            row, cells = future.result()
            if isinstance(row, str):
                refused.append(row)
                log(row)
                continue
            rows.append(row)
            covered[row] = cells
            log(
                f'{row.scene:13} {row.within_s:5.3g} s, {row.members:2} runs: spacing '
                f'{row.spacing_m:.3g} m, {row.taken_of_time_percent:.0f} % of the time'
            )
            save(rows, args)
    if args.references:
        devices = args.reference_device or [args.device]
        # cheapest first, so that most rows are complete after an interruption
        rows.sort(key=lambda row: row.taken_s / row.members)
        with ProcessPoolExecutor(args.reference_jobs, context) as pool:
            futures = [
                pool.submit(
                    judge, row, covered[row], devices[place % len(devices)], args.reference_limit
                )
                for place, row in enumerate(rows)
            ]
            for future in as_completed(futures):
                row, seconds = future.result()
                place = [(item.scene, item.within_s, item.members) for item in rows].index(
                    (row.scene, row.within_s, row.members)
                )
                rows[place] = row
                log(
                    f'{row.scene:13} {row.within_s:5.3g} s, {row.members:2} runs: error '
                    f'{row.foreseen_error_percent:.2g} % foreseen, {row.error_percent:.2g} % '
                    f'found, by {seconds:.0f} s'
                )
                save(rows, args)
    if refused:
        sys.exit('\n'.join(refused))


def log(line):
    """Print a line of progress."""
    print(line, file=sys.stderr, flush=True)


def save(rows, args):
    """Write the table with all rows so far."""
    names = [item.name for item in (*scenes(), *held_out())]
    rows = sorted(rows, key=lambda row: (names.index(row.scene), row.within_s, row.members))
    write_csv(rows, args.output)
    if args.json:
        write_json(as_plain(rows), args.json)


def write(path, lines):
    """Write lines as CSV, numbers with four digits."""
    with path.open('w', newline='', encoding='utf-8') as file:
        table = csv.writer(file, lineterminator='\n')
        for line in lines:
            table.writerow([f'{item:.4g}' if isinstance(item, float) else item for item in line])


if __name__ == '__main__':
    main()
