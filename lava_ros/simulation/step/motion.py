# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The motion of the particles over a stage, and changes of their values on the way.

At the end of a step they are heated or cooled. If no pass comes after the motion, it assigns the
particles to the cells of their new positions. It is a device function of a particle and its
velocity, so that the pass that computes the velocity can also move the particle.
"""

from functools import lru_cache
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.column import column_type
from lava_ros.effects.heat import warming_function
from lava_ros.simulation.backend import compiled
from lava_ros.simulation.backend.compiled import quick_kernel
from lava_ros.simulation.backend.threads import launch_over, MIN_MOVES
from lava_ros.simulation.output.covered_cells import note_function
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.cells import bin_function
from lava_ros.simulation.particles.layout import age_at, arguments_type, Form
from lava_ros.simulation.particles.state import State
from lava_ros.simulation.particles.terrain import terrain_functions
from lava_ros.simulation.step.outlets import Outlets
from lava_ros.simulation.step.timestep import FIRST_BLOCK, StageChoice, StepLimits

#: Maximum displacement in a step over the one it was chosen for: speeds may rise within a step.
_MAX_DISPLACEMENT_GROWTH = 2.0

#: Halvings of a displacement that would lift lava too high, before it is set to 0.
_HALVINGS = 8

#: Maximum slope of a sum over neighbours, times its radius over the thickness: twice that at the
#: edge, for lava that is twice as thick behind it.
_STEEPEST = 3.0


@lru_cache
def _guard_function(real: Any, is_pushed: bool) -> Any:
    """Return the device function that limits a displacement to the validity range of a step.

    A step is as long as the speeds at its start allow. Where the ground changes from one cell to
    the next, a particle may be a thousand times as fast a stage later, and would be thrown across
    cells, or high up a wall at whose foot it has to stop. Its displacement in a step is therefore
    at most ``_MAX_DISPLACEMENT_GROWTH`` times the one that steps are chosen for, and lifts it by
    at most its thickness (plus the head of its velocity). If only the slope of its surface moves
    it, ``is_pushed`` is False, and it is also lifted by at most that slope times the distance,
    ``_STEEPEST`` h / l.
    """
    vec2 = wp.types.vector(2, real)
    height_at = terrain_functions(real).height_at

    @wp.func
    def guarded(
        m: arguments_type(real), place: vec2, displacement: vec2, thickness: real, head: real
    ) -> vec2:
        longest = real(_MAX_DISPLACEMENT_GROWTH) * m.constants.reach
        size = wp.length(displacement)
        reduced = displacement
        if size > longest:
            reduced = displacement * (longest / size)
        here = height_at(m.ground, place.x, place.y) + head
        for _ in range(_HALVINGS):
            fraction = real(1.0)
            if wp.static(not is_pushed):
                rise = real(_STEEPEST) * wp.length(reduced) / m.constants.radius
                fraction = wp.min(fraction, rise)
            top = here + fraction * thickness
            if height_at(m.ground, place.x + reduced.x, place.y + reduced.y) <= top:
                return reduced
            reduced *= real(0.5)
        return vec2()

    return guarded


@lru_cache
def _heating_function(form: Form, effects: Effects) -> Any:
    """Return the device function of a particle's temperature [K] at the end of a step, or None.

    Its arguments: the particle's number, its item of ``State.ordered``, its thickness [m], its
    place at the start of the step, its displacement in the step, and arguments of the motion.
    """
    real = form.real
    warming, column_struct = warming_function(wp, real, effects), column_type(real)
    if warming is None:
        return None
    vec2, vec4 = (wp.types.vector(n, real) for n in (2, 4))
    gradient_at, _, height_at, *_ = terrain_functions(real)
    cosine_squared = effects.function('cosine_squared', real)
    ages_in_place, has_speed = effects.any('ages_in_place'), effects.any('needs_speed')
    falls = form.has_slope

    @wp.func
    def begun_in_place(m: arguments_type(real), x: real, y: real, now: wp.float64) -> wp.float64:
        """Return the time [s] at which lava reached the cell of a place, now if it has not."""
        column = int(wp.floor((x - m.ground.x0) / m.ground.resolution))
        row = int(wp.floor((y - m.ground.y0) / m.ground.resolution))
        if row < 0 or row >= m.ground.rows or column < 0 or column >= m.ground.columns:
            return now
        reached = m.arrived[row, column]
        return now if reached < wp.float32(0.0) else wp.float64(reached)

    @wp.func
    def heated(
        i: int, p: vec4, thickness: real, start: vec2, shift: vec2, m: arguments_type(real)
    ) -> real:
        step = real(m.clock[at.STEP])
        column = column_struct()
        column.thickness = thickness
        column.normal_thickness = column.thickness
        ground = vec2()
        if wp.static(cosine_squared is not None or (falls and not form.has_velocity)):
            ground = gradient_at(m.ground, p[0], p[1])
        if wp.static(cosine_squared is not None):
            column.normal_thickness *= wp.sqrt(cosine_squared(ground))
        age = real(0.0)
        if wp.static(form.has_age):
            # the clock is at the end of the step
            begun = m.clock[at.TIME] - m.clock[at.STEP]
            if wp.static(ages_in_place):
                age = real(age_at(begun, begun_in_place(m, p[0], p[1], begun)))
            else:
                age = real(age_at(begun, m.ordered_emission_time[i]))
        drop = real(0.0)
        if wp.static(falls):
            drop = -wp.dot(m.slope[i], shift)
            if wp.static(not form.has_velocity):
                # the actual drop of the ground, however steep it is where the step begins
                drop += wp.dot(ground, shift)
                drop += height_at(m.ground, start.x, start.y)
                drop -= height_at(m.ground, start.x + shift.x, start.y + shift.y)
        column.drop = drop / step
        if wp.static(has_speed):
            column.speed = wp.sqrt(shift.x * shift.x + shift.y * shift.y) / step
        change = warming(m.heat, column, p[3], age, step)
        if wp.static(form.has_temperature_remainder):
            change += m.ordered_temperature_remainder[i]
            temperature = p[3] + change
            m.temperature_remainder[i] = change - (temperature - p[3])
            return temperature
        return p[3] + change

    return heated


@lru_cache
def motion_function(form: Form, effects: Effects) -> Any:
    """Return the device function that moves the i-th of the ordered particles.

    Its arguments: the particle's number, its item of ``State.ordered``, its thickness [m] and
    velocity [m/s], and the argument of all kernels of a stage.
    """
    real = form.real
    vec2 = wp.types.vector(2, real)
    # differences and lateral stress push lava up slopes that its own surface slope does not
    guarded = _guard_function(real, form.has_surface or effects.any('is_lateral'))
    put = bin_function(real, False)
    load, store = compiled.access(real, 4)
    load_pair, store_pair = compiled.access(real, 2)
    vec3, vec4 = (wp.types.vector(n, real) for n in (3, 4))
    heated = _heating_function(form, effects)
    note, freezes = note_function(real, False), effects.any('freezes')

    @wp.func
    def move_on(i: int, p: vec4, f: vec3, m: arguments_type(real)):
        place = vec2(p[0], p[1])
        start = vec2(f[1], f[2])
        shift = m.stage[at.VELOCITY] * start
        before = vec2()
        if wp.static(form.is_staged):  # noqa: SIM102, the static test decides what is compiled
            # displacements, not positions, are combined: this keeps more digits in float32
            if m.counts[at.CURRENT] > 1:
                b = load(m.ordered_base, i)
                d = load(m.ordered_drift, i)
                place = vec2(b[0], b[1])
                before = vec2(d[0], d[1])
                start = vec2(d[2], d[3])
                shift += (
                    m.stage[at.FORMER] * before
                    + m.stage[at.BEFORE_FORMER] * vec2(b[2], b[3])
                    + m.stage[at.FIRST_VELOCITY] * start
                )
        if wp.static(form.is_guarded):
            head = real(0.0)
            if wp.static(form.has_velocity):
                head = (f[1] * f[1] + f[2] * f[2]) / (real(2.0) * m.constants.gravity)
            shift = guarded(m, place, shift, f[0], head)
        if wp.static(form.is_staged):
            store(m.base, i, vec4(place[0], place[1], before[0], before[1]))
            store(m.drift, i, vec4(shift[0], shift[1], start[0], start[1]))
            if m.mean_temperature:
                m.mean_temperature[i] = m.ordered_mean_temperature[i]
        temperature = p[3]
        if wp.static(form.has_age):
            m.emission_time[i] = m.ordered_emission_time[i]
        if wp.static(form.has_temperature_remainder):
            m.temperature_remainder[i] = m.ordered_temperature_remainder[i]
        if wp.static(heated is not None):  # noqa: SIM102, the static test decides
            if m.counts[at.IS_LAST] == 1:
                temperature = heated(i, p, f[0], place, shift, m)
        if wp.static(freezes):  # noqa: SIM102, the static test decides
            if m.counts[at.IS_LAST] == 1 and temperature < m.heat.solidus:
                m.cold[0] = 1
        new = place + shift
        if wp.static(form.has_remainder):
            rest = load_pair(m.ordered_remainder, i)
            new = place
            # past the target nothing moves, not even by rounding
            if m.counts[at.CURRENT] > 0:
                shift += rest
                new = place + shift
                if m.counts[at.IS_LAST] == 1:
                    rest = shift - (new - place)
            store_pair(m.remainder, i, rest)
        p = vec4(new[0], new[1], p[2], temperature)
        store(m.particle, i, p)
        if wp.static(not form.has_empty):
            put(i, p, m)
        if m.counts[at.IS_LAST] == 1:
            note(p, f[0], m.clock[at.TIME], m)

    return move_on


@lru_cache
def _kernel(real: Any, motion: Any, choose_and_emit: Any, bounds: tuple[int, int] | None) -> Any:
    vec3 = wp.types.vector(3, real)
    load, _ = compiled.access(real, 4)

    @quick_kernel(bounds=bounds)
    def move(
        i: int, flow: wp.array(dtype=vec3), limits: StepLimits, outlets: Outlets,
        m: arguments_type(real),
    ):
        if wp.static(choose_and_emit is not None):
            if i < wp.static(FIRST_BLOCK):
                choose_and_emit(i, limits, outlets, m)
                return
            i -= wp.static(FIRST_BLOCK)
        if i >= compiled.load_uncached(m.counts, at.PARTICLES):
            return
        p, f = load(m.ordered, i), flow[i]
        if wp.static(choose_and_emit is not None):
            compiled.wait_for(m.chosen)
        motion(i, p, f, m)

    return move


def move_particles(state: State, arguments: Any, choice: StageChoice, motion: Any) -> None:
    """Move the ordered particles over the stage by the velocity in ``state.flow``.

    ``motion`` is the result of ``motion_function``.
    """
    launch_over(
        state,
        _kernel(state.real, motion, choice.function, choice.bounds),
        [state.flow, choice.limits, choice.outlets, arguments],
        min_items=MIN_MOVES,
        ahead=choice.threads,
    )
