# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Partner runs of a run, which measure its numerical error (simulation/numerical_error.py).

Both use ``COARSER`` times the particle spacing of the run, one on its ground and one on coarser
ground. Together they take about an eighth of the time of a run of many particles.
"""

from collections.abc import Callable, Generator
from dataclasses import replace
import logging
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
from lava_ros.simulation.numerical_error import (
    Areas,
    COARSER,
    error_of,
    GROUND_ORDER,
    NumericalError,
    Pair,
    PARTICLE_ORDER,
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
        device: Warp device; None for the first GPU, or the CPU without one.
        areas: Returns the areas of a partner run, on the cells of the run.
        clock: Returns the time [s], for the cost.

    Raises:
        LavaError: If a partner run fails.
    """
    begun = clock()
    assert accuracy.spacing is not None
    # the solver's cells double
    ratio = 2.0 if accuracy.method == 'cells' else COARSER
    coarser = replace(accuracy, spacing=ratio * accuracy.spacing)
    pairs: dict[str, Pair] = {}
    others: list[Areas] = []
    for part, ground in (('particles', scene), ('ground', on_coarser_ground(scene))):
        if ground is None:
            continue
        simulation = Simulation(
            ground, effects=effects, accuracy=coarser, device=device, horizon=horizon
        )
        yield from driving(simulation, time)
        others.append(areas(simulation.snapshot()))
        if part == 'particles':
            pairs[part] = Pair(run, others[0], richardson(ratio, PARTICLE_ORDER))
        else:
            pairs[part] = Pair(others[0], others[1], richardson(2.0, GROUND_ORDER))
    return error_of(
        pairs, spacing=accuracy.spacing, cell=scene.terrain.resolution, time=time,
        cost=clock() - begun, method=accuracy.method,
    )


def measure_error(scene: Scene, run: Areas, time: float, **options: Any) -> NumericalError:
    """Measure the error of a run; arguments and errors as for ``measuring``."""
    return result_of(measuring(scene, run, time, **options))


def measure_run(made: SceneRun) -> NumericalError | None:
    """Measure the error of a completed run.

    Returns:
        The error; None without lava, or if it cannot be measured, which is logged.
    """
    simulation, snapshot, request = made.simulation, made.snapshot, made.request
    assert snapshot is not None
    if not snapshot.budget.emitted:
        return None
    accuracy, simulated = simulation.accuracy, request.simulated
    try:
        return measure_error(
            request.scene if simulated is None else simulated(accuracy),
            Areas.of(snapshot), snapshot.time, accuracy=accuracy, effects=simulation.effects,
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
