"""The choice of the time step and the motion over it, on the device."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.simulation.heat import cooled_function, HeatConstants
from lava_ros.simulation.state import (
    FULL_STEP,
    LIMIT,
    PARTICLES,
    State,
    STEP,
    STEPS,
    TARGET,
    TIME,
)

#: What can bound a step, by its number in ``State.counts[LIMIT]``.
LIMITS = ('longest', 'diffusion', 'advection')


@lru_cache
def _step_kernel(real: Any) -> Any:
    @wp.kernel(module='unique', enable_backward=False)
    def choose_step(
        longest: wp.float64,
        rates: wp.array(dtype=real),
        clock: wp.array(dtype=wp.float64),
        counts: wp.array(dtype=wp.int32),
    ):
        """Take the shortest limit and advance the clock, ending exactly at the target."""
        step = longest
        limit = int(0)
        for kind in range(2):
            rate = wp.float64(rates[kind])
            if rate * step > wp.float64(1.0):
                step = wp.float64(1.0) / rate
                limit = kind + 1
        remaining = clock[TARGET] - clock[TIME]
        if remaining <= wp.float64(0.0):
            clock[STEP] = wp.float64(0.0)
            return
        clock[FULL_STEP] = step
        counts[LIMIT] = limit
        counts[STEPS] = counts[STEPS] + 1
        if remaining <= step:
            clock[STEP] = remaining
            clock[TIME] = clock[TARGET]
            return
        if remaining < wp.float64(2.0) * step:
            # two equal steps rather than a full one and a sliver
            step = wp.float64(0.5) * remaining
        clock[STEP] = step
        clock[TIME] = clock[TIME] + step

    return choose_step


@lru_cache
def _move_kernel(real: Any, effects: Effects) -> Any:
    vec3 = wp.types.vector(3, real)
    vec4 = wp.types.vector(4, real)
    cooled = cooled_function(real)
    cooling = effects.cooling

    @wp.kernel(module='unique', enable_backward=False)
    def move(
        ordered: wp.array(dtype=vec4),
        flow: wp.array(dtype=vec3),
        counts: wp.array(dtype=wp.int32),
        clock: wp.array(dtype=wp.float64),
        heat: HeatConstants,
        particle: wp.array(dtype=vec4),
    ):
        i = wp.tid()
        if i >= counts[PARTICLES]:
            return
        step = real(clock[STEP])
        p = ordered[i]
        f = flow[i]
        temperature = p[3]
        if wp.static(cooling):
            temperature = cooled(heat, f[0], temperature, step)
        particle[i] = vec4(p[0] + step * f[1], p[1] + step * f[2], p[2], temperature)

    return move


def choose_step(state: State, longest: float) -> None:
    """Set the step from the rates in the state and advance the clock by it.

    Args:
        state: The particles; its rates bound the step.
        longest: Longest step [s].
    """
    wp.launch(
        _step_kernel(state.real),
        dim=1,
        inputs=[longest, state.rates],
        outputs=[state.clock, state.counts],
        device=state.device,
    )


def move_particles(state: State, heat: HeatConstants) -> None:
    """Move and cool the ordered particles over the step and put them in ``state.particle``."""
    wp.launch(
        _move_kernel(state.real, state.effects),
        dim=state.capacity,
        inputs=[state.ordered, state.flow, state.counts, state.clock, heat],
        outputs=[state.particle],
        device=state.device,
    )
