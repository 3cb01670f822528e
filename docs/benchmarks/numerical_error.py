# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare the numerical error that partner runs state with the actual error.

    python docs/benchmarks/numerical_error.py numerical_error.csv --folder RUNS

The actual error is the difference from a run with particles much closer together on ground that is
sampled on cells a quarter of the size. All runs have the effects and the thickness scale of the
first one. Areas are compared on cells of a quarter of the size (subdivide_ground): the error is
that of the lava, not that of counting cells. The folder keeps the areas of the runs, so that an
interrupted command continues.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
import math
from pathlib import Path
import time
from typing import Any

from bench_scenes import BenchScene
from error_scenes import error_scenes
import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.numerical_error import (
    Areas,
    COARSER,
    difference,
    error_of,
    GROUND_ORDER,
    Pair,
    PARTICLE_ORDER,
    richardson,
)
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.resolution import resolution_of
from lava_ros.simulation.selection import effects_for
from lava_ros.simulation.setup.coarse_ground import coarsen_ground, subdivide_ground
from lava_ros.verification.measure import machine_name
from lava_ros.verification.rows import write_csv

#: Number of halvings of the cells on which areas are compared.
HALVINGS = 2
PARTS = 2**HALVINGS

#: Particles across the flow, and spacing of the runs over that of this number.
ACROSS, LEVELS = 11.0, {'Q': 1.6, 'D': 1.0, 'S': 1.0 / 1.6, 'R': 1.0 / 2.5}

#: Number of particles of a run below which its reference, and one more run, are finer.
FEW = 600

#: Spacing of a run over that of its reference, also for runs with few particles.
CLOSE, CLOSEST = 3.2, 8.0

#: Runs of slow scenes, and the same for them.
SLOW = {
    'lobe': ('DS', 3.2), 'oblique_valley': ('Q', 2.4), 'rough_5m': ('Q', 2.0),
    'rough_10m': ('Q', 2.0),
}


class Runs:
    """The runs of a scene, each kept in a file."""

    def __init__(self, item: BenchScene, finest: Terrain, folder: Path) -> None:
        """Choose spacing and effects; ``finest`` is the same ground on quarter cells."""
        self.item, self.folder = item, folder / item.name
        self.folder.mkdir(parents=True, exist_ok=True)
        draft = preset_accuracy('draft')
        self.expected = resolution_of(item.scene, draft, horizon=item.horizon)
        self.spacing = float(f'{self.expected.width / ACROSS:.3g}')
        self._effects = effects_for(
            item.scene, accuracy=replace(draft, spacing=self.spacing), horizon=item.horizon
        )
        given = item.scene.terrain
        coarse = coarsen_ground(given)
        assert coarse is not None
        self._grounds = {'c': _quarters(given), '2c': _quarters(coarse), 'f': finest}

    def run(self, name: str, spacing: float, ground: str) -> tuple[Areas, float, int]:
        """Return the areas, the CPU time [s] and the particles of a run, made or read."""
        path = self.folder / f'{name}.npz'
        if not path.exists():
            self._make(path, spacing, self._grounds[ground])
        with np.load(path) as file:
            shape = tuple(file['shape'])
            areas = Areas(*(
                np.unpackbits(file[area])[: math.prod(shape)].reshape(shape).astype(bool)
                for area in Areas._fields
            ))
            return areas, float(file['cpu']), int(file['n'])

    def _make(self, path: Path, spacing: float, terrain: Terrain) -> None:
        item, accuracy = self.item, preset_accuracy('draft', spacing=spacing)
        # steps as long as on the cells of the scene
        radius, cell = accuracy.ratio * spacing, item.scene.terrain.resolution
        longer = min(radius, cell) / min(radius, cell / PARTS)
        accuracy = replace(
            accuracy, thickness=self.expected.thickness,
            courant_number=min(longer * accuracy.courant_number, 2.0),
        )
        begun = time.process_time()
        simulation = Simulation(
            replace(item.scene, terrain=terrain), effects=self._effects, accuracy=accuracy,
            device='cpu', horizon=item.horizon,
        )
        simulation.advance(item.duration)
        snapshot = simulation.snapshot()
        areas = Areas(*(cells >= 0.5 for cells in Areas.of(snapshot)))
        np.savez_compressed(
            path, shape=areas.inundated.shape, cpu=time.process_time() - begun,
            n=snapshot.particle_count, d=spacing,
            **{name: np.packbits(cells) for name, cells in areas._asdict().items()},
        )

    @property
    def effects(self) -> Effects:
        """Effects of all runs."""
        return self._effects


def _quarters(terrain: Terrain) -> Terrain:
    for _ in range(HALVINGS):
        terrain = subdivide_ground(terrain)
    return terrain


def _cut(areas: Areas, like: Areas) -> Areas:
    """Return areas on the cells of others, which may be fewer at the far sides."""
    rows, columns = like.inundated.shape
    return Areas(*(cells[:rows, :columns] for cells in areas))


def compare(item: BenchScene, finest: Terrain, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each spacing of a scene."""
    runs = Runs(item, finest, folder)
    spacing, (_, _, particles) = runs.spacing, runs.run('D_A', runs.spacing, 'c')
    names, closer = SLOW.get(item.name, ('DSR' if particles <= FEW else 'DS', CLOSE))
    reference = 'T_f'
    if 'R' in names:
        closer, reference = CLOSEST, 'U_f'
    levels = {name: spacing * LEVELS[name] for name in names}
    best, _, _ = runs.run(reference, spacing / closer, 'f')
    for level, distance in levels.items():
        one, seconds, count = runs.run(f'{level}_A', distance, 'c')
        two, more, _ = runs.run(f'{level}_B', COARSER * distance, 'c')
        three, most, _ = runs.run(f'{level}_C', COARSER * distance, '2c')
        stated = error_of(
            {
                'particles': Pair(one, two, richardson(COARSER, PARTICLE_ORDER)),
                'ground': Pair(two, three, richardson(2.0, GROUND_ORDER)),
            },
            spacing=distance, cell=item.scene.terrain.resolution, time=item.duration,
        )
        row = {
            'scene': item.name,
            'spacing_m': distance,
            'across': runs.expected.width / distance,
            'particles': count,
            'cell_m': item.scene.terrain.resolution,
        }
        for name, area, other in zip(Areas._fields, one, _cut(best, one), strict=True):
            part = getattr(stated, name)
            actual = difference(area, other)
            row |= {
                f'{name}_particles': part.particles,
                f'{name}_ground': part.ground,
                f'{name}_stated': part.total,
                f'{name}_actual': actual,
                f'{name}_ratio': part.total / actual,
            }
        yield row | {
            'reference_spacing_m': spacing / closer,
            'cpu_s': seconds,
            'partners_cpu_s': more + most,
            'effects': ' '.join(runs.effects),
        }


def main() -> None:
    """Compare all scenes, and write the rows so far after each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--folder', type=Path, required=True, help='folder of the areas')
    parser.add_argument('--scene', action='append', help='name of a scene (default: all)')
    args = parser.parse_args()
    finest = {item.name: item.scene.terrain for item in error_scenes(PARTS)}
    rows: list[dict[str, Any]] = []
    for item in error_scenes():
        if args.scene and item.name not in args.scene:
            continue
        for row in compare(item, finest[item.name], args.folder):
            rows.append({**row, 'machine': machine_name('cpu')})
        write_csv(rows, args.output)
        print(item.name, flush=True)


if __name__ == '__main__':
    main()
