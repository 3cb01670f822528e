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

"""Whether the choice of effects is right: each scene with the chosen effects and with all of them.

What lava covers is compared cell by cell. Where a flow splits, where its particles happen to lie
decides: so each footprint is that of several runs, with vents moved by millimetres, and counts the
cells that lava covers in most of them. How much of a difference still says nothing is measured
too: the chosen effects against themselves, with other such vents.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
import math
from statistics import median
import time as wall_clock

import numpy as np

from lava_ros.accuracy import Accuracy
from lava_ros.bench.scenes import BenchScene, scenes
from lava_ros.choice import CRITERIA, decide, effects_for
from lava_ros.effects import Effects
from lava_ros.presets import DEFAULT, preset_accuracy
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation
from lava_ros.verification.measure import machine_name

#: Least thickness of what counts as covered [m].
COVERED = 0.1

#: How far the vents are moved from one run to the next [m], along x and along y.
SHIFT = 0.005

#: How much more they give, as a share: on a plane a flow that is moved is the same flow.
GAIN = 1e-5

#: Runs that make a footprint.
RUNS = 9


@dataclass(frozen=True)
class Row:
    """One scene: a line of the CSV.

    Attributes:
        scene: Name of the scene.
        effects_auto: The chosen effects.
        effects_all: All effects: those that the material and the terrain have.
        runs: Runs that make a footprint: the cells that lava covers in most of them.
        jaccard: Cells in both footprints over cells in either.
        noise: The same of two footprints with the chosen effects, their vents moved differently.
        single: The same of single runs with the chosen and with all effects, vents not moved.
        seconds_auto: Wall time with the chosen effects, median of all runs with them [s].
        seconds_all: Wall time with all effects, median likewise [s].
        particles: Particles at the end, with the chosen effects.
        evaluations_auto: Velocity evaluations with the chosen effects.
        evaluations_all: Velocity evaluations with all effects.
        cells: Cells of the footprint with all effects.
        simulated_s: Simulated time [s].
        device: Warp device.
        machine: What it is.
        command: What made the row.
    """

    scene: str
    effects_auto: str
    effects_all: str
    runs: int
    jaccard: float
    noise: float
    single: float
    seconds_auto: float
    seconds_all: float
    particles: int
    evaluations_auto: int
    evaluations_all: int
    cells: int
    simulated_s: float
    device: str
    machine: str
    command: str


@dataclass(frozen=True, eq=False)
class Flow:
    """What a run gave.

    Attributes:
        covered: Cells that lava covers, bool, shape [rows, columns].
        particles: Particles at the end.
        evaluations: Velocity evaluations.
        seconds: Wall time, without compiling the kernels [s].
    """

    covered: np.ndarray
    particles: int
    evaluations: int
    seconds: float


def everything(scene: Scene, *, accuracy: Accuracy, horizon: float) -> Effects:
    """Every effect that the material has and that goes together.

    Of inertia and lateral stress, which do not, it is the one that is chosen; where neither is, it
    is the one whose number comes nearer to its threshold.
    """
    decisions = {
        item.criterion.effect: item
        for item in decide(scene, accuracy=accuracy, horizon=horizon)
    }
    forced = {name: not math.isnan(item.value) for name, item in decisions.items()}
    chosen = effects_for(scene, accuracy=accuracy, horizon=horizon)
    forced['inertia'] = chosen.inertia
    if not (chosen.inertia or chosen.green or chosen.helmholtz):
        weight = {
            name: decisions[name].value / decisions[name].criterion.threshold
            for name in ('inertia', 'helmholtz')
        }
        forced['inertia'] = weight['inertia'] > weight['helmholtz']
    # the solve is the better form of the two
    forced['green'], forced['helmholtz'] = False, not forced['inertia']
    return effects_for(scene, forced, accuracy=accuracy, horizon=horizon)


def disturbed(scene: Scene, distance: float) -> Scene:
    """The scene with every vent a distance [m] further along x and y, and ``GAIN`` stronger."""
    vents = []
    for vent in scene.vents:
        end = vent.end and (vent.end[0] + distance, vent.end[1] + distance)
        place = (vent.position[0] + distance, vent.position[1] + distance)
        series = tuple((time, (1.0 + GAIN) * flux) for time, flux in vent.series)
        discharge = series[0][1] if isinstance(vent.discharge, float) else series
        vents.append(replace(vent, position=place, end=end, discharge=discharge))
    return replace(scene, vents=tuple(vents))


def simulate(
    scene: Scene, effects: Effects, *, accuracy: Accuracy, horizon: float, device: str
) -> Flow:
    """Simulate a scene up to a time [s], its kernels compiled beforehand."""
    warm = Simulation(scene, effects=effects, accuracy=accuracy, device=device)
    warm.advance(1e-3)
    simulation = Simulation(scene, effects=effects, accuracy=accuracy, device=device)
    start = wall_clock.perf_counter()
    simulation.advance(horizon)
    seconds = wall_clock.perf_counter() - start
    snapshot = simulation.snapshot()
    return Flow(
        covered=snapshot.thickness > COVERED,
        particles=snapshot.particle_count,
        evaluations=snapshot.steps.evaluations,
        seconds=seconds,
    )


def jaccard(one: np.ndarray, other: np.ndarray) -> float:
    """Cells in both over cells in either; NaN, which is within no bound, where there are none."""
    either = np.count_nonzero(one | other)
    return np.count_nonzero(one & other) / either if either else math.nan


def footprint(flows: Sequence[Flow]) -> np.ndarray:
    """Cells that lava covers in most of the runs, bool, shape [rows, columns]."""
    return np.mean([flow.covered for flow in flows], axis=0) > 0.5


def measure(
    item: BenchScene, *, device: str, command: str, preset: str = DEFAULT, runs: int = RUNS
) -> Row:
    """Simulate a scene with the chosen effects, with all of them, and with disturbed vents."""
    accuracy = preset_accuracy(preset)
    auto = effects_for(item.scene, accuracy=accuracy, horizon=item.horizon)
    full = everything(item.scene, accuracy=accuracy, horizon=item.horizon)

    def flows(effects: Effects, first: int) -> list[Flow]:
        return [
            simulate(
                disturbed(item.scene, SHIFT * number) if number else item.scene,
                effects,
                accuracy=accuracy,
                horizon=item.horizon,
                device=device,
            )
            for number in range(first, first + runs)
        ]

    chosen, complete, others = flows(auto, 0), flows(full, 0), flows(auto, runs)
    expected = footprint(chosen)
    return Row(
        scene=item.name,
        effects_auto=names(auto),
        effects_all=names(full),
        runs=runs,
        jaccard=jaccard(expected, footprint(complete)),
        noise=jaccard(expected, footprint(others)),
        single=jaccard(chosen[0].covered, complete[0].covered),
        seconds_auto=median(one.seconds for one in (*chosen, *others)),
        seconds_all=median(one.seconds for one in complete),
        particles=chosen[0].particles,
        evaluations_auto=chosen[0].evaluations,
        evaluations_all=complete[0].evaluations,
        cells=int(np.count_nonzero(footprint(complete))),
        simulated_s=item.horizon,
        device=device,
        machine=machine_name(device),
        command=command,
    )


def names(effects: Effects) -> str:
    """The effects that are on, in the order of the criteria, with spaces between."""
    return ' '.join(
        criterion.effect for criterion in CRITERIA if getattr(effects, criterion.effect)
    )


def run(
    device: str,
    on_progress: Callable[[str, float], None] = lambda what, share: None,
    preset: str = DEFAULT,
    runs: int = RUNS,
) -> list[Row]:
    """Measure every scene.

    Args:
        device: Warp device.
        on_progress: Told what begins, and the share of the work that is done, from 0 to 1.
        preset: Accuracy of the runs.
        runs: Runs that make a footprint.
    """
    rows, items = [], scenes()
    command = f'lava bench choice --device {device} --preset {preset} --runs {runs}'
    for index, item in enumerate(items):
        on_progress(item.name, index / len(items))
        rows.append(measure(item, device=device, command=command, preset=preset, runs=runs))
    on_progress('done', 1.0)
    return rows
