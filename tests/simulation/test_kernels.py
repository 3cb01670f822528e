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
    WIDE_K0,
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
        assert item.metadata['array'].shape == (getattr(layout, index) + 1,), item.name


def test_bessel_functions_match_scipy():
    x = np.concatenate([np.geomspace(1e-6, 2.0, 200), np.linspace(2.0, 60.0, 200)])
    k0, x_k1 = bessel(wp.float64)
    assert np.abs(evaluate(0.25 * x**2, k0, x_k1, k0)[0] - special.k0(x)).max() < 2e-7
    assert np.abs(evaluate(x, k0, x_k1, k0)[1] - x * special.k1(x)).max() < 2e-7


#: C++ that computes K0 of eight squares, as ``over_neighbors`` does.
EIGHT_WEIGHTS = f"""{{
    #pragma clang fp contract(fast)
    typedef float wide __attribute__((vector_size(32)));
    typedef int whole __attribute__((vector_size(32)));
    const wide none = {{}};
    wide squares;
    __builtin_memcpy(&squares, given.data + 8 * i, 32);
    {WIDE_K0}
    __builtin_memcpy(found.data + 8 * i, &weights, 32);
}}"""


def k0_of(real, support, squares, *, is_wide=False):
    """Return K0 of squared distances in the units of ``K0Within``, and of a support times k.

    If it ``is_wide``, eight at a time as in sums on a CPU.
    """
    within, width = k0_within(real), 8 if is_wide else 1
    powers = within.powers

    @wp.func
    def weigh_one(
        i: int, powers: powers, given: wp.array(dtype=real), found: wp.array(dtype=real)
    ):
        found[i] = within.at(powers, given[i])

    @wp.func_native(EIGHT_WEIGHTS)
    def weigh_eight(
        i: int, powers: powers, given: wp.array(dtype=real), found: wp.array(dtype=real)
    ): ...

    weigh_some = weigh_eight if is_wide else weigh_one

    @wp.kernel(module='unique')
    def weigh(support: real, given: wp.array(dtype=real), found: wp.array(dtype=real)):
        weigh_some(wp.tid(), within.powers_of(support), given, found)

    squares = wp.array(squares, dtype=real, device='cpu')
    weights = wp.zeros_like(squares)
    wp.launch(
        weigh, dim=len(squares) // width, inputs=[support, squares, weights], device='cpu'
    )
    return weights.numpy()


@pytest.mark.parametrize('support', [0.05, 0.3, 1.0, 3.0, 5.0, 12.0, 30.0])
def test_k0_fit_is_accurate_within_the_support(support):
    squares = np.geomspace(1.0 / SQUARED_SUPPORT, 0.999 * SQUARED_SUPPORT, 1000)
    exact = special.k0(support * np.sqrt(squares / SQUARED_SUPPORT))
    assert k0_of(wp.float64, support, squares) == pytest.approx(exact, rel=1e-6, abs=3e-7)
    tolerance = 2e-4 if support <= 1.0 else 4e-4 if support <= 5.0 else 2e-3
    for is_wide in (False, True):
        weights = k0_of(wp.float32, support, squares, is_wide=is_wide)
        assert weights == pytest.approx(exact, rel=tolerance)


@pytest.mark.parametrize('support', [1e-6, 1e3, 1e9])
def test_k0_is_finite_for_any_thickness(support):
    squares = np.geomspace(1.0 / SQUARED_SUPPORT, SQUARED_SUPPORT, 104)
    for is_wide in (False, True):
        weights = k0_of(wp.float32, support, squares, is_wide=is_wide)
        assert np.isfinite(weights).all()
        assert (weights >= 0.0).all()
        assert weights.max() < 10.0
