# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare the numerical error that partner runs state with the actual error.

    python docs/benchmarks/numerical_error.py numerical_error.csv --folder RUNS --workers 16

The actual error is the difference from a run with particles much closer together on ground that is
sampled on cells a quarter of the size. All runs have the effects and the thickness scale of the
first one. Areas are compared on cells of a quarter of the size (subdivide_ground): the error is
that of the lava, not that of counting cells. The folder keeps the areas of the runs, so that an
interrupted command continues.
"""

import argparse
from collections.abc import Iterable, Iterator
from concurrent.futures import as_completed, ProcessPoolExecutor
from dataclasses import replace
import functools
import math
import multiprocessing
from pathlib import Path
import time
from typing import Any

from bench_scenes import BenchScene
from error_scenes import error_scenes
import numpy as np

from lava_ros.effects import Effects
from lava_ros.scene import Terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.backend.threads import use_threads
from lava_ros.simulation.numerical_error import (
    Areas,
    COARSER,
    difference,
    error_of,
    GROUND_ORDER,
    NumericalError,
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


#: A run: name of the scene, name of the run, its spacing [m] and its ground.
Job = tuple[str, str, float, str]


class Runs:
    """The runs of a scene, each kept in a file."""

    def __init__(self, item: BenchScene, folder: Path) -> None:
        """Choose spacing and effects."""
        self.item, self.folder = item, folder / item.name
        self.folder.mkdir(parents=True, exist_ok=True)
        draft = preset_accuracy('draft')
        self.expected = resolution_of(item.scene, draft, horizon=item.horizon)
        self.spacing = float(f'{self.expected.width / ACROSS:.3g}')
        self._effects = effects_for(
            item.scene, accuracy=replace(draft, spacing=self.spacing), horizon=item.horizon
        )

    def first(self) -> Job:
        """Return the run on whose number of particles the others depend."""
        return self.item.name, 'D_A', self.spacing, 'c'

    def levels(self) -> tuple[dict[str, float], str, float]:
        """Return the spacings [m], and name and spacing [m] of the reference."""
        _, _, particles = self.read('D_A')
        names, closer = SLOW.get(self.item.name, ('DSR' if particles <= FEW else 'DS', CLOSE))
        reference = 'T_f'
        if 'R' in names:
            closer, reference = CLOSEST, 'U_f'
        levels = {name: self.spacing * LEVELS[name] for name in names}
        return levels, reference, self.spacing / closer

    def jobs(self) -> Iterator[Job]:
        """Yield all runs, the longest first."""
        name = self.item.name
        levels, reference, finest = self.levels()
        yield name, reference, finest, 'f'
        for level, distance in sorted(levels.items(), key=lambda item: item[1]):
            yield name, f'{level}_A', distance, 'c'
            yield name, f'{level}_B', COARSER * distance, 'c'
            yield name, f'{level}_C', COARSER * distance, '2c'

    def _ground(self, name: str) -> Terrain:
        """Return the ground of the cells (c), of cells twice as large (2c), or the finest (f)."""
        if name == 'f':
            return next(
                item for item in error_scenes(PARTS) if item.name == self.item.name
            ).scene.terrain
        given = self.item.scene.terrain
        if name == '2c':
            coarse = coarsen_ground(given)
            assert coarse is not None
            given = coarse
        return _quarters(given)

    def read(self, name: str) -> tuple[Areas, float, int]:
        """Return the areas, the CPU time [s] and the particles of a run."""
        with np.load(self.folder / f'{name}.npz') as file:
            shape = tuple(file['shape'])
            areas = Areas(*(
                np.unpackbits(file[area])[: math.prod(shape)].reshape(shape).astype(bool)
                for area in Areas._fields
            ))
            return areas, float(file['cpu']), int(file['n'])

    def make(self, name: str, spacing: float, ground: str) -> None:
        """Make a run, unless its file exists."""
        path = self.folder / f'{name}.npz'
        if not path.exists():
            self._make(path, spacing, self._ground(ground))

    def _make(self, path: Path, spacing: float, terrain: Terrain) -> None:
        item, accuracy = self.item, preset_accuracy('draft', spacing=spacing)
        # steps as long as on the cells of the scene
        radius, cell = accuracy.ratio * spacing, item.scene.terrain.resolution
        longer = min(radius, cell) / min(radius, cell / PARTS)
        accuracy = replace(
            accuracy, thickness=self.expected.thickness,
            courant_number=min(longer * accuracy.courant_number, 2.0),
        )
        scene = replace(item.scene, terrain=terrain)

        def begin() -> Simulation:
            return Simulation(
                scene, effects=self._effects, accuracy=accuracy, device='cpu',
                horizon=item.horizon,
            )

        # compiles the kernels
        begin().advance(1e-3)
        begun = time.process_time()
        simulation = begin()
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


def cut(areas: Areas, like: Areas) -> Areas:
    """Return areas on the cells of others, which may be fewer at the far sides."""
    rows, columns = like.inundated.shape
    return Areas(*(cells[:rows, :columns] for cells in areas))


@functools.cache
def runs_of(name: str, folder: Path) -> Runs:
    """Return the runs of a scene."""
    return Runs(next(item for item in error_scenes() if item.name == name), folder)


def make(job: Job, folder: Path) -> Job:
    """Make a run on one thread."""
    use_threads(1)
    name, *run = job
    runs_of(name, folder).make(*run)
    return job


def stated_error(
    runs: Runs, level: str, spacing: float
) -> tuple[NumericalError, tuple[Areas, float, int], float]:
    """Return the stated error of a run, its results, and the CPU time of its partners [s]."""
    one = runs.read(f'{level}_A')
    two, more, _ = runs.read(f'{level}_B')
    three, most, _ = runs.read(f'{level}_C')
    pairs = {
        'particles': Pair(one[0], two, richardson(COARSER, PARTICLE_ORDER)),
        'ground': Pair(two, three, richardson(2.0, GROUND_ORDER)),
    }
    cell = runs.item.scene.terrain.resolution
    error = error_of(pairs, spacing=spacing, cell=cell, time=runs.item.duration)
    return error, one, more + most


def compare(name: str, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each spacing of a scene, from runs that are made."""
    runs = runs_of(name, folder)
    item = runs.item
    levels, reference, finest = runs.levels()
    best, best_seconds, _ = runs.read(reference)
    for level, distance in levels.items():
        stated, (one, seconds, count), partners = stated_error(runs, level, distance)
        row = {
            'scene': item.name,
            'spacing_m': distance,
            'across': runs.expected.width / distance,
            'particles': count,
            'cell_m': item.scene.terrain.resolution,
        }
        for name, area, other in zip(Areas._fields, one, cut(best, one), strict=True):
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
            'reference_spacing_m': finest,
            'reference_cpu_s': best_seconds,
            'cpu_s': seconds,
            'partners_cpu_s': partners,
            'effects': ' '.join(runs.effects),
        }


def make_all(jobs: Iterable[Job], folder: Path, pool: ProcessPoolExecutor) -> None:
    """Make runs in the processes of a pool."""
    for future in as_completed([pool.submit(make, job, folder) for job in jobs]):
        name, run, *_ = future.result()
        print(name, run, flush=True)


def main() -> None:
    """Compare all scenes, and write the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--folder', type=Path, required=True, help='folder of the areas')
    parser.add_argument('--scene', action='append', help='name of a scene (default: all)')
    parser.add_argument('--workers', type=int, default=1, help='number of processes')
    args = parser.parse_args()
    names = [item.name for item in error_scenes() if not args.scene or item.name in args.scene]
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(args.workers, mp_context=context) as pool:
        make_all([runs_of(name, args.folder).first() for name in names], args.folder, pool)
        jobs = [job for name in names for job in runs_of(name, args.folder).jobs()]
        # references last as long as all others together
        jobs.sort(key=lambda job: job[3] != 'f')
        make_all(jobs, args.folder, pool)
    rows = [row for name in names for row in compare(name, args.folder)]
    write_csv([{**row, 'machine': machine_name('cpu')} for row in rows], args.output)


if __name__ == '__main__':
    main()
