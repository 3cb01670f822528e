# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Partner runs of a run, which measure its numerical error (simulation/numerical_error.py).

One is on the ground of the run, the other one on coarser ground. Both are on cells, which answer
the same question by another method in less time, or have larger particles (``partner_of``).
"""

from collections.abc import Callable, Generator
from dataclasses import replace
import logging
import math
import time as wall_clock
from typing import Any

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.runs.drive import driving, result_of
from lava_ros.runs.scene_run import SceneRun
from lava_ros.scene import Scene
from lava_ros.scene.terrain import Terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.cells.cell_size import cell_size
from lava_ros.simulation.method import reason_against_cells
from lava_ros.simulation.numerical_error import (
    Areas,
    between_methods,
    COARSER,
    error_of,
    GROUND_ORDER,
    NumericalError,
    ORDERS,
    Pair,
    richardson,
)
from lava_ros.simulation.output.snapshot import Snapshot
from lava_ros.simulation.setup.coarse_ground import coarsen_ground

_LOG = logging.getLogger(__name__)


def measuring(
    scene: Scene,
    run: Areas,
    time: float,
    *,
    accuracy: Accuracy,
    effects: Effects,
    horizon: float,
    device: str | None = None,
    areas: Callable[[Snapshot], Areas] = Areas.of,
    partner: tuple[Accuracy, float] | None = None,
    clock: Callable[[], float] = wall_clock.monotonic,
) -> Generator[None, None, NumericalError]:
    """Measure the error of a run in parts, so that the caller can do other work in between.

    Args:
        scene: The scene of the run, from its start.
        run: Areas of the run.
        time: Their simulated time [s].
        accuracy: Its accuracy, with all automatic values resolved.
        effects: Its effects.
        horizon: Its horizon [s].
        device: Warp device; None for the first GPU, or the CPU without one and for cells.
        areas: Returns the areas of a partner run, on the cells of the run.
        partner: The accuracy of the partner runs and the reduction; None for ``partner_of``.
        clock: Returns the time [s], for the cost.

    Raises:
        LavaError: If a partner run fails.
    """
    begun = clock()
    assert accuracy.spacing is not None
    chosen, reduction = partner or partner_of(scene, accuracy, effects)
    pairs: dict[str, Pair] = {}
    others: list[Areas] = []
    for part, ground in (('lava', scene), ('ground', on_coarser_ground(scene))):
        if ground is None:
            continue
        simulation = Simulation(
            ground, effects=effects, accuracy=chosen, device=device, horizon=horizon
        )
        yield from driving(simulation, time)
        others.append(areas(simulation.snapshot()))
        if part == 'lava':
            pairs[part] = Pair(run, others[0], reduction)
        else:
            pairs[part] = Pair(others[0], others[1], richardson(2.0, GROUND_ORDER))
    return error_of(
        pairs, spacing=accuracy.spacing, cell=scene.terrain.resolution, time=time,
        cost=clock() - begun, method=accuracy.method,
    )


def partner_of(scene: Scene, accuracy: Accuracy, effects: Effects) -> tuple[Accuracy, float]:
    """Return the accuracy of the partner runs, and the ``reduction`` of a run and the first one.

    Particles are compared with the smallest cells that are at least as large as their spacing and
    as the cells of the terrain, unless particles are better with its effects.
    """
    spacing, cell = accuracy.spacing, scene.terrain.resolution
    assert spacing is not None
    is_limited = accuracy.mobility_limit is not None
    if accuracy.method == 'cells' or is_limited or reason_against_cells(effects):
        return coarser_partner_of(accuracy)
    doublings = max(math.ceil(math.log2(spacing / cell)), 0)
    # a small terrain limits the size
    size = cell_size(scene.terrain, cell * 2.0**doublings)
    return replace(accuracy, method='cells', spacing=size), between_methods(size, spacing)


def coarser_partner_of(accuracy: Accuracy) -> tuple[Accuracy, float]:
    """Return the accuracy and the ``reduction`` for partner runs by the method of the run."""
    assert accuracy.spacing is not None
    ratio = COARSER[accuracy.method]
    coarser = replace(accuracy, spacing=ratio * accuracy.spacing)
    return coarser, richardson(ratio, ORDERS[accuracy.method])


def measure_error(scene: Scene, run: Areas, time: float, **options: Any) -> NumericalError:
    """Measure the error of a run; arguments and errors as for ``measuring``."""
    return result_of(measuring(scene, run, time, **options))


def measure_run(made: SceneRun) -> NumericalError | None:
    """Measure the error of a completed run.

    Returns:
        The error; None without an inundated area, or if it cannot be measured, which is logged.
    """
    simulation, snapshot, request = made.simulation, made.snapshot, made.request
    assert snapshot is not None
    run = Areas.of(snapshot)
    if not run.inundated.any():
        return None
    accuracy, simulated = simulation.accuracy, request.simulated
    try:
        return measure_error(
            request.scene if simulated is None else simulated(accuracy),
            run, snapshot.time, accuracy=accuracy, effects=simulation.effects,
            horizon=request.until, device=request.device,
            areas=lambda partner: Areas.of(request.shown(partner)),
        )
    except LavaError as error:
        _LOG.warning('the numerical error is not measured: %s', error)
        return None


def on_coarser_ground(scene: Scene) -> Scene | None:
    """Return a scene on ground of cells twice as large; None if the terrain is too small."""
    if coarsen_ground(scene.terrain) is None:
        return None

    def coarsen(terrain: Terrain) -> Terrain:
        ground = coarsen_ground(terrain)
        assert ground is not None
        return ground

    return scene.on(coarsen)
