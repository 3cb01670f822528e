# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare the numerical error that partner runs state with the actual error.

    python docs/benchmarks/numerical_error.py numerical_error.csv --folder RUNS --workers 16

The actual error is the difference from a run with particles much closer together on ground that is
sampled on cells a quarter of the size. All runs have the effects and the thickness scale of the
first one. Their areas are compared on cells of a quarter of the size (subdivide_ground): the error
is that of the lava, not that of counting cells. Runs, their partner runs, and runs on cells are on
the cells of the scene, as those of a command; ``coarser`` is the error by larger particles where
the partner is on cells. The folder keeps the areas of the runs, so that an interrupted command
continues. CPU times are the shortest of some repetitions.
"""

import argparse
from collections.abc import Iterable, Iterator
from concurrent.futures import as_completed, ProcessPoolExecutor
from dataclasses import replace
import functools
import multiprocessing
import os
from pathlib import Path
import time
from typing import Any, NamedTuple

from bench_scenes import BenchScene
from error_scenes import error_scenes
import numpy as np

from lava_ros.effects import Effects
from lava_ros.forecast.partner_runs import coarser_partner_of, partner_of
from lava_ros.scene import Terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.threads import use_threads
from lava_ros.simulation.method import reason_against_cells
from lava_ros.simulation.numerical_error import (
    Areas,
    difference,
    error_of,
    GROUND_ORDER,
    NumericalError,
    Pair,
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


#: Sizes of the cells of runs whose error is compared, over those of the terrain.
SIZES = 0.5, 1.0, 2.0

#: Maximum CPU time of the repetitions of a run [s], and their maximum number.
REPEATED, MAX_REPETITIONS = 2.0, 5


class Job(NamedTuple):
    """A run.

    Attributes:
        scene: Name of the scene.
        run: Name of the run.
        spacing: Particle spacing, or size of the cells [m].
        ground: That of the scene's cells (``own``), of cells twice as large (``coarser``), as
            ``own`` on cells of a quarter (``quarters``), or sampled on them (``finest``).
        method: Carriers of the lava.
    """

    scene: str
    run: str
    spacing: float
    ground: str = 'own'
    method: str = 'particles'


class Run(NamedTuple):
    """Areas, CPU time [s] and number of particles or cells of a run."""

    areas: Areas
    cpu: float
    count: int


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
        return Job(self.item.name, 'D_A', self.spacing, 'quarters')

    def levels(self) -> tuple[dict[str, float], str, float]:
        """Return the spacings [m], and name and spacing [m] of the reference."""
        particles = self.read('D_A').count
        names, closer = SLOW.get(self.item.name, ('DSR' if particles <= FEW else 'DS', CLOSE))
        reference = 'T_f'
        if 'R' in names:
            closer, reference = CLOSEST, 'U_f'
        levels = {name: self.spacing * LEVELS[name] for name in names}
        return levels, reference, self.spacing / closer

    def jobs(self) -> Iterator[Job]:
        """Yield all runs, the longest first."""
        levels, reference, finest = self.levels()
        yield Job(self.item.name, reference, finest, 'finest')
        for level, distance in sorted(levels.items(), key=lambda item: item[1]):
            yield from self.jobs_at(level, distance)
        cell = self.item.scene.terrain.resolution
        for size in SIZES if not reason_against_cells(self._effects) else ():
            yield from self._of_run(self._accuracy(size * cell, 'cells'))

    def jobs_at(self, tag: str, spacing: float) -> Iterator[Job]:
        """Yield a run with particles, its partner runs, and coarser ones, by the tag."""
        yield Job(self.item.name, f'{tag}_A', spacing, 'quarters')
        yield from self._of_run(self._accuracy(spacing))
        yield from self._partners(coarser_partner_of(self._accuracy(spacing))[0])

    def _of_run(self, accuracy: Accuracy) -> Iterator[Job]:
        """Yield a run on the cells of the scene, and its partner runs."""
        yield next(self._partners(accuracy))
        partner, _ = partner_of(self.item.scene, accuracy, self._effects)
        yield from self._partners(partner)

    def _partners(self, accuracy: Accuracy) -> Iterator[Job]:
        """Yield the runs of an accuracy on the ground of the scene, and on coarser ground."""
        assert accuracy.spacing is not None
        for ground in ('own', 'coarser'):
            name = f'{accuracy.method}_{accuracy.spacing:.5g}_{ground}'
            yield Job(self.item.name, name, accuracy.spacing, ground, accuracy.method)

    def _accuracy(self, spacing: float, method: str = 'particles') -> Accuracy:
        return replace(
            preset_accuracy('draft', spacing=spacing), method=method,
            thickness=self.expected.thickness,
        )

    def stated(
        self, spacing: float, method: str = 'particles', *, is_coarser: bool = False
    ) -> tuple[NumericalError, float, float]:
        """Return the error by partner runs, and the CPU times of the run and of those [s].

        ``is_coarser`` takes coarser particles as the partner also where cells are.
        """
        accuracy = self._accuracy(spacing, method)
        partner, reduction = (
            coarser_partner_of(accuracy) if is_coarser
            else partner_of(self.item.scene, accuracy, self._effects)
        )
        jobs = next(self._partners(accuracy)), *self._partners(partner)
        run, own, coarse = (self.read(job.run) for job in jobs)
        pairs = {
            'lava': Pair(run.areas, own.areas, reduction),
            'ground': Pair(own.areas, coarse.areas, richardson(2.0, GROUND_ORDER)),
        }
        error = error_of(
            pairs, spacing=spacing, cell=self.item.scene.terrain.resolution,
            time=self.item.duration, method=method,
        )
        return error, run.cpu, own.cpu + coarse.cpu

    def partner(self, spacing: float, method: str) -> str:
        """Return method and spacing [m] of the partner of a run."""
        accuracy = self._accuracy(spacing, method)
        partner, _ = partner_of(self.item.scene, accuracy, self._effects)
        return f'{partner.method} {partner.spacing:g}'

    def _ground(self, name: str) -> Terrain:
        if name == 'finest':
            return next(
                item for item in error_scenes(PARTS) if item.name == self.item.name
            ).scene.terrain
        given = self.item.scene.terrain
        if name == 'coarser':
            coarse = coarsen_ground(given)
            assert coarse is not None
            return coarse
        return _quarters(given) if name == 'quarters' else given

    def read(self, name: str) -> Run:
        """Return a run."""
        with np.load(self.folder / f'{name}.npz') as file:
            areas = Areas(*(file[area].astype(float) for area in Areas._fields))
            return Run(areas, float(file['cpu']), int(file['n']))

    def make(self, job: Job) -> None:
        """Make a run, unless its file exists."""
        path = self.folder / f'{job.run}.npz'
        if not path.exists():
            self._make(path, job)

    def _make(self, path: Path, job: Job) -> None:
        item, accuracy = self.item, self._accuracy(job.spacing, job.method)
        terrain, cell = self._ground(job.ground), item.scene.terrain.resolution
        # steps as long as on the cells of the scene
        longer = min(accuracy.radius, cell) / min(accuracy.radius, terrain.resolution)
        accuracy = replace(
            accuracy, courant_number=min(longer * accuracy.courant_number, 2.0)
        )
        scene = replace(item.scene, terrain=terrain)

        def begin() -> Simulation:
            return Simulation(
                scene, effects=self._effects, accuracy=accuracy, device='cpu',
                horizon=item.horizon,
            )

        # compiles the kernels
        begin().advance(1e-3)
        times: list[float] = []
        while not times or (sum(times) < REPEATED and len(times) < MAX_REPETITIONS):
            begun = time.process_time()
            simulation = begin()
            simulation.advance(item.duration)
            snapshot = simulation.snapshot()
            times.append(time.process_time() - begun)
        areas = Areas.of(snapshot)
        if terrain.resolution < cell:
            areas = Areas(*(cells >= 0.5 for cells in areas))
        # another process may read the file, or make the same run
        part = path.with_suffix(f'.{os.getpid()}.npz')
        np.savez_compressed(
            part, cpu=min(times), n=snapshot.particle_count, d=job.spacing,
            **{name: cells.astype(np.float16) for name, cells in areas._asdict().items()},
        )
        part.replace(path)

    @property
    def effects(self) -> Effects:
        """Effects of all runs."""
        return self._effects


def _quarters(terrain: Terrain) -> Terrain:
    for _ in range(HALVINGS):
        terrain = subdivide_ground(terrain)
    return terrain


def cut(areas: Areas, like: Areas) -> Areas:
    """Return areas on the cells of others, which may be larger, and fewer at the far sides."""
    rows, columns = like.inundated.shape
    ratio = max(round(areas.inundated.shape[0] / rows), 1)
    return Areas(*(
        cells[: ratio * rows, : ratio * columns].reshape(rows, ratio, columns, ratio).mean((1, 3))
        for cells in areas
    ))


@functools.cache
def runs_of(name: str, folder: Path) -> Runs:
    """Return the runs of a scene."""
    return Runs(next(item for item in error_scenes() if item.name == name), folder)


def make(job: Job, folder: Path) -> Job:
    """Make a run on one thread."""
    use_threads(1)
    runs_of(job.scene, folder).make(job)
    return job


def compare(name: str, folder: Path) -> Iterator[dict[str, Any]]:
    """Yield a row for each spacing of a scene, from runs that are made."""
    runs = runs_of(name, folder)
    item, cell = runs.item, runs.item.scene.terrain.resolution
    levels, reference, finest = runs.levels()
    best = runs.read(reference)
    compared = [('particles', distance, f'{level}_A') for level, distance in levels.items()]
    if not reason_against_cells(runs.effects):
        compared += [('cells', size * cell, f'cells_{size * cell:.5g}_own') for size in SIZES]
    for method, distance, own in compared:
        run = runs.read(own)
        stated, seconds, partners = runs.stated(distance, method)
        coarser, _, coarser_seconds = runs.stated(distance, method, is_coarser=True)
        row = {
            'scene': item.name,
            'method': method,
            'spacing_m': distance,
            'across': runs.expected.width / distance,
            'carriers': run.count,
            'cell_m': cell,
            'partner': runs.partner(distance, method),
        }
        for area, one, other in zip(
            Areas._fields, run.areas, cut(best.areas, run.areas), strict=True
        ):
            part, actual = getattr(stated, area), difference(one, other)
            row |= {
                f'{area}_particles': part.lava,
                f'{area}_ground': part.ground,
                f'{area}_stated': part.total,
                f'{area}_actual': actual,
                f'{area}_ratio': part.total / actual,
                f'{area}_coarser_ratio': getattr(coarser, area).total / actual,
            }
        yield row | {
            'reference_spacing_m': finest,
            'reference_cpu_s': best.cpu,
            'cpu_s': seconds,
            'partners_cpu_s': partners,
            'coarser_cpu_s': coarser_seconds,
            'effects': ' '.join(runs.effects),
        }


def make_all(jobs: Iterable[Job], folder: Path, pool: ProcessPoolExecutor) -> None:
    """Make runs in the processes of a pool."""
    for future in as_completed([pool.submit(make, job, folder) for job in jobs]):
        print(*future.result()[:2], flush=True)


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
        jobs.sort(key=lambda job: job.ground != 'finest')
        make_all(jobs, args.folder, pool)
    rows = [row for name in names for row in compare(name, args.folder)]
    write_csv([{**row, 'machine': machine_name('cpu')} for row in rows], args.output)


if __name__ == '__main__':
    main()
