# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Emission: the release of particles from vents by their discharge.

After each stage j of a step those particles come out that are due by its time t + c_j dt, so the
next stage includes them: a Runge-Kutta method for the volume as well as for the motion. A particle
that comes out within a step has no displacement from its earlier stages. The weighted sum of the
stages then moves the lava of a step as far as it flows until the end of the step, to second order.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.output.covered_cells import note_function
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.cells import bin_function
from lava_ros.simulation.particles.layout import arguments_type, Form
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.step.outlets import next_two, Outlets, place_of
from lava_ros.simulation.step.timestep import fraction_after

#: Relative error of the time at which a particle is due.
_ROUNDING = 1e-9


@lru_cache
def emission_function(form: Form) -> Any:
    """Return the device function that releases the particles that are due from every k-th vent.

    The arguments of the function are the index of the first vent, the stride k, the tables of the
    vents, and the argument of all kernels of a stage (``arguments_type``).
    """
    real, order, bins = form.real, form.order, not form.has_empty
    vec2, vec4 = (wp.types.vector(n, real) for n in (2, 4))
    put = bin_function(real, False)
    note = note_function(real, True)
    # other particles move at the same time, so their number must not change
    total = at.NEWCOMERS if bins else at.PARTICLES

    @wp.func
    def released(
        v: int, due: int, time: wp.float64, end: wp.float64, outlets: Outlets,
        m: arguments_type(real),
    ) -> int:
        """Release some particles of a vent at a time, if there is room; return how many.

        The time is within a step that ends at ``end``.
        """
        slot = wp.atomic_add(m.counts, wp.static(total), due)
        if wp.static(bins):
            slot += m.counts[at.PARTICLES]
        if slot + due > m.particle.shape[0]:
            # the capacity is used up: due particles stay in the conduit until the host has
            # enlarged it
            wp.atomic_sub(m.counts, wp.static(total), due)
            m.counts[at.FULL] = 1
            return 0
        for n in range(due):
            i = slot + n
            # asked at run time: otherwise each set of effects would need a kernel of its own
            if m.remainder:
                m.remainder[i] = vec2()
            if m.velocity:
                velocity = outlets.vents[v].velocity
                m.velocity[i] = vec2(real(velocity[0]), real(velocity[1]))
            if m.emission_time:
                m.emission_time[i] = time
            if m.temperature_remainder:
                m.temperature_remainder[i] = real(0.0)
            place = place_of(v, outlets.released[v] + n, outlets)
            volume, heat = real(outlets.particle_volume), real(outlets.vents[v].temperature)
            p = vec4(real(place[0]), real(place[1]), volume, heat)
            m.particle[i] = p
            if m.base:
                m.base[i] = vec4(p[0], p[1], real(0.0), real(0.0))
                m.drift[i] = vec4()
                if m.mean_temperature:
                    m.mean_temperature[i] = heat
            note(p, real(0.0), end, m)
            if wp.static(bins):
                put(i, p, m)
        return due

    @wp.func
    def emission(first: int, apart: int, outlets: Outlets, m: arguments_type(real)):
        if m.counts[at.CURRENT] == 0:
            return
        time = m.clock[at.TIME]
        end = time
        if m.counts[at.IS_LAST] == 0:
            # the clock is still at the start of the step
            end += m.clock[at.STEP]
            passed = fraction_after(m.counts[at.CURRENT], m.counts[at.STAGES], order)
            time += passed * m.clock[at.STEP]
        for v in range(first, outlets.starts.shape[0] - 1, apart):
            k = outlets.starts[v]
            # read the tables only when a particle is due, within rounding
            soon = (wp.float64(1.0) - wp.float64(_ROUNDING)) * outlets.due[v][0]
            if time >= soon and time >= outlets.times[k]:
                while k + 1 < outlets.starts[v + 1] and outlets.times[k + 1] <= time:
                    k += 1
                volume = outlets.volumes[k] + outlets.fluxes[k] * (time - outlets.times[k])
                rest = volume / outlets.particle_volume - wp.float64(outlets.released[v])
                # limited to the range of an integer and to a step's maximum; the rest follows
                # later
                due = int(wp.min(rest, wp.float64(outlets.max_per_step)))
                due -= due % outlets.vents[v].group
                if due > 0:
                    due = released(v, due, time, end, outlets, m)
                if due > 0:
                    outlets.released[v] = outlets.released[v] + due
                    outlets.due[v] = next_two(v, outlets)

    return emission


@lru_cache
def _kernel(real: Any, emission: Any) -> Any:
    @quick_kernel()
    def emit(thread: int, apart: int, outlets: Outlets, m: arguments_type(real)):
        """Release all whole particles that are due at the current time."""
        emission(thread, apart, outlets, m)

    return emit


def emit(state: State, emission: Any, outlets: Any, arguments: Any) -> None:
    """Append the particles that are due at the time of a state, by an ``emission_function``."""
    threads = state.emitting_threads(outlets.starts.size - 1)
    if threads:
        state.launches(_kernel(state.real, emission), [threads, outlets, arguments], dim=threads)
