# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings of the accuracy report, and their measurements.

Settings are a grid, the presets, changes of one setting at a time, and comparisons of studies; one
or more runs of each pair of a case and a setting become rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
import math
import os
from pathlib import Path
import platform
import re
from statistics import median
from typing import Any

import warp as wp

from lava_ros.simulation.accuracy import Accuracy, GRADIENTS
from lava_ros.simulation.backend.threads import threads
from lava_ros.simulation.presets import DEFAULT, PRESETS
from lava_ros.verification.cases import Case, CASES, Run
from lava_ros.verification.cases.sheets import EXPERIMENTS
from lava_ros.verification.rows import Row

#: Accuracy whose single settings a study changes.
STANDARD = PRESETS[DEFAULT].accuracy

#: Cases in which single settings are changed, and the paper's step of 0.01 s is used: its 200 s
#: are 20,000 steps.
KNOB_CASES = ('fixed_volume',)

#: Cases in which the forms of the gradient are compared.
GRADIENT_CASES = ('fixed_volume', 'pond')

#: Cases of even layers: the resolution hardly matters or no time is simulated, so only presets are
#: run.
EVEN_CASES = (
    'sheet', 'green', 'channel', 'radiating_sheet', 'ground', 'crust', 'insulation',
    'latent_heat', 'herschel_bulkley', 'critical_thickness', 'material_laws',
)

#: Refinements at which the integrators are compared.
STEPPED = (1.0, 4.0)

#: Runs with a shorter total time are repeated [s].
REPEATED_BELOW = 3.0

#: Maximum expected time of a run [s], in a full and in a quick report.
MAX_RUN_TIME, QUICK_MAX_RUN_TIME = 30.0, 2.0

#: Factor by which a preset may take longer.
PRESET_PATIENCE = 4.0


@dataclass(frozen=True)
class Setting:
    """An accuracy to measure, and the names of the cases it is run on, None for all.

    ``preset`` is the name of the preset with this accuracy, empty if there is none.
    """

    name: str
    accuracy: Accuracy
    preset: str = ''
    cases: tuple[str, ...] | None = None


def all_settings(*, quick: bool = False) -> list[Setting]:
    """Return the settings of a report, each accuracy once, from fast to slow."""
    # 500, 2,000, 8,000 and 32,000 particles of the fixed volume; 20, 28, 38 and 64 neighbours
    refinements = [0.25, 0.5] if quick else [0.25, 0.5, 1.0, 2.0]
    ratios = [2.5, 3.5] if quick else [2.5, 3.0, 3.5, 4.5]
    names = ['draft', 'standard'] if quick else [*PRESETS]
    studied = [*convergence(), *stepping(), *paper_settings().values()]
    if quick:
        studied = [item for item in convergence() if item.refinement <= 1.0]
    presets = {PRESETS[name].accuracy: name for name in names}
    grid = [Accuracy(refinement=size, ratio=ratio) for size in refinements for ratio in ratios]
    everywhere = {*grid, *(item for item in presets if item.formulation == 'corrected')}
    some: dict[Accuracy, tuple[str, ...]] = {}
    for accuracy in (*presets, *one_at_a_time_settings(quick=quick), *studied):
        some[accuracy] = KNOB_CASES
    for accuracy in gradients().values():
        some[accuracy] = tuple(dict.fromkeys((*some.get(accuracy, ()), *GRADIENT_CASES)))
    settings = []
    for accuracy in dict.fromkeys((*grid, *some)):
        cases = None if accuracy in everywhere else some[accuracy]
        settings.append(
            Setting(name_of(accuracy), accuracy, presets.get(accuracy, ''), cases)
        )
    return sorted(settings, key=lambda item: expected_cost(item.accuracy))


def one_at_a_time_settings(*, quick: bool = False) -> list[Accuracy]:
    """Return the default preset with one setting changed at a time."""
    turned: list[dict[str, Any]] = [{'integrator': 'euler'}, {'kernel': 'poly6'}]
    if not quick:
        turned += [{'kernel': 'spiky'}, {'precision': 'float64'}]
        turned += [{'diffusion_number': number} for number in (1.0, 2.0)]
        turned += [{'courant_number': number} for number in (0.25, 0.125)]
    return [replace(STANDARD, **knob) for knob in turned]


