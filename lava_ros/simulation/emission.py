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

from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.motion_arguments import arguments_type
from lava_ros.simulation.neighbors import bin_function
from lava_ros.simulation.outlets import due_function, group_function, Outlets, place_function
from lava_ros.simulation.state import (
    FULL,
    IS_LAST,
    NEWCOMERS,
    PARTICLES,
    State,
    TIME,
)
from lava_ros.simulation.vents import VentSet

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

    group_of, next_two = group_function(symmetric), due_function(symmetric)
    place_of = place_function(symmetric)
    put = bin_function(real, False)
    # the motion of the others goes on meanwhile, and needs to know how many there are
    total = NEWCOMERS if bins else PARTICLES

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
            p = vec4(real(place[0]), real(place[1]), volume, heat)
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
