# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0


"""Dependence of inundated areas on the resolution: scenes at presets from coarse to fine.

The footprint of a scene is the area that at least half of several rotated and mirrored runs
inundate (hindcast/replicates.py). Decimetres decide where a flow branches, so a single run's
choice is chance. The agreement of the footprints of two halves of the runs shows how far
footprints of the same resolution differ by chance. The expected error of a single run
(hindcast/expected_error.py) is listed with its difference from a run with much finer particles,
the actual error.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
import math
from typing import Any

import numpy as np

from lava_ros.hindcast.case import Case
from lava_ros.hindcast.expected_error import difference, estimate_error
from lava_ros.hindcast.replicates import agreement, run_replicates
from lava_ros.hindcast.run import Result, Settings, simulate
from lava_ros.hindcast.score import judge, Score
from lava_ros.scene import Scene, Vent
from lava_ros.scene.lava import Lava
from lava_ros.scene.reshaping import finer
from lava_ros.scene.terrain_files import ridge_terrain
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import resolution_of
from lava_ros.verification.benchmarks.scenes import ground
from lava_ros.verification.benchmarks.scenes import scenes as scenes_of_effects
from lava_ros.verification.benchmarks.selection import jaccard, noise
from lava_ros.verification.rows import OnProgress

#: Presets, from coarse to fine; all are compared with the last.
LADDER = ('draft', 'standard', 'fine')

#: Refinement of the runs that single runs are compared with.
FINEST = 2.83

#: Names of scenes of the choice of effects in this benchmark, where their own are taken.
_NAMES = {'valley': 'melt_valley', 'ridge': 'basalt_ridge'}

#: Side of the cells over which the demo's terrain is averaged, like those of SRTM [m].
COARSE = 90.0

_LAVA = Lava(density=2600.0, viscosity=1e4, arrhenius=0.0, emissivity=0.0, convection=0.0)

#: A vent of the demo, and its lava.
_CREST, _TONGUES = Vent((4110.0, 5580.0), 40.0, radius=20.0), Lava(viscosity=5e4)


def scenes() -> tuple[Case, ...]:
    """Return a ridge, the same on coarse cells, shapes of the ground, and scenes of effects."""
    demo, falling = ridge_terrain(), math.tan(math.radians(5.0))
    # cells like those of SRTM, with maps on finer ones
    size = round(COARSE / demo.resolution)
    rows, columns = (side // size for side in demo.shape)
    blocks = demo.elevation[: rows * size, : columns * size].reshape(rows, size, columns, size)
    wide = replace(demo, elevation=blocks.mean(axis=(1, 3)), resolution=size * demo.resolution)
    # a Gaussian hill 150 m high, whose vent is 60 m from its top
    hill = ground(
        (0.0, 2000.0), (0.0, 2000.0), 5.0,
        lambda x, y: 150.0
        * np.exp(-((x - 1000.0) ** 2 + (y - 1000.0) ** 2) / (2.0 * 250.0**2)),
    )
    # a V-shaped valley, 5 degrees steep, with walls of 1:10
    valley = ground(
        (0.0, 2200.0), (0.0, 300.0), 5.0,
        lambda x, y: 500.0 - falling * x + 0.1 * np.abs(y - 150.0),
    )
    # a slope of 5 degrees with a drop of 200 m in one cell
    cliff = ground(
        (0.0, 4000.0), (0.0, 2025.0), 25.0,
        lambda x, y: 2000.0 - falling * x - 200.0 * (x > 1000.0),
    )
    return tuple(
        case_of(name, Scene(terrain, (vent,), lava), 3600.0 * hours)
        for name, terrain, vent, lava, hours in (
            ('ridge', finer(demo, 2), _CREST, _TONGUES, 3.0),
            ('coarse_ridge', finer(wide, 6), _CREST, _TONGUES, 3.0),
            ('hill', hill, Vent((1060.0, 1000.0), 10.0), _LAVA, 2.0),
            ('valley', valley, Vent((150.0, 150.0), 10.0), _LAVA, 2.0),
            ('cliff', finer(cliff, 2), Vent((500.0, 1012.5), 20.0, radius=30.0),
             replace(_LAVA, viscosity=5e3), 6.0),
        )
    ) + tuple(
        case_of(_NAMES.get(item.name, item.name), item.scene, item.horizon)
        for item in scenes_of_effects()
    )


def case_of(name: str, scene: Scene, horizon: float) -> Case:
    """Return a case without a mapped flow field."""
    volume = sum(vent.volume_between(0.0, horizon) for vent in scene.vents)
    nothing = np.zeros(scene.terrain.shape, dtype=bool)
    return Case(name, name, '', scene, None, nothing, 0.0, horizon, volume)


def _footprint(
    case: Case, preset: str, device: str, runs: int, finest: Result
) -> tuple[np.ndarray, np.ndarray, Score, dict[str, Any]]:
    """Return cells inundated by each run at a preset, majority footprint, score, and costs.

    The costs include the expected and the actual error of a single run.
    """
    settings = Settings(preset, device=device, maps=1)
    results = run_replicates(case, settings, runs)
    alone = simulate(case, settings)
    several = agreement(case, [result.snapshot for result in results])
    expected = estimate_error(case, settings, alone, several)
    maps = np.nan_to_num([result.snapshot.thickness for result in results])
    each = np.array([result.snapshot.inundated for result in results])
    majority = each.mean(axis=0) >= 0.5
    cost = {
        # for a single run, with kernels compiled beforehand
        'seconds': alone.wall_time,
        'particles': max(result.most_particles for result in results),
        'evaluations': alone.snapshot.steps.evaluations,
        # before the run, and with an additional pilot run
        'predicted_particles': alone.resolution.particle_error,
        'expected_particles': expected.particles,
        'expected_cells': expected.cells,
        'expected_effects': expected.effects,
        'chance': expected.chance,
        'actual': difference(alone.snapshot.inundated, finest.snapshot.inundated),
    }
    return each, majority, judge(case, maps.mean(axis=0), majority), cost


def measure(
    device: str, *, cases: Sequence[Case], runs: int, on_progress: OnProgress
) -> Iterator[dict[str, Any]]:
    """Run each scene ``runs`` times at each preset; ``cases`` replace the default scenes."""
    items = tuple(cases) or scenes()
    for index, case in enumerate(items):
        on_progress(case.name, index / len(items))
        yield from compare(case, device=device, runs=runs)


def compare(case: Case, *, device: str, runs: int) -> Iterator[dict[str, Any]]:
    """Run a case at each preset, rotated and mirrored."""
    standard = resolution_of(case.scene, PRESETS['standard'].accuracy, horizon=case.duration)
    finest_run = simulate(
        case, Settings('standard', standard.spacing / FINEST, device, maps=1)
    )
    found = {preset: _footprint(case, preset, device, runs, finest_run) for preset in LADDER}
    _, finest, best, _ = found[LADDER[-1]]
    for preset, (each, cells, judged, cost) in found.items():
        resolution = resolution_of(case.scene, PRESETS[preset].accuracy, horizon=case.duration)
        yield {
            'scene': case.name,
            'preset': preset,
            'spacing_m': resolution.spacing,
            # width of the flow from which the spacing follows, and particles across it
            'width_m': resolution.width,
            'across': resolution.across,
            'runs': runs,
            'jaccard': jaccard(cells, finest),
            'noise': noise(each),
            # mean over all pairs of runs
            'single': float(np.mean([jaccard(*pair) for pair in combinations(each, 2)])),
            'area_m2': judged.area,
            'area_ratio': judged.area / best.area,
            # the longest path along the footprint
            'length_m': judged.length,
            'length_ratio': judged.length / best.length,
            # agreement with the mapped footprint
            'score': judged.jaccard if case.footprint.any() else math.nan,
            **cost,
            'simulated_s': case.duration,
        }
