# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava accuracy`, `verify` and `bench`: how exact the solver is, and what it costs."""

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
import sys
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import argument, command, device_named, seconds_of
from lava_ros.cli.output import made_folder, Progress, table_lines, write_json
from lava_ros.errors import LavaError
from lava_ros.files import file_to_write, write_output
from lava_ros.maps.numbers import percent, seconds
from lava_ros.simulation import presets
from lava_ros.verification import cases, measure
from lava_ros.verification.bounds import bound, BOUNDED_PRESETS
from lava_ros.verification.cases import Measurement, Run
from lava_ros.verification.cases.sheets import LATERAL
from lava_ros.verification.chart import draw
from lava_ros.verification.report import markdown
from lava_ros.verification.rows import as_plain, points, presets_of, read_csv, Row, write_csv

#: Heading, column and format of the statistics that are printed of repeated measurements.
_SPREAD = (
    ('', 'benchmark', ''), ('particles', 'particles', 'd'), ('median', 'value', '.4g'),
    ('low', 'low', '.4g'), ('high', 'high', '.4g'), ('', 'unit', ''),
)

#: The benchmarks that `lava bench --help` explains, and the columns printed for each.
SHOWN: dict[str, tuple[tuple[str, str, str], ...]] = {
    'effects': (
        ('', 'benchmark', ''), ('', 'value', '.3g'), ('', 'unit', ''),
        ('over bare', 'ratio', '.2f'),
    ),
    'steps': _SPREAD,
    'publishing': _SPREAD,
    'members': _SPREAD,
    'choice': (
        ('scene', 'scene', ''), ('effect', 'effect', ''), ('expected', 'expected', '.2g'),
        ('measured', 'measured', '.2g'), ('threshold', 'threshold', '.2g'),
        ('stated', 'stated', '.2%'), ('changed', 'changed', '.2%'), ('chance', 'chance', '.2%'),
        ('front', 'front_changed', '.2%'), ('chosen [s]', 'seconds', '.2f'),
        ('with it [s]', 'seconds_with', '.2f'),
    ),
    'convergence': (
        ('scene', 'scene', ''), ('preset', 'preset', ''), ('spacing [m]', 'spacing_m', '.3g'),
        ('across', 'across', '.3g'), ('Jaccard', 'jaccard', '.3f'), ('halves', 'noise', '.3f'),
        ('area ratio', 'area_ratio', '.3f'), ('length ratio', 'length_ratio', '.3f'),
        ('a run [s]', 'seconds', '.2f'),
    ),
}

#: Where the benchmarks are whose module has another name.
_ELSEWHERE = {
    'publishing': 'lava_ros.ros.publishing_benchmark',
    'choice': 'lava_ros.verification.benchmarks.selection',
}


@command(
    argument(
        '--quick', None, 'fewer settings: less than two minutes on two cores', action='store_true'
    ),
    argument(
        '--case', 'NAME', 'case to run, or lateral; may be repeated (default: all)',
        [], action='append',
    ),
    argument('--repetitions', 'N', 'time each short run N times (default: 3)', int),
    argument('--longest', 'TIME', 'leave out runs that would take longer (default: 30s)'),
    argument(
        '--output', 'DIR', 'folder for the report, whose files are named after the device',
        'accuracy',
    ),
    '--device', '--json',
)
def accuracy(args: argparse.Namespace) -> int:
    """Measure error against computing time.

    The command runs every case with an exact solution at many settings and at the presets. It
    writes the errors and times as CSV, as Markdown tables and as a chart.
    """
    repetitions, longest = (1, measure.QUICK_LONGEST) if args.quick else (3, measure.LONGEST)
    if args.repetitions is not None:
        repetitions = args.repetitions
    repetitions = validation.whole('--repetitions', repetitions, at_least=1, at_most=1000)
    if args.longest is not None:
        longest = seconds_of('--longest', args.longest)
    order = [*cases.CASES, LATERAL]
    for name in args.case:
        validation.choice('--case', name, order)
    pairs = [
        (case, item)
        for case, item in measure.all_pairs(quick=args.quick)
        if not args.case or case.name in args.case
    ]
    titles = {
        case.name: f'{case.title[0].upper()}{case.title[1:]}' for case in cases.CASES.values()
    }
    device = device_named(args.device)
    folder, stem = made_folder(args.output), measure.file_stem(device)
    given = {
        'case': args.case, 'device': device, 'repetitions': args.repetitions,
        'longest': args.longest,
    }
    measured: list[Row] = []
    kept: list[Row] = []
    if args.case and (folder / f'{stem}.csv').exists():
        others = set(order) - set(args.case)
        kept = [row for row in read_csv(folder / f'{stem}.csv') if row.case in others]
    rows = kept
    with Progress() as progress:
        for found in measure.measure(
            pairs,
            device=device,
            command=_again('accuracy --quick' if args.quick else 'accuracy', given),
            repetitions=repetitions,
            longest=longest,
            on_progress=progress.show,
        ):
            # what is interrupted keeps what it has
            measured += found
            rows = sorted([*kept, *measured], key=lambda row: order.index(row.case))
            write_csv(rows, folder / f'{stem}.csv')
            page = markdown(rows, titles, stem=stem)
            write_output('--output', folder / f'{stem}.md', page)
    for name, is_effect in ((f'{stem}.png', False), (f'{stem}_effects.png', True)):
        shown = [row for row in rows if (row.case in cases.EFFECT_CASES) == is_effect]
        if shown:
            draw(shown, titles, folder / name)
    write_json(as_plain(measured), args.json)
    _print_presets(measured, titles)
    print(f'written to {folder}: {stem}.csv, {stem}.md, {stem}.png')
    return 0


