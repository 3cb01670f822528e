# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of vents on a device: when their particles are due, and their places."""

import warp as wp

from lava_ros.simulation.backend.compiled import on_cuda


@wp.struct
class Outlet:
    """A vent: its line from the terrain's centre [m], and temperature and velocity of its lava.

    ``radius`` and ``length`` are in m, ``temperature`` in K, ``velocity`` in m/s, and ``phase``
    and ``downhill`` (``Emission``) in half turns. ``group`` is the number of particles that the
    vent emits at once: 1, or that of its symmetric places (``Accuracy.symmetric``).
    """

    start: wp.vec2d
    end: wp.vec2d
    radius: wp.float64
    length: wp.float64
    temperature: wp.float64
    velocity: wp.vec2d
    phase: wp.float64
    downhill: wp.float64
    group: wp.int32


@wp.struct
class Outlets:
    """Tables of vents, and the number of particles that they have emitted, on a device.

    Attributes:
        vents: The vents, shape [vents].
        starts: Index of the first breakpoint of each vent in ``times``, ``fluxes`` and
            ``volumes``, and their number, shape [vents + 1].
        times, fluxes, volumes: Time [s], discharge after it [m3/s] and volume emitted before it
            [m3] at each breakpoint.
        first_place: Index of the first place of each vent in ``places``, and their number, shape
            [vents + 1].
        places: Places (x, y) from the terrain's centre [m], used in turn by the particles of vents
            around which lava may not come out everywhere.
        particle_volume: Volume of a particle [m3].
        max_per_step: Maximum number of particles that a vent emits in a step.
        released: Number of emitted particles of each vent, shape [vents], at least one.
        due: Times at which the next two particles of each vent are due [s], shape [vents].
    """

    vents: wp.array(dtype=Outlet)
    starts: wp.array(dtype=wp.int32)
    times: wp.array(dtype=wp.float64)
    fluxes: wp.array(dtype=wp.float64)
    volumes: wp.array(dtype=wp.float64)
    first_place: wp.array(dtype=wp.int32)
    places: wp.array(dtype=wp.vec2d)
    particle_volume: wp.float64
    max_per_step: wp.int32
    released: wp.array(dtype=wp.int32)
    due: wp.array(dtype=wp.vec2d)


@wp.func
def due_at(v: int, volume: wp.float64, outlets: Outlets) -> wp.float64:
    """Return the time at which a vent has emitted a volume, infinite if it never will [s]."""
    last = outlets.starts[v + 1]
    for k in range(outlets.starts[v], last):
        flux = outlets.fluxes[k]
        if flux > wp.float64(0.0):
            rest = wp.max(volume - outlets.volumes[k], wp.float64(0.0))
            time = outlets.times[k] + rest / flux
            if k + 1 == last or time <= outlets.times[k + 1]:
                return time
    return wp.float64(wp.inf)


@wp.func
def next_two(v: int, outlets: Outlets) -> wp.vec2d:
    """Return when the next two groups of a vent are due [s]."""
    released, group = outlets.released[v], outlets.vents[v].group
    following = outlets.particle_volume * wp.float64(released + group)
    after = outlets.particle_volume * wp.float64(released + 2 * group)
    return wp.vec2d(due_at(v, following, outlets), due_at(v, after, outlets))


@wp.func_native(on_cuda('return cospi(x);', 'return wp::cos(3.141592653589793 * x);'))
def _cos_pi(x: wp.float64) -> wp.float64:
    """Return cos(pi x), which CUDA computes without a table for large angles."""


@wp.func_native(on_cuda('return sinpi(x);', 'return wp::sin(3.141592653589793 * x);'))
def _sin_pi(x: wp.float64) -> wp.float64:
    """Return sin(pi x)."""


@wp.func
def place_of(v: int, n: int, outlets: Outlets) -> wp.vec2d:
    """Return the place of a vent's n-th particle from the terrain's centre [m].

    The additive recurrence of the plastic number spreads any number of points evenly without using
    a place twice. In a group the point is in one part of the vent, and the other particles of the
    group mirror it.
    """
    first = outlets.first_place[v]
    count = outlets.first_place[v + 1] - first
    if count > 0:
        return outlets.places[first + n % count]
    vent = outlets.vents[v]
    part = n % vent.group
    turns = wp.float64(n // vent.group + 1)
    # overlapping vents start at different points, so that their particles do not coincide
    a = wp.float64(0.7548776662466927) * turns
    a += wp.float64(0.6180339887498949) * vent.phase
    b = wp.float64(0.5698402909980532) * turns
    b += wp.float64(0.4142135623730951) * vent.phase
    a = a - wp.floor(a)
    b = b - wp.floor(b)
    radius = vent.radius
    length = vent.length
    x = wp.float64(0.0)
    y = wp.float64(0.0)
    if length > wp.float64(0.0):
        across = wp.float64(2.0) * b - wp.float64(1.0)
        if vent.group > 1:
            a = wp.float64(0.5) * a
            across = b
            if part % 2 == 1:
                a = wp.float64(1.0) - a
            if part >= 2:
                across = -across
        across *= radius / length
        along = vent.end - vent.start
        x = a * along[0] - across * along[1]
        y = a * along[1] + across * along[0]
    else:
        angle = wp.float64(2.0) * a + vent.downhill
        if vent.group > 1:
            # in half turns; away from the sides of its eighth, so that no point meets its mirror
            # image
            angle = wp.float64(0.25) * (wp.float64(0.1) + wp.float64(0.8) * a)
        x = radius * wp.sqrt(b) * _cos_pi(angle)
        y = radius * wp.sqrt(b) * _sin_pi(angle)
        if part % 2 == 1:
            swapped = x
            x = y
            y = swapped
        if (part // 2) % 2 == 1:
            x = -x
        if part >= 4:
            y = -y
    return vent.start + wp.vec2d(x, y)


@wp.kernel(module='unique', enable_backward=False)
def foresee(
    outlets: Outlets,
    # outputs
    due: wp.array(dtype=wp.vec2d),
):
    """Compute when the next two groups of each vent are due [s]."""
    v = wp.tid()
    due[v] = next_two(v, outlets)


@wp.kernel(module='unique', enable_backward=False)
def list_places(
    v: int,
    first: int,
    outlets: Outlets,
    # outputs
    places: wp.array(dtype=wp.vec2d),
):
    """Compute the places of consecutive particles of a vent from the terrain's centre [m]."""
    n = wp.tid()
    places[n] = place_of(v, first + n, outlets)
