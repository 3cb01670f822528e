# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The choice of a step and of its stages, by the limits of its length."""

from functools import lru_cache
import math

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.step.timestep import choice_function, LIMITS, MAX_STAGES, StepLimits

FAR, MAX_STEP = 1e9, 100.0


def span(stages, order):
    """Return the explicit steps that a step covers (Meyer et al. 2014, equations 10 and 20)."""
    return (stages**2 + stages - 2) / 4 if order == 2 else (stages**2 + stages) / 2


@lru_cache
def kernel(order):
    form = at.Form(wp.float64, order, True, *(False for _ in at.Form._fields[3:]))
    choose = choice_function(form, False)

    @wp.kernel(module='unique', enable_backward=False)
    def once(limits: StepLimits, m: at.arguments_type(wp.float64)):
        choose(limits, m)

    return once


def chosen(order, *, diffusion=0.0, advection=0.0, end=FAR, fixed=0.0):
    """Return length [s], number of stages and limit of a step from 0 s."""
    limits, m = StepLimits(), at.arguments_type(wp.float64)()
    limits.longest, limits.fixed, limits.few_particles = MAX_STEP, fixed, 0
    given = {
        'rates': [diffusion, advection], 'clock': np.zeros(5), 'limit_time': [end, FAR],
        'stage': np.zeros(4),
    }
    given['clock'][at.TARGET] = FAR
    for name, values in given.items():
        setattr(m, name, wp.array(values, dtype=wp.float64, device='cpu'))
    for name in ('span_ends', 'span_steps'):
        setattr(limits, name, wp.array([math.inf], dtype=wp.float64, device='cpu'))
    limits.due = wp.full(1, wp.vec2d(math.inf, math.inf), dtype=wp.vec2d, device='cpu')
    m.counts = wp.zeros(11, dtype=wp.int32, device='cpu')
    wp.launch(kernel(order), dim=1, inputs=[limits, m], device='cpu')
    counts = m.counts.numpy()
    return m.clock.numpy()[at.STEP], counts[at.STAGES], LIMITS[counts[at.LIMIT]]


@pytest.mark.parametrize('order', [1, 2])
def test_step_has_the_fewest_stages_that_cover_it(order):
    most = span(MAX_STAGES, order)
    for ratio in (1.0, 2.4, 2.6, 3.9, 4.1, 27.0, 27.1, 300.0, 0.999 * most):
        fewest = next(s for s in range(2, MAX_STAGES + 1) if span(s, order) >= ratio - 1e-9)
        assert chosen(order, diffusion=ratio / MAX_STEP) == (MAX_STEP, fewest, 'longest'), ratio
    step, stages, limit = chosen(order, diffusion=2.0 * most / MAX_STEP)
    assert (stages, limit) == (MAX_STAGES, 'diffusion') and step == pytest.approx(0.5 * MAX_STEP)
    assert chosen(order, diffusion=0.2, advection=0.1)[::2] == (10.0, 'advection')
    assert chosen(order, fixed=7.0, advection=1.0)[::2] == (7.0, 'fixed')
    # up to an end in two equal steps rather than a sliver
    assert [chosen(order, end=end)[0] for end in (80.0, 150.0, 250.0)] == [80.0, 75.0, MAX_STEP]
