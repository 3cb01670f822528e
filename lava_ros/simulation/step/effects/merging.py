# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Merging and splitting: as many particles as the kernel needs, wherever the lava is.

A particle of volume V represents the area V / h. Where lava is thicker than expected, that is less
than the square of the spacing: a kernel holds more neighbours than necessary. There two particles,
each the other's nearest, merge into one, if it still represents no more than the square of the
spacing. Where lava has thinned again, a particle splits into halves, which are placed across the
line to the nearest neighbour, down to the volume that vents emit.

Volume is conserved bitwise: particles merge only where the sum of their volumes has no rounding,
as for equal volumes, and halving has none. The sums of V x, V T, V times emission time and, with
inertia, V u are conserved to rounding.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.scene import Scene
from lava_ros.simulation.backend.compiled import access, quick_kernel
from lava_ros.simulation.backend.scan import Scan
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.cells import cell_functions
from lava_ros.simulation.particles.layout import arguments_type, Form
from lava_ros.simulation.step.effects import DevicePart

#: Displacement of the fastest particle between two passes, over the largest in one step.
PASS_INTERVAL = 1.5

#: Distance over the spacing around two particles below which they merge.
MERGE_DISTANCE = 1.1

#: Maximum area of a merged particle over the squared spacing.
MAX_MERGED_AREA = 1.6

#: Area of a particle over the squared spacing above which it splits.
MIN_SPLIT_AREA = 2.5


@lru_cache
def _kernels(form: Form, is_ordered: bool, threads: int) -> tuple[Any, ...]:
    real = form.real

    @quick_kernel()
    def wait(thread: int, m: arguments_type(real), every: wp.float64):
        """Add up the displacement of the fastest particle; ``moved[1]`` is 1 if it suffices."""
        m.moved[1] = wp.float64(0.0)
        m.slots[0] = 0
        if m.counts[at.IS_LAST] == 1 and m.clock[at.STEP] > wp.float64(0.0):
            m.moved[0] = m.moved[0] + wp.float64(m.rates[at.ADVECTION]) * m.clock[at.STEP]
            if m.moved[0] >= every:
                m.moved[0] = wp.float64(0.0)
                m.moved[1] = wp.float64(1.0)

    @quick_kernel()
    def count(thread: int, m: arguments_type(real)):
        if m.moved[1] == wp.float64(0.0):
            return
        last = m.births.shape[0] - 1
        new = m.slots[0]
        if wp.static(is_ordered):
            new = m.slots[last] + m.births[last]
        m.counts[at.PARTICLES] = wp.min(m.counts[at.PARTICLES] + new, last + 1)

    choose, merge = _choice_kernel(real, threads), _merge_kernel(form, threads)
    return wait, choose, merge, _split_kernel(form, is_ordered, threads), count


@lru_cache
def _choice_kernel(real: Any, threads: int) -> Any:
    _, _, cells_around, range_in = cell_functions(real)
    load, _ = access(real, 4)

    @wp.func
    def seek(i: int, m: arguments_type(real), area: real, min_volume: real):
        """Find a particle's merge partner or, if it splits, its nearest neighbour."""
        m.births[i] = 0
        m.partner[i] = -1
        if i >= m.counts[at.PARTICLES]:
            return
        p = m.particle[i]
        if p[2] == real(0.0):
            return
        own = p[2] / m.flow[i][0]
        splits = own > real(wp.static(MIN_SPLIT_AREA)) * area and p[2] >= real(2.0) * min_volume
        if not splits and own > real(wp.static(MAX_MERGED_AREA)) * area:
            return
        here = load(m.ordered, i)
        nearest = m.partner[i]
        shortest = real(0.0)
        box = cells_around(m.cells, here[0], here[1], m.constants.radius)
        for r in range(box[0], box[1]):
            near = range_in(m.cells, r, box)
            for j in range(near[0], near[1]):
                other = m.particle[j]
                if j != i and other[2] > real(0.0):
                    dx = other[0] - p[0]
                    dy = other[1] - p[1]
                    square = dx * dx + dy * dy
                    fits = bool(splits)
                    if not splits:
                        both = p[2] + other[2]
                        around = both / (m.flow[i][0] + m.flow[j][0])
                        fits = (
                            square < real(wp.static(MERGE_DISTANCE * MERGE_DISTANCE)) * around
                            and real(2.0) * around < real(wp.static(MAX_MERGED_AREA)) * area
                            and both - p[2] == other[2]
                            and both - other[2] == p[2]
                        )
                    if fits and (nearest < 0 or square < shortest):
                        nearest = j
                        shortest = square
        if splits:
            m.births[i] = 1
            # a number below -1 is not a merge partner
            m.partner[i] = -2 - wp.where(nearest < 0, i, nearest)
        else:
            m.partner[i] = nearest

    @quick_kernel()
    def choose(thread: int, m: arguments_type(real), area: real, min_volume: real):
        if m.moved[1] > wp.float64(0.0):
            for i in range(thread, m.births.shape[0], threads):
                seek(i, m, area, min_volume)

    return choose