def convergence() -> list[Accuracy]:
    """Return the default preset at every doubling of the particles, from 2,000 to 128,000.

    Steps are half as long as the preset's: at full length the error of the steps has the opposite
    sign and cancels part of that of the particles, a different part at each refinement.
    """
    refinements = (0.5, 0.707, 1.0, 1.414, 2.0, 2.828, 4.0)
    return [replace(STANDARD, refinement=size, courant_number=0.25) for size in refinements]


def stepping() -> list[Accuracy]:
    """Return Euler, RKL1, then RKL2 at several Courant numbers, by refinement.

    The steps of Euler are shorter than each of these limits.
    """
    integrators: list[dict[str, Any]] = [{'integrator': 'euler'}, {'integrator': 'rkl1'}]
    integrators += [{'courant_number': number} for number in (0.5, 0.75, 1.0)]
    return [replace(STANDARD, refinement=size, **each) for size in STEPPED for each in integrators]


def gradients() -> dict[str, Accuracy]:
    """Return the default preset for each form of the gradient."""
    return {form: replace(STANDARD, gradient=form) for form in GRADIENTS}


def paper_settings() -> dict[str, Accuracy]:
    """Return the paper's settings, then one correction after another, by description."""
    paper = PRESETS['as-published'].accuracy
    corrected = replace(paper, formulation='corrected')
    wendland = replace(corrected, kernel='wendland', ratio=2.5)
    free = replace(wendland, fixed_step=None)
    wide = replace(STANDARD, refinement=paper.refinement)
    stepped = replace(wide, ratio=wendland.ratio)
    more = (STANDARD.refinement / paper.refinement) ** 2
    return {
        '`as-published`': paper,
        # 180,000 particles of the fixed volume on a disc of 130 m are 1 m / 1.84 apart
        'l = 1 m, as in table 3.1': replace(paper, refinement=4.74),
        '`as-published`, formulas corrected': corrected,
        f'and Wendland C2 over {_neighbours(wendland)} neighbours': wendland,
        'and steps that follow the limits': free,
        'and super-time-stepping': stepped,
        f'and {_neighbours(wide)} neighbours': wide,
        f'and {more:.0f} times the particles: `{DEFAULT}`': STANDARD,
    }


def _neighbours(accuracy: Accuracy) -> str:
    return f'{math.pi * accuracy.ratio**2:.0f}'


def name_of(accuracy: Accuracy) -> str:
    """Describe the resolution, and every other setting that differs from its default."""
    usual = Accuracy()
    words = [f'refinement {accuracy.refinement:g}', f'ratio {accuracy.ratio:g}']
    for item in fields(Accuracy):
        value = getattr(accuracy, item.name)
        if item.name in ('refinement', 'ratio') or value == getattr(usual, item.name):
            continue
        label = item.name.replace('_', ' ')
        if isinstance(value, bool):
            words.append(label if value else f'not {label}')
        elif isinstance(value, str) and item.name != 'gradient':
            words.append(value)
        else:
            words.append(f'{label} {value:g}' if isinstance(value, float) else f'{label} {value}')
    return ', '.join(words)


def expected_cost(accuracy: Accuracy) -> float:
    """Estimate the time of a run relative to one at the default accuracy.

    It is the number of particles times the stages of a step, which grow with the refinement for
    super-time-stepping and with its square for Euler.
    """
    if accuracy.fixed_step is not None:
        return 0.2 / accuracy.fixed_step * accuracy.refinement**2 * 8.0
    stages = accuracy.refinement
    if accuracy.integrator == 'euler':
        stages *= 4.0 * accuracy.refinement
    return stages * accuracy.refinement**2 * (0.5 / accuracy.courant_number) ** 0.5


def all_pairs(*, quick: bool = False) -> list[tuple[Case, Setting]]:
    """Return every case with its settings, from fast to slow, then the lateral experiments.

    A quick report takes less than two minutes on two cores.
    """
    settings = all_settings(quick=quick)
    pairs = []
    for case in CASES.values():
        for item in settings:
            is_run = bool(item.preset) or case.name not in EVEN_CASES
            if item.cases is not None:
                is_run = case.name in item.cases
            if is_run:
                pairs.append((case, item))
    return pairs + [
        (case, Setting(name, STANDARD))
        for name, case in EXPERIMENTS.items()
        if not quick or name.endswith(('l = 1 h', 'l = 6 h'))
    ]


