# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bounds of the cost of cases whose lava is fluid at the vent.

Lava of a composition runs at metres per second in a stream some tens of metres wide, and stops as
lava that is ten thousand times stiffer. By the stream, a flow of weeks would have 1e5 particles
and more than 1e5 steps, 20 to 50 times those of a material that was fitted to whole flows. The
stream only carries lava to the front: its speed u changes the time for this and the lava that it
holds, q / u. So a run has a maximum number of particles, which resolves the lava that has stopped,
and of steps, in which the fastest lava moves as if its viscosity were higher
(``Accuracy.mobility_limit``).
"""

from collections.abc import Mapping
from dataclasses import replace
import math

from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.resolution import estimated_effects, resolution_of
from lava_ros.simulation.setup.course import course_of

#: Numbers of steps and particles at a refinement of 1. Flows of ``etna_basalt`` have a sixth to
#: half of the steps, and half to all of the particles.
STEPS, PARTICLES = 18_000, 10_000

#: Minimum number of particles across the stream, and maximum spacing in cells of the ground, at
#: a refinement of 1.
ACROSS_STREAM, MAX_CELLS = 2.4, 2.8


def bounded(
    accuracy: Accuracy, scene: Scene, forced: Mapping[str, bool], *, horizon: float
) -> Accuracy:
    """Return an accuracy with bounds for fluid lava; the same one for other lava, and for cells.

    A spacing or a limit of the mobility that is given remains.

    Args:
        accuracy: The accuracy, with automatic values.
        scene: The scene.
        forced: Effects forced on or off.
        horizon: Simulated duration [s].
    """
    if accuracy.mobility_limit is not None or accuracy.method == 'cells':
        return accuracy
    effects = estimated_effects(scene, accuracy, forced, horizon=horizon)
    course = course_of(scene, effects, horizon=horizon)
    if course is None:
        return accuracy
    expected = resolution_of(scene, accuracy, forced, horizon=horizon)
    steps = STEPS * accuracy.refinement
    reach, fastest = accuracy.courant_number * expected.spacing, float(course.columns.speed.max())
    if horizon * fastest <= steps * reach:
        return accuracy
    spacing = expected.spacing
    if accuracy.spacing is None:
        number = PARTICLES * accuracy.refinement**2
        wanted = math.sqrt(expected.emitted / (number * expected.thickness))
        most = min(
            course.width / ACROSS_STREAM, MAX_CELLS * scene.terrain.resolution
        ) / accuracy.refinement
        spacing = float(f'{max(spacing, min(wanted, most)):.3g}')
    mobility = steps * accuracy.courant_number * spacing / (horizon * course.slope)
    return replace(
        accuracy, spacing=spacing, thickness=accuracy.thickness or expected.thickness,
        mobility_limit=float(f'{mobility:.2g}'),
    )
