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

from collections.abc import Iterator
from dataclasses import replace
import math
from typing import Any

import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, COVERED
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import decide, effects_for
from lava_ros.verification.benchmarks.effects import timed
from lava_ros.verification.benchmarks.scenes import BenchScene, scenes
from lava_ros.verification.rows import OnProgress

#: How far the vents are moved from one run to the next, in cells, along x and along y.
SHIFT = 0.01

#: How much more they give, as a share: on a plane a flow that is moved is the same flow.
GAIN = 1e-5

#: Cells without data between two copies of a terrain.
GAP = 16


def everything(scene: Scene, *, accuracy: Accuracy, horizon: float) -> Effects:
    """Every effect that the material has and that goes together.

    Of inertia and lateral stress, which do not, it is the one that is chosen; where neither is, it
    is the one whose number comes nearer to its threshold.
    """
    decisions = {item.name: item for item in decide(scene, accuracy=accuracy, horizon=horizon)}
    forced = {name: not math.isnan(item.value) for name, item in decisions.items()}
    chosen = effects_for(scene, accuracy=accuracy, horizon=horizon)
    forced['inertia'] = chosen.inertia
    if not (chosen.inertia or chosen.green or chosen.helmholtz):
        both = (decisions[name] for name in ('inertia', 'helmholtz'))
        inertia, lateral = (item.value / item.effect.threshold for item in both)
        forced['inertia'] = inertia > lateral
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
            vents.append(replace(
                vent,
                position=tuple(moved + vent.position),
                end=vent.end and tuple(moved + vent.end),
                discharge=series[0][1] if isinstance(vent.discharge, float) else series,
            ))
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
) -> tuple[int, int, float]:
    """Particles at the end, velocity evaluations and wall time [s] of a run up to ``horizon`` [s].

    Kernels are compiled beforehand.
    """
    accuracy = resolved_accuracy(accuracy, scene, horizon=horizon)
    warm, simulation = (
        Simulation(scene, effects=effects, accuracy=accuracy, device=device) for _ in range(2)
    )
    warm.advance(1e-3)
    seconds = timed(device, lambda: simulation.advance(horizon))
    return simulation.particle_count, simulation.snapshot().steps.evaluations, seconds


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
    device: str, *, preset: str, runs: int, on_progress: OnProgress
) -> Iterator[dict[str, Any]]:
    """Compare the chosen effects with all effects on every scene, over ``runs`` runs each."""
    items = scenes()
    for index, item in enumerate(items):
        on_progress(item.name, index / len(items))
        yield compare(item, device=device, preset=preset, runs=runs)


def compare(item: BenchScene, *, device: str, preset: str, runs: int) -> dict[str, Any]:
    """Compare runs of a scene with the chosen effects (``auto``) and with all effects."""
    common: dict[str, Any] = {'accuracy': preset_accuracy(preset), 'horizon': item.horizon}
    auto, full = effects_for(item.scene, **common), everything(item.scene, **common)
    common['device'] = device
    cost_auto, cost_all = (cost(item.scene, effects, **common) for effects in (auto, full))
    chosen, complete = (covered(item.scene, runs, effects, **common) for effects in (auto, full))
    return {
        'scene': item.name,
        'effects_auto': ' '.join(auto),
        'effects_all': ' '.join(full),
        'runs': runs,
        # of the majority footprints
        'jaccard': jaccard(footprint(chosen), footprint(complete)),
        'noise_auto': noise(chosen),
        'noise_all': noise(complete),
        # mean over pairs of a run with the chosen effects and one with all, from the same vents
        'single': float(np.mean([jaccard(*pair) for pair in zip(chosen, complete, strict=True)])),
        'seconds_auto': cost_auto[2],
        'seconds_all': cost_all[2],
        'particles': cost_auto[0],
        'evaluations_auto': cost_auto[1],
        'evaluations_all': cost_all[1],
        # of the majority footprint with all effects
        'cells': int(np.count_nonzero(footprint(complete))),
        'simulated_s': item.horizon,
    }