def _again(words: str, options: dict[str, Any]) -> str:
    """The command that gives these numbers again, without where it puts them."""
    for name, value in options.items():
        if name == 'case':
            words += ''.join(f' --case {case}' for case in value)
        elif value is not None:
            values = value if isinstance(value, list) else [value]
            words += ' '.join([f' --{name}', *map(str, values)])
    return f'lava {words}'


def _print_presets(rows: Sequence[Row], titles: dict[str, str]) -> None:
    """Print the presets' errors and costs, one line for each case."""
    found = {(point.case, point.preset): point for point in points(rows) if point.preset}
    names = presets_of(found.values())
    if not names:
        return
    lines = [['Error in wall time for an hour', *names]]
    for case in dict.fromkeys(case for case, _ in found):
        places = [found.get((case, name)) for name in names]
        texts = [f'{percent(at.error)} in {seconds(at.cost)}' if at else '-' for at in places]
        lines.append([titles[case], *texts])
    print('\n'.join(table_lines(lines, '<' + '>' * len(names))))


@command(
    argument(
        '--preset', 'NAME', f'accuracy: {", ".join(BOUNDED_PRESETS)}', presets.DEFAULT
    ),
    argument('--case', 'NAME', 'cases to run (default: all)', action='extend', nargs='+'),
    '--device', '--json',
)
def verify(args: argparse.Namespace) -> int:
    """Compare the solver with exact solutions.

    The command runs flows whose exact solution is known. It prints the quantity of each that is
    closest to its bound. The exit status is 1 if a quantity is outside its bound.
    """
    validation.choice('--preset', args.preset, BOUNDED_PRESETS)
    accuracy = presets.preset_accuracy(args.preset)
    names = args.case or list(cases.CASES)
    for name in names:
        validation.choice('--case', name, cases.CASES)
    device = device_named(args.device)
    to_stdout = args.json == '-'
    results: list[dict[str, Any]] = []
    with Progress(sys.stderr) as progress:
        for number, case in enumerate(cases.CASES[name] for name in names):
            progress.show(f'{number + 1} of {len(names)}: {case.title}', number / len(names))
            result = case.run(accuracy, device)
            judged = [
                (item, bound(args.preset, case.name, item.quantity))
                for item in result.measurements
            ]
            results.append(_judged(result, judged))
            if not to_stdout:
                print(_line(case.name, result, judged), flush=True)
    quantities = [item for result in results for item in result['measurements']]
    within = sum(item['within'] for item in quantities)
    if not to_stdout:
        print(f'{within} of {len(quantities)} quantities are within their bounds')
    outside = within < len(quantities)
    report = {'preset': args.preset, 'accuracy': asdict(accuracy), 'device': device}
    write_json({**report, 'within_bounds': not outside, 'runs': results}, args.json)
    return int(outside)


