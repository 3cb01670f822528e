# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Time integration: the choice of the step and of its stages, on the device.

Particles move with dx/dt = u(x), and u follows the surface gradient: a stiff, diffusive system.
It is integrated by the super-time-stepping of Meyer, Balsara & Aslam (2014, J. Comput. Phys. 257).
RKL2 is of second order, and its s velocity evaluations cover (s^2 + s - 2) / 4 explicit steps;
RKL1 is of first order and covers (s^2 + s) / 2. Explicit Euler is the case of one stage. Steps and
stages are chosen on the device; one launch of the kernels is one stage, so the host needs neither.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import warp as wp

from lava_ros.simulation.backend.compiled import FEW_THREADS
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.layout import arguments_type, Form

#: Limits of a step, indexed by ``State.counts[LIMIT]``.
LIMITS = ('longest', 'diffusion', 'advection', 'fixed', 'waves')

#: Threads of the first block of a motion, which may choose its stage (fused_stage.py).
FIRST_BLOCK = FEW_THREADS[0]

#: Maximum number of stages of a step: more would lose digits, not save steps.
MAX_STAGES = 64


@wp.func
def _span(stages: wp.float64, order: int) -> wp.float64:
    """Return the explicit steps that a step covers (Meyer et al. 2014, equations 10 and 20)."""
    product = stages * stages + stages
    if order == 1:
        return wp.float64(0.5) * product
    return wp.float64(0.25) * (product - wp.float64(2.0))


@wp.func
def _b(j: int, order: int) -> wp.float64:
    """Coefficient b_j of RKL2 (Meyer et al. 2014, equation 16), or 1 for RKL1."""
    if order == 1:
        return wp.float64(1.0)
    if j < 2:
        return wp.float64(1.0) / wp.float64(3.0)
    square = wp.float64(j * j + j)
    return (square - wp.float64(2.0)) / (wp.float64(2.0) * square)


@wp.func
def fraction_after(stage: int, stages: int, order: int) -> wp.float64:
    """Return the fraction of a step that has passed after a stage (Meyer et al. 2014, c_j)."""
    passed = wp.max(_span(wp.float64(stage), order), _b(1, order))
    return passed / _span(wp.float64(stages), order)


#: Maximum number of particles for which steps end when a particle is due, at a refinement of 1. A
#: late one changes the volume of n by 1/n and the radius by 1/(2 n): with more of them by less
#: than the error of the edge that the presets state, 0.004 at standard, 0.008 at draft.
FEW_PARTICLES = 128

#: Fraction of a step by which it ends after a particle is due, so that rounding does not delay it.
_AFTERWARDS = 1e-6


@wp.func
def until_next_particle(
    due: wp.array(dtype=wp.vec2d), time: wp.float64, step: wp.float64
) -> wp.float64:
    """Return a step that ends when particles are due, if they are due at one moment of it.

    Particles are emitted at the ends of stages. If steps are shorter than the time between two
    particles, they would be late, and the flow with them, by up to a step.
    """
    tolerance = wp.float64(_AFTERWARDS) * step
    end = time + step
    first = end
    last = time
    for v in range(due.shape[0]):
        for n in range(2):
            if due[v][n] > time + tolerance and due[v][n] < end:
                first = wp.min(first, due[v][n])
                last = wp.max(last, due[v][n])
    if first < end and last - first < tolerance:
        return wp.min(first - time + tolerance, step)
    return step


@wp.func
def longest_from(
    time: wp.float64, longest: wp.float64, ends: wp.array(dtype=wp.float64),
    limits: wp.array(dtype=wp.float64),
) -> wp.float64:
    """Return the longest step from a time that ``longest`` and the vents allow [s].

    Args:
        time: Simulated time [s].
        longest: Limit by anything else [s].
        ends: End of each span of constant discharge [s]; the last one is infinite.
        limits: Longest step in each span [s]. In a step over several, the fractions of the limits
            add up to at most 1.
    """
    step = wp.float64(0.0)
    rest = wp.float64(1.0)
    for k in range(wp.lower_bound(ends, time), ends.shape[0]):
        span = ends[k] - time - step
        within = rest * limits[k]
        if within <= span or step + span >= longest:
            return wp.min(step + within, longest)
        step += span
        rest -= span / limits[k]
    return longest


@wp.struct
class StepLimits:
    """Limits of a step.

    Attributes:
        longest: Longest step that the user and the effects allow [s].
        span_ends: End of each span of constant discharge [s]; the last one is infinite.
        span_steps: Longest step in each span [s].
        fixed: Step that overrides all limits [s]; 0 without.
        few_particles: Number of particles below which steps end when particles are due.
        due: Times at which the next particles are due [s] (``Outlets``).
    """

    longest: wp.float64
    span_ends: wp.array(dtype=wp.float64)
    span_steps: wp.array(dtype=wp.float64)
    fixed: wp.float64
    few_particles: wp.int32
    due: wp.array(dtype=wp.vec2d)


class StageChoice(NamedTuple):
    """Choice of the stage of a motion.

    Attributes:
        limits: The ``StepLimits``.
        outlets: The tables of the vents.
        function: Device function for that block; None if other launches choose and emit.
        bounds: The ``bounds`` of ``quick_kernel``; None without the function.
    """

    limits: Any
    outlets: Any
    function: Any = None
    bounds: tuple[int, int] | None = None

    @property
    def threads(self) -> int:
        """Number of threads before those of the particles."""
        return 0 if self.function is None else FIRST_BLOCK


