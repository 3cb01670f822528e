# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Computations of one stage of a time step, algorithm 1 of the paper, in their order."""

from collections.abc import Callable
import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.heat import heat_of
from lava_ros.effects.laws import law_of
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.threads import launch_over
from lava_ros.simulation.particles.kernels import smoothing_kernel
from lava_ros.simulation.particles.layout import arguments_type, flow_constants_of, MAX_SOLVED
from lava_ros.simulation.particles.neighbors import NeighborGrid
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import StaggeredTerrain
from lava_ros.simulation.step import motion, timestep
from lava_ros.simulation.step.effects import parts_of
from lava_ros.simulation.step.emission import emission_function, emit
from lava_ros.simulation.step.flow import flow_kernels
from lava_ros.simulation.step.fused_stage import stage_choice
from lava_ros.simulation.step.published_flow import published_kernel
from lava_ros.simulation.step.timestep import StageChoice
from lava_ros.simulation.step.vents import VentSet


class Stage:
    """The equations of a scene on its terrain, for one set of effects.

    Attributes:
        constants: Constants of the flow kernels.
        parts: Kernels of effects, by effect.
    """

    def __init__(
        self, scene: Scene, accuracy: Accuracy, state: State, neighbors: NeighborGrid,
        terrain: StaggeredTerrain,
    ) -> None:
        """Collect the constants and the kernels for the effects that are on in ``state``."""
        self._accuracy, self._effects = accuracy, state.effects
        self._viscosity = scene.lava.viscosity
        self._state, self._neighbors = state, neighbors
        self._limits: tuple[Scene, VentSet, Any] | None = None
        self.constants = _flow_constants(scene, accuracy, state.real)
        self._fixed = {
            'ground': terrain.ground,
            'law': law_of(scene.lava, state.real),
            'heat': heat_of(scene, state.effects, state.real),
            'constants': self.constants,
        }
        self._cells: Any = None
        self._arguments: Any = None
        self._is_published = accuracy.formulation == 'as-published'
        self.parts = {
            name: part(scene, accuracy, terrain, state) for name, part in parts_of(state.effects)
        }
        parts = self.parts.values()
        # such a pass computes the velocity and also moves the particles
        movers = [] if self._is_published else [one for one in parts if one.has('move_particles')]
        self._mover = movers[0] if movers else None
        self._needs_flow_after_motion = any(part.has('finish_step') for part in parts)

    def take(
        self, scene: Scene, vents: VentSet, *, observe: Callable[[], None] | None = None
    ) -> None:
        """Run one stage, after which the vents emit the particles that are due by its time.

        The scene's vents limit the length of steps. ``observe`` launches observations of the flow
        before it moves.
        """
        state, neighbors = self._state, self._neighbors
        neighbors.rebuild(state, self.arguments)
        is_needed = self._mover is None or self._needs_flow_after_motion or observe is not None
        self.compute_flow(fills_flow=is_needed)
        if observe is not None:
            observe()
        if self._mover is None:
            # before the choice of the step, which depends on the speed
            self.finish_flow()
        limits, arguments, outlets = self._limits_of(scene, vents), self.arguments, vents.outlets
        emission, has_empty = emission_function(state.form), state.form.has_empty
        choice = stage_choice(
            state, limits, outlets, None if has_empty else emission, arguments,
            sums_up=self._mover is not None,
        )
        self._move(arguments, choice)
        if has_empty:
            emit(state, emission, outlets, arguments)

    def _limits_of(self, scene: Scene, vents: VentSet) -> Any:
        """Return the (cached) arguments for the choice of a stage."""
        if self._limits is None or self._limits[0] is not scene or self._limits[1] is not vents:
            accuracy, device = self._accuracy, self._state.device
            limits = timestep.StepLimits()
            limits.longest = longest_step(scene, accuracy, self._effects, self.constants.reach)
            limits.span_ends, limits.span_steps = (
                wp.array(column, dtype=wp.float64, device=device)
                for column in vents.step_limits.T[:2]
            )
            limits.fixed = accuracy.fixed_step or 0.0
            limits.few_particles = int(timestep.FEW_PARTICLES * accuracy.refinement)
            limits.due = vents.outlets.due
            self._limits = scene, vents, limits
        return self._limits[2]

    def compute_flow(self, *, fills_flow: bool = True) -> None:
        """Compute thickness and local velocity of the ordered particles, and raise the rates.

        The result is stored in ``state.flow``, if ``fills_flow``, and as input to the lateral
        stress in ``source`` and ``area``.
        """
        state, arguments = self._state, self.arguments
        name, has_means = self._accuracy.kernel, not self._is_published
        elevate, flow = flow_kernels(state, name, has_means=has_means)
        if state.form.has_surface:
            launch_over(state, elevate, [arguments], lanes=state.lanes)
        launch_over(state, flow, [arguments, fills_flow], lanes=state.lanes)

    def finish_flow(self) -> None:
        """Let effects replace the local velocities: by lateral stress or momentum."""
        if self._is_published:
            kernel = published_kernel(self._state.real)
            launch_over(self._state, kernel, [self.arguments, self._viscosity])
            return
        for part in self.parts.values():
            part.compute_velocity(self.arguments)

    def _move(self, arguments: Any, choice: StageChoice) -> None:
        """Move the particles, and end the step."""
        state = self._state
        for part in self.parts.values():
            part.accelerate(arguments)
        moved = motion.motion_function(state.form, state.effects)
        if self._mover is None:
            motion.move_particles(state, arguments, choice, moved)
        else:
            self._mover.move_particles(arguments, choice, moved)
        self._neighbors.is_binned = not state.form.has_empty
        for part in self.parts.values():
            part.finish_step(arguments)

    @property
    def arguments(self) -> Any:
        """The one argument of all kernels of a stage, kept until an array or the cells change."""
        state, cells = self._state, self._neighbors.cells
        if self._cells is not cells or self._arguments.particle is not state.particle:
            self._cells, self._arguments = cells, arguments_type(state.real)()
            for name, value in (state.arrays | self._fixed | {'cells': cells}).items():
                setattr(self._arguments, name, value)
        return self._arguments


def longest_step(scene: Scene, accuracy: Accuracy, effects: Effects, reach: float) -> float:
    """Return the longest step [s] that the user and the effects allow.

    ``reach`` is the maximum displacement in a step [m].
    """
    assert accuracy.longest_step is not None
    limits = (part.step_limit(scene, accuracy, reach) for _, part in parts_of(effects))
    return min([accuracy.longest_step, *limits])


def _flow_constants(scene: Scene, accuracy: Accuracy, real: Any) -> Any:
    """Return the constants for a scene and its accuracy."""
    kernel, radius = smoothing_kernel(accuracy.kernel, real), accuracy.radius
    constants = flow_constants_of(real)()
    constants.radius = radius
    constants.weight = scene.lava.density * scene.gravity
    constants.reach = accuracy.courant_number * min(radius, scene.terrain.resolution)
    limit = accuracy.mobility_limit
    constants.max_mobility = math.inf if limit is None else limit
    constants.stiffness = kernel.stiffness / (accuracy.diffusion_number * radius**2)
    constants.inverse_diffusion_number = 1.0 / accuracy.diffusion_number
    constants.gravity = scene.gravity
    constants.thickest = math.inf
    constants.threshold = accuracy.inundation_threshold
    if accuracy.thickness is not None:
        constants.thickest = MAX_SOLVED * accuracy.thickness
    return constants