def measure(
    pairs: Sequence[tuple[Case, Setting]], *, device: str, command: str, repetitions: int = 3,
    longest: float = MAX_RUN_TIME,
    on_progress: Callable[[str, float], None] = lambda name, fraction: None,
) -> Iterator[list[Row]]:
    """Run every pair that does not take too long, case by case, from fast to slow.

    Runs that are expected to take longer than ``longest`` [s] are omitted; presets may take
    ``PRESET_PATIENCE`` times as long. Runs shorter than ``REPEATED_BELOW`` are timed several
    times. ``command`` is recorded in the rows.

    Yields:
        The rows of each case, once it is done.
    """
    machine = machine_name(device)
    groups: dict[str, list[tuple[Case, Setting]]] = {}
    for case, item in pairs:
        groups.setdefault(case.name, []).append((case, item))
    for index, group in enumerate(groups.values()):
        rows: list[Row] = []
        # seconds per unit of cost, from the slowest run so far: short runs are not representative,
        # and runs with fixed steps not comparable
        pace = known = 0.0
        for number, (case, item) in enumerate(group):
            fraction = (index + number / len(group)) / len(groups)
            on_progress(f'{case.name}: {item.preset or item.name}', fraction)
            cost = expected_cost(item.accuracy)
            if pace * cost > longest * (PRESET_PATIENCE if item.preset else 1.0):
                continue
            runs = [case.run(item.accuracy, device)]
            if cost > known and item.accuracy.fixed_step is None:
                pace, known = runs[0].wall_time / cost, cost
            while len(runs) < repetitions and sum(run.wall_time for run in runs) < REPEATED_BELOW:
                runs.append(case.run(item.accuracy, device))
            rows += _rows(runs, item, device=device, machine=machine, command=command)
        yield rows
    on_progress('done', 1.0)


def _rows(runs: Sequence[Run], setting: Setting, **origin: str) -> list[Row]:
    """Return the rows of the quantities, with the times of all runs; ``origin``: device etc."""
    run, times = runs[0], [item.wall_time for item in runs]
    wall, hours = median(times), run.simulated_time / 3600.0
    # a case that simulates no time has no cost
    cost = wall / hours if hours else math.nan
    return [
        Row(
            case=run.case, setting=setting.name, preset=setting.preset, quantity=item.quantity,
            error=float(item.error), measured=float(item.measured), exact=float(item.exact),
            unit=item.unit, particles=run.particles, steps=run.steps, evaluations=run.evaluations,
            simulated_s=float(run.simulated_time), wall_s=wall, wall_s_per_simulated_hour=cost,
            repetitions=len(times), low=min(times), high=max(times), **origin,
        )
        for item in run.measurements
    ]


def machine_name(device: str) -> str:
    """Return the name of a device's hardware, without a host name."""
    found = wp.get_device(device)
    if found.is_cuda:
        return str(found.name)
    used = threads()
    return f'{_processor()}, {used} {"core" if used == 1 else "cores"} used of {os.cpu_count()}'


def _processor() -> str:
    """Return the model of the processor without trademark signs, or its architecture."""
    try:
        text = Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        text = ''
    match = re.search(r'^model name\s*:\s*(.+)$', text, flags=re.MULTILINE)
    name = match.group(1) if match else platform.machine()
    name = re.sub(r'\((R|TM|C)\)|\bCPU\b|\bProcessor\b|@.*$', ' ', name, flags=re.IGNORECASE)
    return ' '.join(name.split())


def file_stem(device: str) -> str:
    """Return the stem of a report's file names for a device: ``cpu``, or the GPU's (``h200``)."""
    found = wp.get_device(device)
    if not found.is_cuda:
        return 'cpu'
    words = str(found.name).lower().removeprefix('nvidia').strip()
    return re.sub(r'[^a-z0-9]+', '-', words).strip('-') or 'cuda'