@lru_cache
def _merge_kernel(form: Form, threads: int) -> Any:
    real = form.real
    vec2, vec4 = (wp.types.vector(n, real) for n in (2, 4))
    vec2d = wp.types.vector(2, wp.float64)

    @wp.func
    def unite(i: int, j: int, m: arguments_type(real)):
        """Merge two particles; the second is left without volume."""
        p = m.particle[i]
        o = m.particle[j]
        both = p[2] + o[2]
        a = wp.float64(p[2]) / wp.float64(both)
        b = wp.float64(o[2]) / wp.float64(both)
        place = vec2d(
            a * wp.float64(p[0]) + b * wp.float64(o[0]),
            a * wp.float64(p[1]) + b * wp.float64(o[1]),
        )
        if wp.static(form.has_remainder):
            rest = a * vec2d(m.remainder[i]) + b * vec2d(m.remainder[j])
            place += rest
            m.remainder[i] = vec2(
                real(place[0] - wp.float64(real(place[0]))),
                real(place[1] - wp.float64(real(place[1]))),
            )
        if wp.static(form.has_velocity):
            m.velocity[i] = real(a) * m.velocity[i] + real(b) * m.velocity[j]
        if wp.static(form.has_age):
            m.emission_time[i] = a * m.emission_time[i] + b * m.emission_time[j]
        temperature = a * wp.float64(p[3]) + b * wp.float64(o[3])
        if wp.static(form.has_temperature_remainder):
            temperature += a * wp.float64(m.temperature_remainder[i])
            temperature += b * wp.float64(m.temperature_remainder[j])
            m.temperature_remainder[i] = real(temperature - wp.float64(real(temperature)))
        m.particle[i] = vec4(real(place[0]), real(place[1]), both, real(temperature))
        m.particle[j] = vec4(o[0], o[1], real(0.0), o[3])

    @quick_kernel()
    def merge(thread: int, m: arguments_type(real)):
        """Merge particles that chose each other."""
        if m.moved[1] > wp.float64(0.0):
            for i in range(thread, m.counts[at.PARTICLES], threads):
                j = m.partner[i]
                # never read an index below 0
                if j > i and m.partner[wp.max(j, 0)] == i:
                    unite(i, j, m)

    return merge


@lru_cache
def _split_kernel(form: Form, is_ordered: bool, threads: int) -> Any:
    real = form.real
    vec2, vec4 = (wp.types.vector(n, real) for n in (2, 4))

    @wp.func
    def halve(i: int, m: arguments_type(real)):
        """Halve a particle; the second half is appended to the particles."""
        slot = m.counts[at.PARTICLES]
        if wp.static(is_ordered):
            slot += m.slots[i]
        else:
            slot += wp.atomic_add(m.slots, 0, 1)
        if slot >= m.particle.shape[0]:
            # it splits when the host has enlarged the capacity
            m.counts[at.FULL] = 1
            return
        p = m.particle[i]
        other = m.particle[-2 - m.partner[i]]
        d = vec2(p[1] - other[1], other[0] - p[0])
        length = wp.length(d)
        if length > real(0.0):
            d /= length
        else:
            d = vec2(real(1.0), real(0.0))
        d *= real(0.35) * wp.sqrt(p[2] / m.flow[i][0])
        half = real(0.5) * p[2]
        m.particle[i] = vec4(p[0] + d[0], p[1] + d[1], half, p[3])
        m.particle[slot] = vec4(p[0] - d[0], p[1] - d[1], half, p[3])
        if wp.static(form.has_remainder):
            m.remainder[slot] = m.remainder[i]
        if wp.static(form.has_velocity):
            m.velocity[slot] = m.velocity[i]
        if wp.static(form.has_age):
            m.emission_time[slot] = m.emission_time[i]
        if wp.static(form.has_temperature_remainder):
            m.temperature_remainder[slot] = m.temperature_remainder[i]

    @quick_kernel()
    def split(thread: int, m: arguments_type(real)):
        if m.moved[1] > wp.float64(0.0):
            for i in range(thread, m.births.shape[0], threads):
                if m.births[i] > 0:
                    halve(i, m)

    return split


class Part(DevicePart):
    """The pass that merges and splits particles."""

    def prepare(self, scene: Scene) -> None:
        """Store the intended area and volume of particles."""
        assert self.accuracy.spacing is not None
        self._area, self._min_volume = self.accuracy.spacing**2, self.accuracy.particle_volume
        self._scan: Scan | None = None

    def finish_step(self, arguments: Any) -> None:
        """Merge particles that have converged and split those that have been stretched."""
        state = self.state
        threads = state.rare_threads
        kernels = _kernels(state.form, state.is_deterministic, threads)
        wait, choose, merge, split, count = kernels
        state.launches(wait, [arguments, PASS_INTERVAL])
        state.launches(choose, [arguments, self._area, self._min_volume], dim=threads)
        state.launches(merge, [arguments], dim=threads)
        if state.is_deterministic:
            # in the order of the particles, not of the threads
            if self._scan is None or self._scan.length != state.capacity:
                self._scan = Scan(state.capacity, state.device)
            self._scan(state.launches, state.arrays['births'], state.arrays['slots'])
        state.launches(split, [arguments], dim=threads)
        state.launches(count, [arguments])
