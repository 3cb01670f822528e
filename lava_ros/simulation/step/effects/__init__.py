# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Parts of effects that launch kernels of their own, one file an effect.

A file with the name of an effect defines ``Part``, a subclass of ``DevicePart`` with the hooks
that the effect needs.
"""

from collections.abc import Iterator
from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
import math
from typing import Any

from lava_ros.effects import Effects
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import StaggeredTerrain
from lava_ros.simulation.step.timestep import StageChoice


class DevicePart:
    """The kernels that an effect adds to a time step.

    A stage calls the hooks of all effects that are on in the order of this class, and each hook in
    the order of the effects' ranks. ``arguments`` is the struct that all kernels of a stage take
    (``layout.arguments_type``). Hooks launch kernels and read nothing back.
    """

    def __init__(
        self, scene: Scene, accuracy: Accuracy, terrain: StaggeredTerrain, state: State
    ) -> None:
        """Prepare for a scene; another state or terrain gets a new part.

        Args:
            scene: Terrain, vents and lava.
            accuracy: The resolution, without automatic values.
            terrain: The ground on the device; a ``RaisedTerrain`` if lava can solidify.
            state: The particles.
        """
        self.accuracy, self.terrain, self.state = accuracy, terrain, state
        self.prepare(scene)

    def prepare(self, scene: Scene) -> None:
        """Compute the constants of the kernels."""

    def has(self, hook: str) -> bool:
        """Return True if the effect defines a hook."""
        return getattr(type(self), hook) is not getattr(DevicePart, hook)

    @staticmethod
    def step_limit(scene: Scene, accuracy: Accuracy, reach: float) -> float:
        """Return the longest step [s]; ``reach`` is the maximum displacement in a step [m]."""
        return math.inf

    def compute_velocity(self, arguments: Any) -> None:
        """Replace the velocity of the local balance in ``flow`` by that with the effect.

        It may raise ``rates``, which limit the step; the step is chosen after it.
        """

    def accelerate(self, arguments: Any) -> None:
        """Change the velocity of the particles over the chosen step, before they move."""

    def move_particles(self, arguments: Any, choice: StageChoice, motion: Any) -> None:
        """Compute the velocity and move the particles in one pass, in place of the motion.

        ``compute_velocity`` is then called for output only.

        Args:
            arguments: As above.
            choice: Choice of the stage, and emission, by the first block of threads.
            motion: Device function that moves a particle (``motion.motion_function``).
        """

    def finish_step(self, arguments: Any) -> None:
        """Change the particles at the end of a step.

        It is called after the motion in every stage: its kernels return at once unless
        ``counts[IS_LAST]`` is 1; the step is ``clock[STEP]``. ``ordered`` holds the particles
        before the motion, and ``particle`` the same particles in the same order after it.
        """


@lru_cache
def _part_of(name: str) -> type[DevicePart] | None:
    """Return the class of an effect's part, None if it has no kernels of its own."""
    path = f'{__name__}.{name}'
    if find_spec(path) is None:
        return None
    part: type[DevicePart] = import_module(path).Part
    return part


def parts_of(effects: Effects) -> Iterator[tuple[str, type[DevicePart]]]:
    """Yield name and part of each effect that is on and has one, in the order of their ranks."""
    return ((name, part) for name in effects if (part := _part_of(name)) is not None)
