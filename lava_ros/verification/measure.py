# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""How settings are measured: a run or several of each pair of a case and a setting, as rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import math
import os
from pathlib import Path
import platform
import re
from statistics import median
from typing import TYPE_CHECKING

import warp as wp

from lava_ros.simulation.backend.threads import threads
from lava_ros.verification.rows import Row
from lava_ros.verification.settings import expected_cost, Setting

if TYPE_CHECKING:
    from lava_ros.verification.cases import Case, Run

#: Runs shorter than this altogether are repeated [s].
REPEATED_BELOW = 3.0

#: Longest run that is tried [s], and the same in a quick report.
LONGEST, QUICK_LONGEST = 30.0, 2.0

#: How much longer a preset may take.
PRESET_PATIENCE = 4.0


def measure(
    pairs: Sequence[tuple[Case, Setting]], *, device: str, command: str, repetitions: int = 3,
    longest: float = LONGEST, on_progress: Callable[[str, float], None] = lambda what, share: None,
) -> Iterator[list[Row]]:
    """Run every pair that does not take too long, case by case and each from cheap to dear.

    Runs that are expected to take longer than ``longest`` [s] are left out; presets may take
    ``PRESET_PATIENCE`` times as long. Runs shorter than ``REPEATED_BELOW`` are timed several
    times. ``command`` is what the rows say made them.

    Yields:
        The rows of each case, once it is done.
    """
    machine = machine_name(device)
    groups: dict[str, list[tuple[Case, Setting]]] = {}
    for case, item in pairs:
        groups.setdefault(case.name, []).append((case, item))
    for index, group in enumerate(groups.values()):
        rows: list[Row] = []
        # seconds per unit of cost, from the dearest run so far: short ones say little, and fixed
        # steps nothing
        pace = known = 0.0
        for number, (case, item) in enumerate(group):
            share = (index + number / len(group)) / len(groups)
            on_progress(f'{case.name}: {item.preset or item.name}', share)
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
    """Rows of the quantities, with the times of all runs; ``origin`` has device and so on."""
    run, times = runs[0], [item.wall_time for item in runs]
    wall, hours = median(times), run.simulated_time / 3600.0
    # a case that takes a look without letting time pass has none
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
    """What a device is, in words that name no host."""
    found = wp.get_device(device)
    if found.is_cuda:
        return str(found.name)
    used = threads()
    return f'{_processor()}, {used} {"core" if used == 1 else "cores"} used of {os.cpu_count()}'


def _processor() -> str:
    """Model of the processor without its marks, its architecture where that is not known."""
    try:
        text = Path('/proc/cpuinfo').read_text(encoding='utf-8')
    except OSError:
        text = ''
    match = re.search(r'^model name\s*:\s*(.+)$', text, flags=re.MULTILINE)
    name = match.group(1) if match else platform.machine()
    name = re.sub(r'\((R|TM|C)\)|\bCPU\b|\bProcessor\b|@.*$', ' ', name, flags=re.IGNORECASE)
    return ' '.join(name.split())


def file_stem(device: str) -> str:
    """Name of the report's files for a device: ``cpu``, or the GPU's, as ``h200``."""
    found = wp.get_device(device)
    if not found.is_cuda:
        return 'cpu'
    words = str(found.name).lower().removeprefix('nvidia').strip()
    return re.sub(r'[^a-z0-9]+', '-', words).strip('-') or 'cuda'