@lru_cache
def choice_function(form: Form, freezes: bool) -> Any:
    """Return the device function that begins a step or its next stage.

    The last stage advances the clock. One thread calls it, when all rates are known.

    Only the first ``limit_time`` shortens steps, never the target: after the first end of a step
    at or after the target, stages idle. They also idle if the step would end after the second
    ``limit_time``; ``FULL_STEP`` is then the length of that step. Idle stages change nothing that
    a later step depends on, so the steps of a simulation do not depend on where it stops.
    """
    real, order = form.real, form.order

    @wp.func
    def choose(limits: StepLimits, m: arguments_type(real)):
        one = wp.float64(1.0)
        # read everything before writing anything: reads after a write would be repeated one by one
        time = m.clock[at.TIME]
        target = m.clock[at.TARGET]
        end = m.limit_time[at.LIMIT_TIME]
        max_end = m.limit_time[at.MAX_END]
        step = m.clock[at.STEP]
        j = m.counts[at.STAGE] + 1
        s = m.counts[at.STAGES]
        steps = m.counts[at.STEPS]
        evaluations = m.counts[at.EVALUATIONS]
        particles = m.counts[at.PARTICLES]
        diffusion = wp.float64(m.rates[at.DIFFUSION])
        advection = wp.float64(m.rates[at.ADVECTION])
        if wp.static(freezes):
            m.cold[0] = 0
        if j == 1:
            if time >= target:
                m.counts[at.IS_LAST] = 0
                m.counts[at.CURRENT] = 0
                m.stage[at.VELOCITY] = real(0.0)
                return
            former = step
            remaining = end - time
            step = longest_from(time, limits.longest, limits.span_ends, limits.span_steps)
            limit = 0
            explicit = step
            if diffusion * step > one:
                explicit = one / diffusion
            if wp.static(form.is_staged):
                explicit_limit = _span(wp.float64(MAX_STAGES), order) * explicit
                if explicit_limit < step:
                    step = explicit_limit
                    limit = 1
            else:
                if explicit < step:
                    step = explicit
                    limit = wp.static(LIMITS.index('diffusion'))
                    if m.velocity:
                        limit = wp.static(LIMITS.index('waves'))
            if advection * step > one:
                step = one / advection
                limit = 2
            if limits.fixed > wp.float64(0.0):
                step = limits.fixed
                limit = 3
            full = step
            if remaining <= step:
                step = remaining
            elif remaining < wp.float64(2.0) * step and limits.fixed == wp.float64(0.0):
                # two equal steps rather than a full one and a sliver
                step = wp.float64(0.5) * remaining
            if limits.fixed == wp.float64(0.0) and particles < limits.few_particles:
                step = until_next_particle(limits.due, time, step)
            ending = time + step
            if wp.abs(end - ending) < wp.float64(1e-9) * step:
                ending = end
            if ending > max_end:
                m.clock[at.FULL_STEP] = step
                m.counts[at.IS_LAST] = 0
                m.counts[at.CURRENT] = 0
                m.stage[at.VELOCITY] = real(0.0)
                return
            if m.velocity:
                m.clock[at.FORMER_STEP] = former
            m.clock[at.FULL_STEP] = full
            m.counts[at.LIMIT] = limit
            m.counts[at.STEPS] = steps + 1
            m.clock[at.STEP] = step
            s = 1
            if wp.static(form.is_staged):
                # the smallest s for which _span is at least this step
                product = wp.float64(2.0) * step / explicit
                if wp.static(order == 2):
                    product = wp.float64(2.0) * product + wp.float64(2.0)
                root = wp.sqrt(one + wp.float64(4.0) * product)
                s = wp.max(2, int(wp.ceil(wp.float64(0.5) * (root - one) - wp.float64(1e-9))))
            m.counts[at.STAGES] = s
        m.counts[at.CURRENT] = j
        m.counts[at.EVALUATIONS] = evaluations + 1
        if s == 1:
            m.stage[at.VELOCITY] = real(step)
        else:
            w = one / _span(wp.float64(s), order)
            if j == 1:
                m.stage[at.VELOCITY] = real(_b(1, order) * w * step)
            else:
                n = wp.float64(j)
                mu = (wp.float64(2.0) * n - one) / n * _b(j, order) / _b(j - 1, order)
                m.stage[at.FORMER] = real(mu)
                m.stage[at.BEFORE_FORMER] = real(-(n - one) / n * _b(j, order) / _b(j - 2, order))
                m.stage[at.VELOCITY] = real(mu * w * step)
                m.stage[at.FIRST_VELOCITY] = real(-(one - _b(j - 1, order)) * mu * w * step)
        if j == s:
            m.counts[at.IS_LAST] = 1
            m.counts[at.STAGE] = 0
            time += step
            if wp.abs(end - time) < wp.float64(1e-9) * step:
                time = end
            m.clock[at.TIME] = time
        else:
            m.counts[at.IS_LAST] = 0
            m.counts[at.STAGE] = j

    return choose
