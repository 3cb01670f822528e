# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Speed of batches of one to many ensemble members.

The lava is the same as in ``benchmarks/effects.py``, in steps of fixed length of one stage.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import warp as wp

from lava_ros.runs.drive import driving
from lava_ros.simulation import Simulation
from lava_ros.simulation.batch import Batch
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP, timed
from lava_ros.verification.benchmarks.steps import used_memory
from lava_ros.verification.rows import OnProgress, row_of

#: Default particles per member, numbers of members by device, and maximum particles of all
#: members.
PARTICLES = (300, 1_000, 10_000)
MEMBERS = {'cuda': (1, 4, 16, 32, 64, 256, 1024), 'cpu': (1, 4)}
MAX_PARTICLES = 3_000_000

#: Sets of effects, by their names in ``effect_sets``.
SETS = ('bare', 'green')

#: Number of steps in one measurement, of at most 1e10 particle-steps: starting a member takes as
#: long as some steps.
STEPS = {'cuda': 16_384, 'cpu': 64}


def measure(
    device: str, *, particles: Sequence[int] | None, repetitions: int, on_progress: OnProgress
) -> Iterator[dict[str, Any]]:
    """Time steps of members, by their number and particles; None uses the default particles."""
    kind = 'cuda' if wp.get_device(device).is_cuda else 'cpu'
    cases = [
        (name, number, members)
        for name in SETS
        for number in particles or PARTICLES
        for members in MEMBERS[kind]
        if number * members <= MAX_PARTICLES
    ]
    for index, (name, number, members) in enumerate(cases):
        on_progress(f'{name}: {members} members of {number} particles', index / len(cases))
        before = used_memory(device)
        simulations = [lava_field(number, effect_sets()[name], device) for _ in range(members)]
        count = sum(item.particle_count for item in simulations)
        what = f'{name}: {members} members'
        steps = min(STEPS[kind], int(1e10 / count))
        rates = [_rate(simulations, steps, device) for _ in range(repetitions + 1)]
        # the first measurement includes compiling and graph capture
        yield row_of(what, number, rates[1:], 'M particle-steps/s')
        memory = (used_memory(device) - before) / count
        if memory:
            yield row_of(f'{what}: memory', number, [memory], 'B per particle')
        # frees memory now, not while the next members are measured
        del simulations


def _rate(simulations: Sequence[Simulation], steps: int, device: str) -> float:
    """Return particle-steps per second of all members [1e6/s]; vents add particles."""

    def taken() -> np.ndarray:
        return np.array([(item.steps, item.particle_count) for item in simulations])

    before = taken()
    ways = (driving(item, item.time + steps * STEP) for item in simulations)
    elapsed = timed(device, lambda: Batch(at_once=len(simulations)).run(ways))
    after = taken()
    particles = 0.5 * (before[:, 1] + after[:, 1])
    return 1e-6 * float((after[:, 0] - before[:, 0]) @ particles) / elapsed
