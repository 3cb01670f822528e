# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Emission: what the discharge of the vents makes due at a step's end becomes particles."""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.simulation.backend.compiled import cos_pi, quick_kernel, sin_pi
from lava_ros.simulation.motion_arguments import arguments_type
from lava_ros.simulation.neighbors import bin_function
from lava_ros.simulation.state import (
    FULL,
    IS_LAST,
    NEWCOMERS,
    PARTICLES,
    State,
    TIME,
)
from lava_ros.simulation.vents import due_functions, Outlets, VentSet

#: Relative error of the time at which a particle is due.
_ROUNDING = 1e-9


@lru_cache
def emission_function(
    real: Any, symmetric: bool, has_velocity: bool, has_age: bool, bins: bool
) -> Any:
    """Return the device function that releases what is due of every so many-th vent.

    Its arguments: the first vent, how many it is to the next, the vents, and the arguments of the
    motion of the particles that there are (motion_arguments.py).
    """
    vec2 = wp.types.vector(2, real)
    vec4 = wp.types.vector(4, real)

    group_of, next_two = due_functions(symmetric)
    put = bin_function(real, False)
    # the motion of the others goes on meanwhile, and needs to know how many there are
    total = NEWCOMERS if bins else PARTICLES

    @wp.func
    def place_of(v: int, n: int, outlets: Outlets) -> vec2:
        """Place of a vent's n-th particle: stratified, never the same place twice.

        The additive recurrence of the plastic number spreads any number of points evenly. With
        symmetry each of its points is in one part of the vent, and the others mirror it.
        """
        group = group_of(v, outlets)
        part = n % group
        turns = wp.float64(n // group + 1)
        # vents in one place begin elsewhere, or their particles would be in one place
        a = wp.float64(0.7548776662466927) * turns
        a += wp.float64(0.6180339887498949) * outlets.shape[v, 9]
        b = wp.float64(0.5698402909980532) * turns
        b += wp.float64(0.4142135623730951) * outlets.shape[v, 9]
        a = a - wp.floor(a)
        b = b - wp.floor(b)
        radius = outlets.shape[v, 4]
        length = outlets.shape[v, 6]
        x = wp.float64(0.0)
        y = wp.float64(0.0)
        if length > wp.float64(0.0):
            across = wp.float64(2.0) * b - wp.float64(1.0)
            if wp.static(symmetric):
                a = wp.float64(0.5) * a
                across = b
                if part % 2 == 1:
                    a = wp.float64(1.0) - a
                if part >= 2:
                    across = -across
            across *= radius / length
            along_x = outlets.shape[v, 2] - outlets.shape[v, 0]
            along_y = outlets.shape[v, 3] - outlets.shape[v, 1]
            x = a * along_x - across * along_y
            y = a * along_y + across * along_x
        elif wp.static(symmetric):
            # in half turns; away from the sides of its eighth, lest a point meet its mirror image
            angle = wp.float64(0.25) * (wp.float64(0.1) + wp.float64(0.8) * a)
            x = radius * wp.sqrt(b) * cos_pi(angle)
            y = radius * wp.sqrt(b) * sin_pi(angle)
            if part % 2 == 1:
                swapped = x
                x = y
                y = swapped
            if (part // 2) % 2 == 1:
                x = -x
            if part >= 4:
                y = -y
        else:
            angle = wp.float64(2.0) * a + outlets.shape[v, 10]
            x = radius * wp.sqrt(b) * cos_pi(angle)
            y = radius * wp.sqrt(b) * sin_pi(angle)
        return vec2(real(outlets.shape[v, 0] + x), real(outlets.shape[v, 1] + y))

    @wp.func
    def released(v: int, due: int, outlets: Outlets, m: arguments_type(real)) -> int:
        """Release some particles of a vent, if there is room; return how many."""
        slot = wp.atomic_add(m.counts, wp.static(total), due)
        if wp.static(bins):
            slot += m.counts[PARTICLES]
        if slot + due > m.particle.shape[0]:
            # no room: what is due stays in the conduit until the host has made some
            wp.atomic_sub(m.counts, wp.static(total), due)
            m.counts[FULL] = 1
            return 0
        for n in range(due):
            i = slot + n
            if wp.static(real is wp.float32):
                m.remainder[i] = vec2()
            if wp.static(has_velocity):
                m.velocity[i] = vec2(real(outlets.shape[v, 7]), real(outlets.shape[v, 8]))
            if wp.static(has_age):
                m.age[i] = real(0.0)
            place = place_of(v, outlets.released[v] + n, outlets)
            volume, heat = real(outlets.particle_volume), real(outlets.shape[v, 5])
            p = vec4(place[0], place[1], volume, heat)
            m.particle[i] = p
            if wp.static(bins):
                put(i, p, m)
        return due

    @wp.func
    def emission(first: int, apart: int, outlets: Outlets, m: arguments_type(real)):
        if m.counts[IS_LAST] == 0:
            return
        time = m.clock[TIME]
        for v in range(first, outlets.starts.shape[0] - 1, apart):
            k = outlets.starts[v]
            # nothing is read but when something is due, give or take its rounding
            soon = (wp.float64(1.0) - wp.float64(_ROUNDING)) * outlets.due[v][0]
            if time >= soon and time >= outlets.times[k]:
                while k + 1 < outlets.starts[v + 1] and outlets.times[k + 1] <= time:
                    k += 1
                volume = outlets.volumes[k] + outlets.fluxes[k] * (time - outlets.times[k])
                rest = volume / outlets.particle_volume - wp.float64(outlets.released[v])
                # no more than an integer holds and a step should bring; the others come later
                due = int(wp.min(rest, wp.float64(outlets.most)))
                due -= due % group_of(v, outlets)
                if due > 0:
                    due = released(v, due, outlets, m)
                if due > 0:
                    outlets.released[v] = outlets.released[v] + due
                    outlets.due[v] = next_two(v, outlets)

    return emission


def emission_of(state: State, vents: VentSet) -> Any:
    """The device function ``emission_function`` for the particles of a state."""
    return emission_function(
        state.real, vents.is_symmetric, state.has_velocity, state.has_age, state.bins_in_motion
    )


@lru_cache
def _kernel(real: Any, emission: Any) -> Any:
    @quick_kernel
    def emit(thread: int, apart: int, outlets: Outlets, m: arguments_type(real)):
        """Release the whole particles that the discharge up to now makes and are not out yet."""
        emission(thread, apart, outlets, m)

    return emit


def emit(state: State, vents: VentSet, way: Any) -> None:
    """Append to the state's particles what is due at its time."""
    if vents.vents:
        threads = emitters(state, len(vents.vents))
        kernel = _kernel(state.real, emission_of(state, vents))
        state.launches(kernel, [threads, vents.outlets, way], dim=threads)


def emitters(state: State, most: int) -> int:
    """Threads that emit: one for all vents gives their particles the same order in every run."""
    return most if state.device.is_cuda and not state.is_deterministic else 1
