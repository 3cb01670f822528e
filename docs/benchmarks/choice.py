# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare the effects that are chosen for scenes with more effects.

    python docs/benchmarks/choice.py choice_cpu.csv --preset fine --runs 6 --particles 500

For every effect that exists in a scene and is off to the end of the run, a row compares the run
with one in which this effect is forced on. A last row compares it with all effects. If the effect
excludes another one that is on, both runs are without that one.

Inundated areas are compared in parts of cells. Where a flow branches, the random positions of its
particles decide. Each footprint is therefore that of many runs, rotated and mirrored, with vents
moved by parts of a cell, and contains the area that most of them inundate. The runs are simulated
side by side, each on its own copy of the terrain with cells without data between them: particles
of different runs are never neighbours, and all runs take the shortest of their steps. The
insignificant part of a difference is measured too: one half of the runs against the other half,
which differ by a factor of sqrt(2) more than two sets of all runs do. The time is that of a
separate run.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
import math
from pathlib import Path
import shlex
import sys
import time as wall_clock
from typing import Any

from bench_scenes import BenchScene, scenes
import numpy as np

from lava_ros.effects import compatible, Effects, excluded_by
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy, COVERED
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import Decision
from lava_ros.verification.benchmarks.effects import timed
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Shift of the vents from one run to the next, in cells, along x and along y.
SHIFT = 0.01

#: Relative increase of their discharge: on a plane a shifted flow is the same flow, and one that
#: is rotated by half a turn nearly so.
GAIN = 5e-4

#: Thickness above which a cell counts as covered, as a fraction of that of the flow, if it is less
#: than ``COVERED``.
THIN = 0.2

#: Parts of a cell, along a side, that a footprint distinguishes: otherwise a front along a row of
#: cells would cover all of them or none.
PARTS = 4

#: Cells without data between two copies of a terrain.
GAP = 16

#: Name of the row with all effects.
ALL = 'all'

#: Effects of a run: all of them, or some by name that override the choice.
Switches = Effects | Mapping[str, bool]


@dataclass(frozen=True, eq=False)
class Runs:
    """Results of runs of a scene side by side.

    Attributes:
        cells: The parts of cells (``PARTS``) that lava covers in each run at the end, bool, shape
            [runs, rows, columns].
        thickness: Mean thickness of each run at the end, weighted by volume [m], shape [runs].
        effects: The effects that were on at the end.
        decisions: The decision about each effect.
    """

    cells: np.ndarray
    thickness: np.ndarray
    effects: Effects
    decisions: tuple[Decision, ...]


def left_off(decisions: Sequence[Decision]) -> list[Decision]:
    """Return the decisions about effects that a scene has and that are off by their numbers."""
    return [
        item for item in decisions
        if not (item.is_on or math.isnan(item.value) or math.isinf(item.effect.threshold))
        # lava of another kind has nothing of an effect that is limited to one
        and (item.largest or not item.effect.kind)
    ]


def left_on(decisions: Sequence[Decision]) -> list[Decision]:
    """Return the decisions about effects that are on by their numbers and could be off."""
    return [
        item for item in decisions if item.is_on and math.isfinite(item.largest)
        and item.effect.threshold > 0.0
    ]


def everything(decisions: Sequence[Decision]) -> dict[str, bool]:
    """Return switches that force on every effect that the scene has, as far as compatible.

    Of effects that exclude each other the one that is on is kept; if neither is on, the one whose
    number is closer to its threshold.
    """
    found = [
        item for item in decisions
        if not (math.isnan(item.value) or math.isinf(item.effect.threshold))
    ]
    found.sort(key=lambda item: (item.is_on, item.largest / (item.effect.threshold or 1e-9)))
    on = compatible(item.name for item in reversed(found))
    return {item.name: item.name in on for item in decisions}


def directions(count: int) -> list[tuple[int, int]]:
    """Return signs of x and y of each run: as is, mirrored in x, rotated, mirrored in y."""
    return [((1, 1), (-1, 1), (-1, -1), (1, -1))[number % 4] for number in range(count)]


