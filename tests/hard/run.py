# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Command that runs the hard scenes at every preset and prints the results: ``make hard``.

There are two tables: every scene at the presets, which have to keep every invariant, and the same
scenes with the paper's printed formulas and settings, which show the effect of the safeguards.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
import math
import multiprocessing
from pathlib import Path
import sys
from typing import Any

import warp as wp

from hard.invariants import Violation
from hard.play import KEPT, Outcome, play, PRESETS_OF
from hard.scenes import FAMILIES, SCENES
from lava_ros.cli.console import Progress, table_lines
from lava_ros.simulation.backend.threads import use_threads
from lava_ros.simulation.carriers import METHODS
from lava_ros.verification.measure import file_stem, machine_name
from lava_ros.verification.rows import write_csv

PUBLISHED = 'as-published'

#: A scene, a preset, the method, the device, and the maximum wall time [s].
Task = tuple[str, str, str, str, float | None]


def _played(
    scene: str, preset: str, method: str, device: str, wall_limit: float | None
) -> Outcome:
    """Run a scene; an exception is an outcome with a violation."""
    compare = preset != PUBLISHED
    try:
        return play(
            SCENES[scene], preset, method=method, device=device, compare=compare,
            wall_limit=wall_limit,
        )
    except Exception as error:
        raised = Violation('exception', math.nan, 0.0, math.nan, repr(error))
        return Outcome(scene, preset, violations=[raised])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the selected scenes; return 1 if a preset violates an invariant that it has to keep."""
    parser = argparse.ArgumentParser(description='Run the hard scenes.')
    parser.add_argument('--preset', action='append', choices=KEPT)
    parser.add_argument(
        '--published', action='store_true', help="the paper's settings instead of the presets"
    )
    parser.add_argument(
        '--method', choices=METHODS, default='particles',
        help='carriers of the lava; cells without the effects that they lack (default: particles)',
    )
    parser.add_argument('--scene', action='append', choices=[*SCENES, *FAMILIES], metavar='NAME')
    parser.add_argument('--device', action='append', help='cpu or cuda:0 (default: all)')
    parser.add_argument('--jobs', type=int, default=2, help='processes (default: 2)')
    parser.add_argument(
        '--limit', type=float, default=10.0,
        help='wall time of a scene at the paper\'s settings [s] (default: 10)',
    )
    parser.add_argument('--csv', type=Path, metavar='FOLDER', help='write hard_cpu.csv, '
                        'hard_cells_cpu.csv or hard_as_published_cpu.csv there, or of another '
                        'device')
    options = parser.parse_args(arguments)
    if options.published and options.method != 'particles':
        parser.error('--published is for particles: the paper has no cells')
    presets = [
        name for name in PRESETS_OF[options.method] if name in (options.preset or (name,))
    ]
    if not presets:
        parser.error(f'--method {options.method} has the same cells at fine as at standard')
    if options.csv:
        options.csv.mkdir(parents=True, exist_ok=True)
    # one thread per process
    use_threads(1)
    asked = options.scene or [*SCENES]
    names = [name for name, item in SCENES.items()
             if name in asked or any(item in FAMILIES.get(family, ()) for family in asked)]
    if options.published:
        presets = [PUBLISHED]
    devices = options.device or [str(device) for device in wp.get_devices()]
    verdicts = [one for device in devices for one in _run_on(device, options, names, presets)]
    return int(not options.published and any(one != 'holds' for one in verdicts))


def _run_on(
    device: str, options: argparse.Namespace, names: Sequence[str], presets: Sequence[str]
) -> list[str]:
    """Run the scenes at the presets; return the verdicts."""
    limit = options.limit if options.published else None
    tasks = [
        (name, preset, options.method, device, limit)
        for preset in reversed(presets) for name in names
    ]
    outcomes = run(tasks, options.jobs)
    order = {name: index for index, name in enumerate(names)}
    outcomes.sort(key=lambda item: (order[item.scene], presets.index(item.preset)))
    title, name = 'At the presets', 'hard'
    if options.method == 'cells':
        title, name = 'On cells, at the presets', 'hard_cells'
    if options.published:
        title, name = f'At the paper\'s settings, {options.limit:g} s each', 'hard_as_published'
    print(table(f'{title}, {device}', outcomes))
    print(summary(outcomes))
    if options.csv:
        rows = [_row(item, options.method, device) for item in outcomes]
        write_csv(rows, options.csv / f'{name}_{file_stem(device)}.csv')
    return [item.verdict for item in outcomes]


def run(tasks: Sequence[Task], jobs: int) -> list[Outcome]:
    """Run the tasks in processes of their own."""
    outcomes: list[Outcome] = []
    context = multiprocessing.get_context('spawn')
    pool = ProcessPoolExecutor(jobs, mp_context=context, initializer=use_threads, initargs=(1,))
    with Progress() as progress, pool:
        futures = {pool.submit(_played, *task): task for task in tasks}
        for future in as_completed(futures):
            outcomes.append(future.result())
            scene, preset, *_ = futures[future]
            progress.show(f'{scene} {preset}', len(outcomes) / len(tasks))
    return outcomes


def table(title: str, outcomes: Iterable[Outcome]) -> str:
    """Return the outcomes as text."""
    head = ('case', 'preset', 'steps', 'smallest step', 'stages/s', 'volume error', 'verdict')
    rows = []
    for item in outcomes:
        smallest = f'{item.smallest_step:.2g} s' if math.isfinite(item.smallest_step) else '-'
        reached = f' at {item.time:.3g} s of {item.until:.3g} s'
        rows.append((
            item.scene, item.preset, f'{item.steps}', smallest, f'{item.cost:.3g}',
            f'{item.volume_error:.1e}',
            item.verdict + (reached if item.verdict != 'holds' else ''),
        ))
    lines = table_lines([head, *rows], '<<>>>><')
    return '\n'.join([f'\n{title}', '', lines[0], '-' * len(lines[0]), *lines[1:]])


def summary(outcomes: Sequence[Outcome]) -> str:
    """Return the number of scenes that hold, and the violated invariants."""
    verdicts = Counter(item.verdict for item in outcomes)
    broken = Counter(
        name for item in outcomes for name in {found.invariant for found in item.violations}
    )
    lines = [f'\n{verdicts["holds"]} of {len(outcomes)} hold to the end.']
    cut = [item for item in outcomes if item.verdict == 'cut off']
    if cut:
        half = sum(item.time >= 0.5 * item.until for item in cut)
        lines.append(f'{len(cut)} were cut off and held until then, {half} of them past half.')
    lines += [f'{count} break: {name}' for name, count in broken.most_common()]
    lines += [
        f'  {item.scene} {item.preset}: {found}'
        for item in outcomes
        if item.preset != PUBLISHED
        for found in item.violations
    ]
    return '\n'.join(lines)


def _row(item: Outcome, method: str, device: str) -> dict[str, Any]:
    """Return an outcome by the columns of a file, in seconds and fractions; None: not measured."""
    family = next(name for name, scenes in FAMILIES.items() if SCENES[item.scene] in scenes)
    command = 'make hard-published' if item.preset == PUBLISHED else 'make hard'
    words = ['--method cells'] if method == 'cells' else []
    words += [] if device == 'cpu' else [f'--device {device}']
    row = {
        'case': item.scene, 'family': family, 'preset': item.preset, 'verdict': item.verdict,
        'simulated_s': item.time, 'until_s': item.until, 'particles': item.particles,
        'steps': item.steps, 'smallest_step_s': item.smallest_step,
        'stages_per_simulated_s': item.cost, 'volume_error': item.volume_error,
        'footprint_change': item.footprint_change, 'footprint_bound': item.footprint_bound,
        'asymmetry': item.asymmetry, 'wall_s': round(item.wall_time, 2),
        'what': '; '.join(map(str, item.violations)), 'machine': machine_name(device),
        'command': command + (f" ARGS='{' '.join(words)}'" if words else ''),
    }
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in row.items()
    }


if __name__ == '__main__':
    sys.exit(main())
