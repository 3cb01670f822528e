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

"""The accuracy one can afford: spacing, preset and members for a scene, a horizon and a time.

Nothing is known of a scene's cost before some of it has been run, so coarse pilots are, each
finer than the one before, until one takes a fifth of the time there is. They say two things.

Cost: the wall time of a run is that of its evaluations, E (a + b N): E grows as a power of the
refinement r, the number N of particles as its square. Two pilots give the power, a and b. A finer
run may call for other effects (choice.py) that cost more: a plan has those of the last pilot.

Error: what a coarser pilot covers that the finest does not, or the other way round, over what both
cover, falls as C / r. Fronts are smoothed over a spacing, so the errors of flows down a slope
halve with the spacing in docs/accuracy (slope_flux: 1.2, 0.6 and 0.3 % at the three presets). The
pilots give C; it is of the method alone, not of terrain, discharge and material.

Members of an ensemble share the time. The probability that n of them give has a sampling error of
up to 1 / (2 sqrt(n)). Where n is left open, it is the one with which both errors are least.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
import math
import time as wall_clock

import numpy as np

from lava_ros import validation
from lava_ros.accuracy import Accuracy
from lava_ros.choice import effects_for
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.presets import PRESETS
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation
from lava_ros.simulation.automatic import resolved_accuracy

#: Refinement of the first pilot, and how much finer each is than the one before.
FIRST, FINER = 0.2, 1.4

#: Refinements that a plan may have, those of the presets.
COARSEST, FINEST = FIRST, PRESETS['reference'].accuracy.refinement

#: Share of the time that the last pilot takes: five times as much is foreseen at most.
ENOUGH = 0.2

#: Share of the time that a plan uses: what is left is for what it does not know.
USED = 0.8

#: Thickness from which on a cell is covered [m].
COVERED = 0.1

#: Most members worth having: 1 % of sampling error.
_MOST_MEMBERS = 2500


@dataclass(frozen=True, eq=False)
class Pilot:
    """A coarse run.

    Attributes:
        refinement: Its refinement.
        wall_time: How long it took, kernels compiled before [s].
        evaluations: Velocity evaluations.
        particles: Particles at the end.
        effects: The physics that was chosen.
        covered: Cells with lava at the end, bool, shape [rows, columns].
    """

    refinement: float
    wall_time: float
    evaluations: int
    particles: int
    effects: Effects
    covered: np.ndarray


@dataclass(frozen=True)
class Affordable:
    """What to run.

    Attributes:
        preset: Name of the preset that is nearest below.
        spacing: Distance between particles [m].
        refinement: The terrain's resolution over it.
        members: Members of an ensemble, 1 for a single run.
        wall_time: How long all of it will take [s].
        error: Share of the covered area that is wrong for being coarse.
        sampling_error: Standard error of a probability of one half, 0 for a single run.
        is_finest: Whether more time would not make it finer with the same physics.
        pilots: Pilots that were run.
        spent: How long they took [s].
    """

    preset: str
    spacing: float
    refinement: float
    members: int
    wall_time: float
    error: float
    sampling_error: float
    is_finest: bool
    pilots: int
    spent: float


def run_at(
    scene: Scene, refinement: float, horizon: float, *, device: str | None, wall_limit: float
) -> Pilot | None:
    """Run a scene to its horizon, None when that takes longer than a wall time [s]."""
    simulation = Simulation(scene, accuracy=accuracy_at(scene, refinement), device=device)
    begun = wall_clock.monotonic()
    if simulation.advance(horizon, wall_limit=wall_limit) < horizon:
        return None
    wall_time = wall_clock.monotonic() - begun
    snapshot = simulation.snapshot()
    return Pilot(
        refinement,
        wall_time,
        snapshot.steps.evaluations,
        snapshot.particle_count,
        simulation.effects,
        snapshot.thickness >= COVERED,
    )


def accuracy_at(scene: Scene, refinement: float) -> Accuracy:
    """The accuracy of the presets at a refinement between theirs."""
    spacing = scene.terrain.resolution / refinement
    return replace(PRESETS[_preset(refinement)].accuracy, spacing=spacing)


def afford(
    scene: Scene,
    *,
    within: float,
    horizon: float,
    members: int | None = 1,
    device: str | None = None,
    on_pilot: Callable[[Pilot], None] = lambda _: None,
) -> Affordable:
    """Find the finest runs that fit into a time.

    Args:
        scene: The scene; of an ensemble the one in the middle.
        within: Wall time there is [s].
        horizon: How far each run goes [s].
        members: Runs, None for the number that errs least together.
        device: Warp device; the first CUDA device when there is one, else the CPU.
        on_pilot: Called after each pilot.

    Raises:
        LavaError: An argument is not usable, or the time is too short for the coarsest run.
    """
    within = validation.number('within', within, above=0.0, unit='s')
    horizon = validation.number('horizon', horizon, above=0.0, unit='s')
    if members is not None and members < 1:
        raise LavaError('members', members, 'at least 1')
    pilots = _pilots(scene, within, horizon, members or 1, device, on_pilot)
    first_order = _first_order(pilots)
    refinements = _refinements(scene, pilots[-1])
    refinement, count = _best(pilots, refinements, first_order, USED * within, members)
    wall_time = count * _cost(pilots, refinement)
    if wall_time > within:
        right = f'about {wall_time:.2g} s: that is what the coarsest {count} take'
        raise LavaError('within', within, right)
    return Affordable(
        preset=_preset(refinement),
        spacing=scene.terrain.resolution / refinement,
        refinement=refinement,
        members=count,
        wall_time=wall_time,
        error=first_order / refinement,
        sampling_error=_sampling_error(count),
        is_finest=refinement >= refinements[-1],
        pilots=len(pilots),
        spent=sum(pilot.wall_time for pilot in pilots),
    )


def _preset(refinement: float) -> str:
    """The finest preset that is no finer, ``draft`` below all."""
    names = ['draft', 'standard', 'fine']
    below = [name for name in names if PRESETS[name].accuracy.refinement <= refinement * 1.001]
    return below[-1] if below else names[0]


def _pilots(
    scene: Scene,
    within: float,
    horizon: float,
    members: int,
    device: str | None,
    on_pilot: Callable[[Pilot], None],
) -> list[Pilot]:
    pilots: list[Pilot] = []
    refinement = FIRST
    while refinement <= FINEST:
        accuracy = accuracy_at(scene, refinement)
        # compiles what is not known yet
        Simulation(scene, accuracy=accuracy, device=device).advance(1e-3)
        pilot = run_at(scene, refinement, horizon, device=device, wall_limit=within)
        if pilot is None and len(pilots) < 2:
            raise LavaError('within', within, 'longer: the coarsest runs take more')
        if pilot is None:
            # finer physics, or a busy machine: what has been seen will do
            break
        pilots.append(pilot)
        on_pilot(pilot)
        # those of few members may be finer than what all can have
        is_enough = pilot.wall_time * members >= ENOUGH * within
        if len(pilots) >= 2 and is_enough:
            break
        refinement *= FINER
    return pilots


def _cost(pilots: list[Pilot], refinement: float) -> float:
    """Wall time of a run [s]."""
    one, two = pilots[-2:]
    if one.effects != two.effects:
        # nothing to compare with: all of the time is that of the particles
        return two.wall_time * (refinement / two.refinement) ** 3
    ratio = two.refinement / one.refinement
    power = math.log(max(two.evaluations, 1) / max(one.evaluations, 1)) / math.log(ratio)
    evaluations = two.evaluations * (refinement / two.refinement) ** min(max(power, 0.0), 2.0)
    times = [pilot.wall_time / max(pilot.evaluations, 1) for pilot in (one, two)]
    counts = [max(pilot.particles, 1) for pilot in (one, two)]
    slope = max(0.0, (times[1] - times[0]) / max(counts[1] - counts[0], 1))
    # no more than all of it
    slope = min(slope, times[1] / counts[1])
    particles = counts[1] * (refinement / two.refinement) ** 2
    return evaluations * max(times[1] + slope * (particles - counts[1]), 0.0)


def _first_order(pilots: list[Pilot]) -> float:
    """C of the error C / r: the median over what the finest pilot says of the others."""
    finest = pilots[-1]
    found: list[float] = []
    for pilot in pilots[:-1]:
        both = int(np.count_nonzero(pilot.covered | finest.covered))
        wrong = int(np.count_nonzero(pilot.covered ^ finest.covered))
        distance = 1.0 / pilot.refinement - 1.0 / finest.refinement
        found.append(wrong / max(both, 1) / distance)
    return float(np.median(found))


def _best(
    pilots: list[Pilot],
    refinements: list[float],
    first_order: float,
    wall_time: float,
    members: int | None,
) -> tuple[float, int]:
    """Refinement and members that fit into a wall time [s] and err least."""
    best = (refinements[0], members or 1)
    least = math.inf
    for refinement in refinements:
        fitting = int(min(wall_time / max(_cost(pilots, refinement), 1e-9), _MOST_MEMBERS))
        count = fitting if members is None else members
        if not 1 <= count <= fitting:
            continue
        error = math.hypot(first_order / refinement, _sampling_error(count))
        if error <= least or (members is not None and refinement > best[0]):
            best, least = (refinement, count), error
    return best


def _refinements(scene: Scene, pilot: Pilot) -> list[float]:
    """Refinements at which the scene calls for the effects of a pilot, from the coarsest."""
    known = [float(item) for item in np.geomspace(COARSEST, FINEST, 400)]
    result = [pilot.refinement]
    for refinement in known:
        accuracy = resolved_accuracy(accuracy_at(scene, refinement), scene)
        if effects_for(scene, {}, accuracy=accuracy) == pilot.effects:
            result.append(refinement)
    return sorted(result)


def _sampling_error(members: int) -> float:
    return 0.5 / math.sqrt(members) if members > 1 else 0.0