def copies(scene: Scene, count: int, shift: float = SHIFT) -> Scene:
    """Return ``count`` copies of a scene, side by side.

    Each is rotated or mirrored (``directions``) about the middle of its terrain. Its vents are
    moved ``shift`` cells further along x and y than those of the previous one, with a discharge
    larger by ``GAIN``.
    """
    terrain = scene.terrain
    rows, columns = (side + GAP for side in terrain.elevation.shape)
    width = math.ceil(math.sqrt(count * rows / columns))
    height = math.ceil(count / width)
    elevation = np.full((height * rows, width * columns), np.nan, dtype=np.float32)
    middle = np.reshape(terrain.extent, (2, 2)).mean(axis=0)
    vents: list[Vent] = []
    for number, (x, y) in enumerate(directions(count)):
        row, column = rows * (number // width), columns * (number % width)
        tile = elevation[row : row + rows - GAP, column : column + columns - GAP]
        tile[:] = terrain.elevation[::y, ::x]
        moved = (np.array([column, row]) + shift * number) * terrain.resolution + middle
        gain = 1.0 + GAIN * number
        for vent in scene.vents:
            ends = np.array([vent.position, vent.end or vent.position])
            (start_x, start_y), (end_x, end_y) = (moved + (x, y) * (ends - middle)).tolist()
            series = tuple((time, gain * flux) for time, flux in vent.series)
            vents.append(replace(
                vent,
                position=(start_x, start_y),
                end=vent.end and (end_x, end_y),
                discharge=series[0][1] if isinstance(vent.discharge, float) else series,
            ))
    wide = Terrain(elevation, terrain.resolution, terrain.origin)
    return replace(scene, terrain=wide, vents=tuple(vents))


def run_copies(
    scene: Scene, count: int, switches: Switches, *, accuracy: Accuracy, horizon: float,
    device: str, duration: float | None = None,
) -> Runs:
    """Run a scene many times, side by side.

    Args:
        scene: The scene.
        count: Number of runs.
        switches: The effects; effects that a mapping does not name are chosen.
        accuracy: The resolution.
        horizon: Assumed horizon [s].
        device: Name of the Warp device.
        duration: Simulated time [s], by default the horizon.
    """
    accuracy = resolved_accuracy(accuracy, scene, horizon=horizon)
    wide = copies(scene, count)
    simulation = Simulation(
        wide, effects=switches, accuracy=accuracy, device=device, horizon=horizon
    )
    simulation.advance(horizon if duration is None else duration)
    assert accuracy.thickness is not None
    thickness = np.nan_to_num(simulation.snapshot().thickness)
    rows, columns = (side + GAP for side in scene.terrain.elevation.shape)
    tiles = thickness.reshape(-1, rows, thickness.shape[1] // columns, columns)
    each = tiles.swapaxes(1, 2).reshape(-1, rows, columns)[:, : rows - GAP, : columns - GAP]
    least = min(COVERED, THIN * accuracy.thickness)
    covered = [
        refined(tile[::y, ::x]) > least
        for tile, (x, y) in zip(each, directions(count), strict=False)
    ]
    mean = (each**2).sum(axis=(1, 2)) / each.sum(axis=(1, 2))
    return Runs(np.array(covered), mean[:count], simulation.effects, simulation.decisions())


def refined(values: np.ndarray) -> np.ndarray:
    """Interpolate a map of cells at the parts of each cell, linear in both directions."""
    for axis in (0, 1):
        count = values.shape[axis]
        place = np.clip((np.arange(PARTS * count) + 0.5) / PARTS - 0.5, 0.0, count - 1.0)
        first = np.minimum(place.astype(int), max(count - 2, 0))
        second = np.minimum(first + 1, count - 1)
        part = np.expand_dims(place - first, 1 - axis)
        values = (1.0 - part) * values.take(first, axis) + part * values.take(second, axis)
    return values


def cost(
    scene: Scene, switches: Switches, *, accuracy: Accuracy, horizon: float, device: str,
    duration: float | None = None,
) -> tuple[int, int, float]:
    """Return particles at the end, velocity evaluations and time [s] of a run (``run_copies``).

    Kernels are compiled beforehand. The time is wall time on a GPU and processor time on a CPU,
    which other programs hardly affect.
    """
    accuracy = resolved_accuracy(accuracy, scene, horizon=horizon)
    warm, simulation = (
        Simulation(scene, effects=switches, accuracy=accuracy, device=device, horizon=horizon)
        for _ in range(2)
    )
    warm.advance(1e-3)
    end = horizon if duration is None else duration
    start = wall_clock.process_time()
    seconds = timed(device, lambda: simulation.advance(end))
    if device == 'cpu':
        seconds = wall_clock.process_time() - start
    return simulation.particle_count, simulation.snapshot().steps.evaluations, seconds


def jaccard(one: np.ndarray, other: np.ndarray) -> float:
    """Return cells in both over cells in either; NaN, which no bound admits, if there are none."""
    either = np.count_nonzero(one | other)
    return np.count_nonzero(one & other) / either if either else math.nan


def footprint(runs: np.ndarray) -> np.ndarray:
    """Return the cells that lava covers in most of the runs [runs, rows, columns]."""
    return runs.mean(axis=0) > 0.5


def noise(runs: np.ndarray) -> float:
    """Return the agreement of the footprints of odd and even runs."""
    return jaccard(footprint(runs[::2]), footprint(runs[1::2]))


def accuracy_with(item: BenchScene, preset: str, particles: int | None) -> Accuracy:
    """Resolve a preset in a scene, limited to a number of particles."""
    accuracy = resolved_accuracy(preset_accuracy(preset), item.scene, horizon=item.horizon)
    assert accuracy.spacing is not None and accuracy.thickness is not None
    emitted = sum(vent.volume_between(0.0, item.duration) for vent in item.scene.vents)
    least = math.sqrt(emitted / (accuracy.thickness * particles)) if particles else 0.0
    return replace(accuracy, spacing=max(accuracy.spacing, least))


def front(cells: np.ndarray, scene: Scene) -> float:
    """Return the distance [m] of the farthest covered part of a cell from the first vent."""
    row, column = np.nonzero(cells)
    terrain = scene.terrain
    places = (np.column_stack([column, row]) + 0.5) * (terrain.resolution / PARTS)
    places += terrain.origin
    return float(np.hypot(*(places - scene.vents[0].position).T).max(initial=0.0))


def compare(
    item: BenchScene, *, device: str, preset: str, runs: int, particles: int | None = None
) -> Iterator[dict[str, Any]]:
    """Compare runs with the chosen effects with each effect that is off, and with all of them.

    Args:
        item: The scene.
        device: Name of the Warp device.
        preset: Name of the resolution.
        runs: Number of runs of a footprint.
        particles: Maximum number of particles of a run, which makes a finer preset coarser.

    Yields:
        A row for each effect that is off to the end, and one with all effects.
    """
    common: dict[str, Any] = {
        'accuracy': accuracy_with(item, preset, particles),
        'horizon': item.horizon,
        'device': device,
        'duration': item.duration,
    }
    seconds: dict[frozenset[tuple[str, bool]], tuple[int, int, float]] = {}
    bases: dict[frozenset[tuple[str, bool]], Runs] = {}

    def base(switches: dict[str, bool]) -> tuple[Runs, tuple[int, int, float]]:
        key = frozenset(switches.items())
        if key not in bases:
            bases[key] = run_copies(item.scene, runs, switches, **common)
            seconds[key] = cost(item.scene, switches, **common)
        return bases[key], seconds[key]

    chosen, _ = base({})
    off = left_off(chosen.decisions)
    for name in (decision.name for decision in off):
        # both without the excluded effects: the difference is then due to this effect alone
        without = {other: False for other in chosen.effects if excluded_by(other, name)}
        one, time = base(without)
        (decision,) = (each for each in one.decisions if each.name == name)
        if decision.is_on:
            # it is only off because the excluded one is on
            continue
        switches = {**without, decision.name: True}
        other = run_copies(item.scene, runs, switches, **common)
        yield {
            'scene': item.name,
            'effect': decision.name,
            'on': False,
            'expected': decision.value,
            'measured': decision.measured,
            'threshold': decision.effect.threshold,
            'stated': decision.cost,
            'thickness_stated': decision.thickness_cost,
            **_difference(item.scene, one, other),
            **_times(time, cost(item.scene, switches, **common)),
            'chosen': ' '.join(one.effects),
            'runs': runs,
            'simulated_s': item.duration,
        }
    for decision in left_on(chosen.decisions):
        switches = {decision.name: False}
        other = run_copies(item.scene, runs, switches, **common)
        one, time = base({})
        yield {
            'scene': item.name,
            'effect': decision.name,
            'on': True,
            'expected': decision.value,
            'measured': decision.measured,
            'threshold': decision.effect.threshold,
            'stated': 0.0,
            'thickness_stated': 0.0,
            **_difference(item.scene, one, other),
            **_times(time, cost(item.scene, switches, **common)),
            'chosen': ' '.join(one.effects),
            'runs': runs,
            'simulated_s': item.duration,
        }
    switches = everything(chosen.decisions)
    complete = run_copies(item.scene, runs, switches, **common)
    one, time = base({})
    yield {
        'scene': item.name,
        'effect': ALL,
        'on': False,
        'expected': math.nan,
        'measured': math.nan,
        'threshold': math.nan,
        'stated': sum(decision.cost for decision in off if switches[decision.name]),
        'thickness_stated': sum(
            decision.thickness_cost for decision in off if switches[decision.name]
        ),
        **_difference(item.scene, one, complete),
        **_times(time, cost(item.scene, switches, **common)),
        'chosen': ' '.join(one.effects),
        'runs': runs,
        'simulated_s': item.duration,
    }


def _difference(scene: Scene, one: Runs, other: Runs) -> dict[str, float]:
    """Compare the majority footprints and fronts of runs with one choice and with another.

    ``chance`` is that of the choice whose halves agree less.
    """
    fronts = [front(footprint(each.cells), scene) for each in (one, other)]
    return {
        'changed': 1.0 - jaccard(footprint(one.cells), footprint(other.cells)),
        'chance': 1.0 - min(noise(one.cells), noise(other.cells)),
        'thickness_changed': abs(other.thickness.mean() / one.thickness.mean() - 1.0),
        'thickness_chance': 2.0 * math.hypot(*(
            each.thickness.std(ddof=1) / each.thickness.mean() for each in (one, other)
        )) / math.sqrt(len(one.thickness)),
        'front_m': fronts[0],
        'front_changed': abs(fronts[1] / fronts[0] - 1.0) if fronts[0] else math.nan,
        # area of the majority footprint with the chosen effects
        'area_m2': np.count_nonzero(footprint(one.cells)) * (scene.terrain.resolution / PARTS)**2,
    }


def _times(one: tuple[int, int, float], other: tuple[int, int, float]) -> dict[str, float]:
    """Compare the cost of a run with the chosen effects with that of another."""
    return {
        'particles': one[0],
        'evaluations': one[1],
        'seconds': one[2],
        'seconds_with': other[2],
    }


def main() -> None:
    """Compare every scene, and write the rows so far after each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--device', default='cpu')
    parser.add_argument('--preset', default=DEFAULT)
    parser.add_argument('--runs', type=int, default=24, help='number of runs of a footprint')
    parser.add_argument('--particles', type=int, help='largest number of particles of a run')
    parser.add_argument('--scene', action='append', help='name of a scene (default: all)')
    args = parser.parse_args()
    origin = {
        'device': args.device,
        'machine': machine_name(args.device),
        'command': f'python {shlex.join(sys.argv)}',
    }
    rows: list[dict[str, Any]] = []
    for item in scenes():
        if args.scene and item.name not in args.scene:
            continue
        for row in compare(
            item, device=args.device, preset=args.preset, runs=args.runs, particles=args.particles
        ):
            rows.append({**row, **origin})
        write_csv(rows, args.output)
        print(item.name, flush=True)


if __name__ == '__main__':
    main()