def _line(name: str, result: Run, judged: Sequence[tuple[Measurement, float]]) -> str:
    def badness(pair: tuple[Measurement, float]) -> float:
        item, limit = pair
        return item.error / limit if item.error == item.error else float('inf')

    item, limit = max(judged, key=badness)
    mark = 'ok' if item.error <= limit else 'OUTSIDE'
    return (
        f'{name:17} {item.quantity:22} error {100.0 * item.error:7.3f} %'
        f'  bound {100.0 * limit:7.3f} %  {result.wall_time:7.1f} s  {mark}'
    )


def _judged(result: Run, judged: Sequence[tuple[Measurement, float]]) -> dict[str, Any]:
    """A run as plain data; an error that is no number is within no bound."""
    return asdict(result) | {'measurements': [
        {**asdict(item), 'error': item.error, 'bound': limit, 'within': item.error <= limit}
        for item, limit in judged
    ]}


@command(
    argument('benchmark', '|'.join(SHOWN), None, choices=tuple(SHOWN)),
    '--device', '--preset', '--json',
    argument(
        '--particles', 'N', 'number of particles, for effects, steps, publishing and members; '
        'steps and members take several (default: by the device); for choice the largest number '
        'of a run (default: any)', int, nargs='+',
    ),
    argument(
        '--repetitions', 'N', 'number of measurements, for all but choice and convergence', 5
    ),
    argument(
        '--runs', 'N', 'number of runs of a footprint (default: 24 for choice, 8 for convergence)',
        int,
    ),
    argument(
        '--case', 'CASE_DIR', 'folder of a mapped eruption, as for lava hindcast, which replaces '
        'the scenes of convergence; may be repeated', [], action='append',
    ),
    argument('--output', 'FILE', 'write the table as CSV'),
)
def bench(args: argparse.Namespace) -> int:
    """Measure computing time and memory.

    effects: time of a step with each effect, and with all effects, relative to a step without.
    steps: time of steps and snapshots, and memory, from few particles to many, beside a reference
    step. publishing: time of steps while maps are published ten times a second, and memory on a
    large map. choice: scenes with the effects that they call for, with each other effect forced
    on, and with all effects: the change of the footprint and the stated cost.
    convergence: footprints at the presets from coarse to fine, of scenes or of mapped eruptions.
    members: members of an ensemble, from one to many at once.
    """
    name = args.benchmark
    device = device_named(args.device)
    options = _options(args)
    if args.output:
        file_to_write('--output', args.output, ('.csv',))
    again = {'device': device, **options}
    if 'cases' in again:
        again['case'] = [case.name for case in again.pop('cases')]
    origin = {
        'device': device,
        'machine': measure.machine_name(device),
        'command': _again(f'bench {name}', again),
    }
    module = import_module(_ELSEWHERE.get(name, f'lava_ros.verification.benchmarks.{name}'))
    rows = []
    with Progress() as progress:
        for row in module.measure(device, on_progress=progress.show, **options):
            rows.append({**row, **origin})
            if args.output:
                # what is interrupted leaves what it has
                write_csv(rows, Path(args.output))
        progress.show('done', 1.0)
    heads, columns, forms = zip(*SHOWN[name], strict=True)
    cells = [
        [format(row[column], form) for column, form in zip(columns, forms, strict=True)]
        for row in rows
    ]
    sides = ''.join('>' if form else '<' for form in forms)
    print('\n'.join(table_lines([heads, *cells], sides)))
    write_json(as_plain(rows), args.json)
    return 0


def _options(args: argparse.Namespace) -> dict[str, Any]:
    """Check the options of a benchmark, except for the device, and return them by name."""
    repetitions = validation.whole('--repetitions', args.repetitions, at_least=1, at_most=1000)
    runs = {'choice': 24}.get(args.benchmark, 8) if args.runs is None else args.runs
    runs = validation.whole('--runs', runs, at_least=2, at_most=1000)
    if args.benchmark == 'convergence':
        # not where it is not needed: what accuracy imports is little
        from lava_ros.hindcast.case import load_case

        return {'runs': runs, 'cases': [load_case(folder) for folder in args.case]}
    particles = args.particles
    for number in particles or ():
        validation.number('--particles', number, at_least=100, at_most=1e8)
    if args.benchmark not in ('steps', 'members') and particles is not None:
        if len(particles) > 1:
            raise LavaError('--particles', particles, f'one number for {args.benchmark}')
        (particles,) = particles
    if args.benchmark == 'choice':
        return {'preset': args.preset, 'runs': runs, 'particles': particles}
    return {'repetitions': repetitions, 'particles': particles}
