# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cost of effects: the time of a step with an effect over the time of the bare step.

Every step is one stage of fixed length, so each includes the full cost of the passes at the end of
a step, and no effect changes the number of steps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product
import time as wall_clock
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import compatible, drop_superseded, EFFECTS, Effects
from lava_ros.runs.drive import drive
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification.rows import OnProgress, row_of

#: Default number of particles on a GPU, enough to keep it busy, and on a CPU.
PARTICLES = {'cuda': 1_000_000, 'cpu': 20_000}

#: Minimum time of one measurement [s].
MIN_MEASURED_TIME = 0.5

#: Number of steps that a GPU takes at once, chosen so that no idle step is measured.
_AT_ONCE = 16

#: Particle spacing and thickness of the lava [m].
SPACING, THICKNESS = 2.0, 2.0

#: Length of a step [s]: nothing moves far, so every set of effects is measured on the same lava.
STEP = 1e-3

#: Lava with a value for every constant, too hot to solidify.
_NUMBERS = {key: value for one in EFFECTS.values() for key, value in one.benchmark.items()}
_AROUND = {key: _NUMBERS.pop(key) for one in EFFECTS.values() for key in one.environment}
LAVA = Lava.paper(viscosity=1e5, liquidus=1500.0, **_NUMBERS)


def effect_sets() -> dict[str, Effects]:
    """Return the measured sets of effects, by name: none, each effect alone, and combinations."""
    sets = {'bare': compatible(()), **{name: compatible([name]) for name in EFFECTS}}
    for motion in ('green', 'inertia'):
        # a partial crust excludes a complete one
        names = sorted(EFFECTS, key=lambda name: (name != motion, name == 'cover'))
        sets[f'everything with {motion}'] = compatible(drop_superseded(names))
    return sets


def lava_field(
    particles: int, effects: Effects, device: str, *, cells: int | None = None,
    ratio: float = 3.0,
) -> Simulation:
    """Return a field of about ``particles`` particles on rough ground, with a vent in its middle.

    ``cells`` is the number of the ground's cells along a side; by default a cell is two spacings
    wide. ``ratio`` is the kernel radius over the spacing; a particle has pi ratio^2 neighbours.
    """
    count = max(8, round(particles**0.5))
    side = count * SPACING
    extent = (count // 2 + 8) * 2.0 * SPACING
    cells = cells or count // 2 + 8
    resolution = extent / cells
    rough = np.random.default_rng(1).normal(scale=0.2, size=(cells, cells))
    slope = 0.1 * resolution * np.arange(cells)
    ground = Terrain(rough - slope, resolution, origin=(0.0, 0.0))
    middle = 0.5 * extent
    ticks = middle + (np.arange(count) + 0.5) * SPACING - 0.5 * side
    places = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    # displaced from the lattice, as in a flow
    places += np.random.default_rng(2).uniform(-0.2 * SPACING, 0.2 * SPACING, places.shape)
    return Simulation(
        Scene(ground, (Vent((middle, middle), 10.0),), LAVA, **_AROUND),
        effects=effects,
        accuracy=Accuracy(
            spacing=SPACING, thickness=THICKNESS, ratio=ratio, fixed_step=STEP, integrator='euler'
        ),
        device=device,
        particles=Particles(places, THICKNESS * SPACING**2, 1400.0),
    )


def measure(
    device: str, *, particles: Sequence[int] | None, repetitions: int, on_progress: OnProgress
) -> Iterator[dict[str, Any]]:
    """Time a step with each set of effects; None uses the device's number of particles."""
    numbers = particles or [PARTICLES['cuda' if wp.get_device(device).is_cuda else 'cpu']]
    cases = list(product(numbers, effect_sets().items()))
    bare = 0.0
    for index, (number, (name, effects)) in enumerate(cases):
        on_progress(name, index / len(cases))
        field = lava_field(number, effects, device)
        times, count = step_times(field, repetitions, MIN_MEASURED_TIME)
        row = row_of(name, count, times, 'ns per particle and step')
        bare = row['value'] if name == 'bare' else bare
        repeated = row.pop('repetitions')
        yield {**row, 'ratio': row['value'] / bare, 'repetitions': repeated}


def step_times(simulation: Simulation, repetitions: int, least: float) -> tuple[list[float], int]:
    """Return wall times per step and particle [ns] of intervals, and the particles.

    An interval is at least ``least`` long [s].
    """
    # compiles, captures and reaches a steady state
    _elapsed(simulation, 2 * _AT_ONCE)
    steps = _AT_ONCE
    while (elapsed := _elapsed(simulation, steps)) < least and steps < 1 << 20:
        steps *= max(2, int(1.2 * least / max(elapsed, 1e-9)))
    count = simulation.particle_count
    times = [_elapsed(simulation, steps) for _ in range(repetitions)]
    return [1e9 * time / steps / count for time in times], count


def _elapsed(simulation: Simulation, steps: int) -> float:
    """Return the wall time of some steps [s]."""
    before, until = simulation.steps, simulation.time + steps * STEP
    elapsed = timed(simulation.device, lambda: drive(simulation, until))
    return elapsed * steps / max(1, simulation.steps - before)


def timed(device: str, action: Callable[[], object]) -> float:
    """Return the wall time of an action including all its launches on a device [s]."""
    wp.synchronize_device(device)
    start = wall_clock.perf_counter()
    action()
    wp.synchronize_device(device)
    return wall_clock.perf_counter() - start
