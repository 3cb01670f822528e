# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Smoothing kernels and Bessel functions against numpy and scipy."""

from dataclasses import fields
import math
import re

import numpy as np
import pytest
from scipy import special
import warp as wp

from lava_ros.simulation.accuracy import KERNELS
from lava_ros.simulation.particles import layout
from lava_ros.simulation.particles.kernels import (
    bessel,
    k0_within,
    smoothing_kernel,
    SQUARED_SUPPORT,
)


def evaluate(values, one, two, three):
    """Return the values of three device functions, in one kernel, shape [3, count]."""

    @wp.kernel(module='unique')
    def apply(x: wp.array(dtype=wp.float64), y: wp.array(dtype=wp.vec3d)):
        i = wp.tid()
        y[i] = wp.vec3d(one(x[i]), two(x[i]), three(x[i]))

    x = wp.array(values, dtype=wp.float64, device='cpu')
    y = wp.zeros(len(values), dtype=wp.vec3d, device='cpu')
    wp.launch(apply, dim=len(values), inputs=[x], outputs=[y], device='cpu')
    return y.numpy().T


@pytest.mark.parametrize('name', KERNELS)
def test_kernel_norm_stiffness_and_slope_fit_its_shape(name):
    kernel = smoothing_kernel(name, wp.float64)
    parts = kernel.shape, kernel.slope, kernel.excess
    q = (np.arange(20000) + 0.5) / 20000
    shape, *_ = evaluate(q, *parts)
    integral = kernel.norm * (2 * math.pi * q * shape).sum() / 20000
    assert integral == pytest.approx(1.0, abs=1e-6)
    waves = np.linspace(0.5, 30.0, 600)
    transform = [
        kernel.norm * 2 * math.pi * (q * shape * special.j0(w * q)).sum() / 20000 for w in waves
    ]
    rates = waves**2 * np.array(transform)
    assert kernel.stiffness == pytest.approx(rates.max(), rel=2e-3)
    q, step = np.linspace(0.05, 0.95, 50), 1e-6
    difference = evaluate(q + step, *parts)[0] - evaluate(q - step, *parts)[0]
    assert evaluate(q, *parts)[1] * q == pytest.approx(difference / (2 * step), rel=1e-6)


@pytest.mark.parametrize('name', ['wendland', 'spiky'])
@pytest.mark.parametrize('ratio', [2.5, 3.0, 4.0, 6.0])
def test_excess_corrects_the_sum_over_a_lattice(name, ratio):
    """The sum over a square or hexagonal lattice, less the excess, is the thickness."""
    kernel = smoothing_kernel(name, wp.float64)
    parts = kernel.shape, kernel.slope, kernel.excess
    i, j = np.meshgrid(np.arange(-20, 21), np.arange(-20, 21))
    side = math.sqrt(2 / math.sqrt(3))
    for x, y in ((i, j), (side * (i + 0.5 * j), side * math.sqrt(0.75) * j)):
        q = np.hypot(x, y).ravel() / ratio
        total = kernel.norm / ratio**2 * evaluate(q[q < 1], *parts)[0].sum()
        ((excess,),) = evaluate([1 / (total * ratio**2)], *parts)[2:]
        corrected = total * (1 - excess)
        assert abs(corrected - 1) < 0.2 * (total - 1) + 2e-6


def test_arrays_have_an_item_for_each_of_their_indices():
    """An index beyond an array would write to memory of others."""
    last = {
        item.name: (re.findall('[A-Z_]+', text.partition(':')[0])[-1], item)
        for item in fields(layout.Arrays)
        if (text := item.metadata.get('text', '').partition(' [')[0]).startswith('by ')
    }
    assert {'clock', 'counts', 'rates'} <= set(last)
    for index, item in last.values():
        assert item.metadata['declaration'].shape == (getattr(layout, index) + 1,), item.name


def test_bessel_functions_match_scipy():
    x = np.concatenate([np.geomspace(1e-6, 2.0, 200), np.linspace(2.0, 60.0, 200)])
    k0, x_k1 = bessel(wp.float64)
    assert np.abs(evaluate(0.25 * x**2, k0, x_k1, k0)[0] - special.k0(x)).max() < 2e-7
    assert np.abs(evaluate(x, k0, x_k1, k0)[1] - x * special.k1(x)).max() < 2e-7


def k0_of(real, support, squares):
    """Return K0 of squared distances in the units of ``K0Within``, and of a support times k."""
    within = k0_within(real)

    @wp.kernel(module='unique')
    def weigh(support: real, squares: wp.array(dtype=real), weights: wp.array(dtype=real)):
        i = wp.tid()
        weights[i] = within.at(within.powers_of(support), squares[i])

    squares = wp.array(squares, dtype=real, device='cpu')
    weights = wp.zeros_like(squares)
    wp.launch(weigh, dim=len(squares), inputs=[support, squares, weights], device='cpu')
    return weights.numpy()


@pytest.mark.parametrize('support', [0.05, 0.3, 1.0, 3.0, 5.0, 12.0, 30.0])
def test_k0_fit_is_accurate_within_the_support(support):
    squares = np.geomspace(1.0 / SQUARED_SUPPORT, 0.999 * SQUARED_SUPPORT, 1000)
    exact = special.k0(support * np.sqrt(squares / SQUARED_SUPPORT))
    assert k0_of(wp.float64, support, squares) == pytest.approx(exact, rel=1e-6, abs=3e-7)
    tolerance = 4e-4 if support <= 5.0 else 2e-3
    assert k0_of(wp.float32, support, squares) == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize('support', [1e-6, 1e3, 1e9])
def test_k0_is_finite_for_any_thickness(support):
    squares = np.geomspace(1.0 / SQUARED_SUPPORT, SQUARED_SUPPORT, 100)
    weights = k0_of(wp.float32, support, squares)
    assert np.isfinite(weights).all()
    assert (weights >= 0.0).all()
    assert weights.max() < 10.0
