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
decides: so each footprint is that of many runs, with vents moved by parts of a cell, and counts
the cells that lava covers in most of them. The runs go side by side, each on its own copy of the
terrain with cells without data between, in one simulation: particles of one are never neighbours
of another's, and all take the shortest of their steps. How much of a difference still says nothing
is measured too: a half of the runs against the other half, which differ by a factor of sqrt(2)
more than two sets of all runs do. Time is that of a run of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
import math
import time as wall_clock

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, COVERED
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import decide, effects_for
from lava_ros.verification.benchmarks.scenes import BenchScene, scenes
from lava_ros.verification.measure import machine_name

#: How far the vents are moved from one run to the next, in cells, along x and along y.
SHIFT = 0.01

#: How much more they give, as a share: on a plane a flow that is moved is the same flow.
GAIN = 1e-5

#: Runs that make a footprint.
RUNS = 24

#: Cells without data between two copies of a terrain.
GAP = 16


@dataclass(frozen=True)
class Row:
    """One scene: a line of the CSV.

    Attributes:
        scene: Name of the scene.
        effects_auto: The chosen effects.
        effects_all: All effects: those that the material and the terrain have.
        runs: Runs that make a footprint: the cells that lava covers in most of them.
        jaccard: Cells in both footprints over cells in either.
        noise_auto: The same of the footprints of both halves of the runs with the chosen effects.
        noise_all: The same of both halves of the runs with all effects.
        single: Mean over the runs: a run with the chosen effects, and that with all effects whose
            vents are in the same place.
        seconds_auto: Wall time of a run with the chosen effects [s].
        seconds_all: Wall time of a run with all effects [s].
        particles: Particles of a run at the end, with the chosen effects.
        evaluations_auto: Velocity evaluations of a run with the chosen effects.
        evaluations_all: Velocity evaluations of a run with all effects.
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
    noise_auto: float
    noise_all: float
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


@dataclass(frozen=True)
class Cost:
    """What a run took.

    Attributes:
        particles: Particles at the end.
        evaluations: Velocity evaluations.
        seconds: Wall time, without compiling the kernels [s].
    """

    particles: int
    evaluations: int
    seconds: float


def everything(scene: Scene, *, accuracy: Accuracy, horizon: float) -> Effects:
    """Every effect that the material has and that goes together.

    Of inertia and lateral stress, which do not, it is the one that is chosen; where neither is, it
    is the one whose number comes nearer to its threshold.
    """
    decisions = {
        item.name: item
        for item in decide(scene, accuracy=accuracy, horizon=horizon)
    }
    forced = {name: not math.isnan(item.value) for name, item in decisions.items()}
    chosen = effects_for(scene, accuracy=accuracy, horizon=horizon)
    forced['inertia'] = chosen.inertia
    if not (chosen.inertia or chosen.green or chosen.helmholtz):
        weight = {
            name: decisions[name].value / decisions[name].effect.threshold
            for name in ('inertia', 'helmholtz')
        }
        forced['inertia'] = weight['inertia'] > weight['helmholtz']
    # the solve is the better form of the two
    forced['green'], forced['helmholtz'] = False, not forced['inertia']
    return effects_for(scene, forced, accuracy=accuracy, horizon=horizon)


def copies(scene: Scene, count: int, shift: float = SHIFT) -> Scene:
    """A scene ``count`` times, side by side.

    The vents of each are ``shift`` cells further along x and y than those of the one before, and
    give ``GAIN`` more.
    """
    terrain = scene.terrain
    rows, columns = (side + GAP for side in terrain.elevation.shape)
    width = math.ceil(math.sqrt(count * rows / columns))
    height = math.ceil(count / width)
    elevation = np.full((height * rows, width * columns), np.nan, dtype=np.float32)
    vents: list[Vent] = []
    for number in range(count):
        row, column = rows * (number // width), columns * (number % width)
        elevation[row : row + rows - GAP, column : column + columns - GAP] = terrain.elevation
        moved = (np.array([column, row]) + shift * number) * terrain.resolution
        gain = 1.0 + GAIN * number
        for vent in scene.vents:
            series = tuple((time, gain * flux) for time, flux in vent.series)
            vents.append(
                replace(
                    vent,
                    position=tuple(moved + vent.position),
                    end=vent.end and tuple(moved + vent.end),
                    discharge=series[0][1] if isinstance(vent.discharge, float) else series,
                )
            )
    wide = Terrain(elevation, terrain.resolution, terrain.origin)
    return replace(scene, terrain=wide, vents=tuple(vents))


def covered(
    scene: Scene, count: int, effects: Effects, *, accuracy: Accuracy, horizon: float, device: str
) -> np.ndarray:
    """Cells that lava covers at a time [s] in each of many runs, bool, [runs, rows, columns]."""
    accuracy = resolved_accuracy(accuracy, scene, horizon=horizon)
    wide = copies(scene, count)
    simulation = Simulation(wide, effects=effects, accuracy=accuracy, device=device)
    simulation.advance(horizon)
    cells = simulation.snapshot().thickness > COVERED
    rows, columns = (side + GAP for side in scene.terrain.elevation.shape)
    tiles = cells.reshape(cells.shape[0] // rows, rows, cells.shape[1] // columns, columns)
    each = tiles.swapaxes(1, 2).reshape(-1, rows, columns)
    return each[:count, : rows - GAP, : columns - GAP]


def cost(
    scene: Scene, effects: Effects, *, accuracy: Accuracy, horizon: float, device: str
) -> Cost:
    """Simulate a scene up to a time [s], its kernels compiled beforehand."""
    accuracy = resolved_accuracy(accuracy, scene, horizon=horizon)
    warm = Simulation(scene, effects=effects, accuracy=accuracy, device=device)
    warm.advance(1e-3)
    simulation = Simulation(scene, effects=effects, accuracy=accuracy, device=device)
    start = wall_clock.perf_counter()
    simulation.advance(horizon)
    seconds = wall_clock.perf_counter() - start
    return Cost(
        particles=simulation.particle_count,
        evaluations=simulation.snapshot().steps.evaluations,
        seconds=seconds,
    )


def jaccard(one: np.ndarray, other: np.ndarray) -> float:
    """Cells in both over cells in either; NaN, which is within no bound, where there are none."""
    either = np.count_nonzero(one | other)
    return np.count_nonzero(one & other) / either if either else math.nan


def footprint(runs: np.ndarray) -> np.ndarray:
    """Cells that lava covers in most of the runs [runs, rows, columns]."""
    return runs.mean(axis=0) > 0.5


def noise(runs: np.ndarray) -> float:
    """How far the footprints of both halves of the runs agree: every other one in each."""
    return jaccard(footprint(runs[::2]), footprint(runs[1::2]))


def measure(
    item: BenchScene, *, device: str, command: str, preset: str = DEFAULT, runs: int = RUNS
) -> Row:
    """Simulate a scene with the chosen effects and with all of them."""
    accuracy = preset_accuracy(preset)
    auto = effects_for(item.scene, accuracy=accuracy, horizon=item.horizon)
    full = everything(item.scene, accuracy=accuracy, horizon=item.horizon)
    cost_auto, cost_all = (
        cost(item.scene, effects, accuracy=accuracy, horizon=item.horizon, device=device)
        for effects in (auto, full)
    )
    chosen, complete = (
        covered(
            item.scene, runs, effects, accuracy=accuracy, horizon=item.horizon, device=device
        )
        for effects in (auto, full)
    )
    return Row(
        scene=item.name,
        effects_auto=names(auto),
        effects_all=names(full),
        runs=runs,
        jaccard=jaccard(footprint(chosen), footprint(complete)),
        noise_auto=noise(chosen),
        noise_all=noise(complete),
        single=float(np.mean([jaccard(*pair) for pair in zip(chosen, complete, strict=True)])),
        seconds_auto=cost_auto.seconds,
        seconds_all=cost_all.seconds,
        particles=cost_auto.particles,
        evaluations_auto=cost_auto.evaluations,
        evaluations_all=cost_all.evaluations,
        cells=int(np.count_nonzero(footprint(complete))),
        simulated_s=item.horizon,
        device=device,
        machine=machine_name(device),
        command=command,
    )


def names(effects: Effects) -> str:
    """The effects that are on, in the order of the criteria, with spaces between."""
    return ' '.join(effects)


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
