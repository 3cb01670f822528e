# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Computations of one stage of a time step, algorithm 1 of the paper, in their order."""

from collections.abc import Callable, Mapping
from functools import partial
import math
from typing import Any

import warp as wp

from lava_ros.effects.heat import heat_of
from lava_ros.effects.laws import law_of
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.threads import launch_over
from lava_ros.simulation.particles.kernels import smoothing_kernel
from lava_ros.simulation.particles.layout import flow_constants_of, THICKEST
from lava_ros.simulation.particles.neighbors import NeighborGrid
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.step import motion, timestep
from lava_ros.simulation.step.effects import device_parts
from lava_ros.simulation.step.emission import emission_function, emit
from lava_ros.simulation.step.flow import flow_kernels, publish_velocity
from lava_ros.simulation.step.fused_stage import (
    choice_within_motion,
    choose_before_motion,
    is_within_the_motion,
)
from lava_ros.simulation.step.timestep import StageChoice
from lava_ros.simulation.step.vents import VentSet


class Stage:
    """The equations of a scene on its terrain, for one set of effects.

    ``constants`` are those of the flow kernels.
    """

    def __init__(
        self, scene: Scene, accuracy: Accuracy, state: State, neighbors: NeighborGrid,
        after_step: Mapping[str, Any],
    ) -> None:
        """Collect the constants and the kernels for the effects that are on in ``state``.

        ``after_step`` contains the passes that effects need at the end of a step, by effect.
        """
        assert accuracy.spacing is not None and accuracy.thickness is not None
        self._accuracy, self._effects = accuracy, state.effects
        self._viscosity = scene.lava.viscosity
        self._state, self._neighbors = state, neighbors
        self._after_step = after_step
        self._radius = accuracy.ratio * accuracy.spacing
        self._pace: tuple[Scene, VentSet, Any] | None = None
        self.constants = _flow_constants(scene, accuracy, self._radius, state.real)
        neighbors.set_constants(
            law=law_of(scene.lava, state.real),
            heat=heat_of(scene, state.effects, state.real),
            constants=self.constants,
        )
        gradient = accuracy.gradient if state.has_surface else 'energy'
        self._flow_kernels = partial(
            flow_kernels, state.real, accuracy.kernel, gradient, state.effects
        )
        self._is_published = accuracy.formulation == 'as-published'
        parts = {
            hook: tuple(device_parts(state.effects, hook).values())
            for hook in ('compute_velocity', 'accelerate', 'move_particles')
        }
        self._velocities, self._accelerations = parts['compute_velocity'], parts['accelerate']
        # such a pass computes the velocity and also moves the particles
        self._moves_at_once = bool(parts['move_particles']) and not self._is_published
        self._motion = (
            parts['move_particles'][0] if self._moves_at_once else motion.move_particles
        )

    def take(
        self, scene: Scene, vents: VentSet, *, look: Callable[[], None] | None = None
    ) -> None:
        """Run one stage; at the end of a step the vents emit the particles that are due.

        The scene's vents limit the length of steps. ``look`` launches observations of the flow
        before it moves.
        """
        state, neighbors = self._state, self._neighbors
        neighbors.rebuild(state)
        is_needed = not self._moves_at_once or bool(self._after_step) or look is not None
        self.compute_flow(fills_flow=is_needed)
        if look is not None:
            look()
        if not self._moves_at_once:
            # before the choice of the step, which depends on the speed
            self.finish_flow()
        pace, way, outlets = self._pace_of(scene, vents), self._arguments(), vents.outlets
        emission = emission_function(
            state.real, vents.is_symmetric, state.has_velocity, state.has_age,
            state.bins_in_motion, state.has_temperature_remainder,
        )
        emits_in_motion = emission if state.bins_in_motion else None
        choice = choice_within_motion(state, pace, outlets, emits_in_motion)
        if not is_within_the_motion(state, sums_up=self._moves_at_once):
            choice = choose_before_motion(state, choice, way)
        self._move(way, choice)
        if not state.bins_in_motion:
            emit(state, emission, outlets, way)

    def _pace_of(self, scene: Scene, vents: VentSet) -> Any:
        """Return the (cached) arguments for the choice of a stage."""
        if self._pace is None or self._pace[0] is not scene or self._pace[1] is not vents:
            accuracy, state = self._accuracy, self._state
            pace = timestep.pace_type(state.real)()
            pace.longest = timestep.longest_step(
                scene, accuracy, self._effects, self.constants.reach
            )
            pace.ends, pace.limits, _ = (
                wp.array(column, dtype=wp.float64, device=state.device)
                for column in vents.step_limits.T
            )
            pace.fixed = accuracy.fixed_step or 0.0
            pace.few = int(timestep.FEW * accuracy.refinement)
            pace.due = vents.due
            for name in ('rates', 'clock', 'limit_time', 'counts', 'stage', 'cold', 'chosen'):
                if hasattr(state, name):
                    setattr(pace, name, getattr(state, name))
            self._pace = scene, vents, pace
        return self._pace[2]

    def compute_flow(self, *, fills_flow: bool = True) -> None:
        """Compute thickness and local velocity of the ordered particles, and raise the rates.

        The result is stored in ``state.flow``, if ``fills_flow``, and as input to the lateral
        stress in ``state.source`` and ``state.area``.
        """
        state, way = self._state, self._arguments()
        elevate, flow = self._flow_kernels(
            state.lanes, state.parts, state.is_short, state.is_wide,
            not self._is_published,
        )
        if state.has_surface:
            launch_over(state, elevate, [way], lanes=state.lanes)
        launch_over(state, flow, [way, fills_flow], lanes=state.lanes)


    def finish_flow(self) -> None:
        """Let effects replace the local velocities: by lateral stress or momentum."""
        if self._is_published:
            publish_velocity(self._state, self._arguments(), self._viscosity)
            return
        for compute_velocity in self._velocities:
            compute_velocity(self._state, self._arguments(), self._accuracy)

    def _move(self, way: Any, choice: StageChoice) -> None:
        """Move the particles, and end the step."""
        state = self._state
        for accelerate in self._accelerations:
            accelerate(state, way, self._accuracy)
        self._motion(state, way, choice, motion.motion_of(state))
        self._neighbors.is_binned = state.bins_in_motion
        for effect in self._after_step.values():
            effect.apply(self._state, way)

    def _arguments(self) -> Any:
        return self._neighbors.motion_arguments(self._state)


def _flow_constants(scene: Scene, accuracy: Accuracy, radius: float, real: Any) -> Any:
    """Return the constants for a scene, its accuracy and the kernel radius [m]."""
    kernel = smoothing_kernel(accuracy.kernel, real)
    constants = flow_constants_of(real)()
    constants.radius = radius
    constants.weight = scene.lava.density * scene.gravity
    constants.reach = accuracy.courant_number * min(radius, scene.terrain.resolution)
    constants.mobile = math.inf if accuracy.mobility_limit is None else accuracy.mobility_limit
    constants.stiffness = kernel.stiffness / (accuracy.diffusion_number * radius**2)
    constants.share = 1.0 / accuracy.diffusion_number
    constants.gravity = scene.gravity
    constants.thickest = math.inf
    constants.threshold = accuracy.inundation_threshold
    if accuracy.thickness is not None:
        constants.thickest = THICKEST * accuracy.thickness
    return constants
