# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Functions that loops of a CPU vectorise, and laws that use them."""

import numpy as np
import pytest
import warp as wp

from lava_ros.simulation.backend.vector_math import VECTOR_MATH

#: Arguments of each function.
ARGUMENTS = {
    'exp': np.linspace(-87.0, 88.0, 20_001),
    'log': np.concatenate([np.geomspace(1e-37, 1e37, 20_001), np.linspace(0.5, 2.0, 20_001)]),
}


@pytest.mark.parametrize('name', ARGUMENTS)
def test_vector_function_is_exact_to_rounding(name):
    function = getattr(VECTOR_MATH, name)

    @wp.kernel(module='unique', enable_backward=False)
    def evaluate(x: wp.array(dtype=float), y: wp.array(dtype=float)):
        y[wp.tid()] = function(x[wp.tid()])

    x = ARGUMENTS[name].astype(np.float32)
    y = wp.empty(len(x), dtype=float, device='cpu')
    wp.launch(evaluate, dim=len(x), inputs=[wp.array(x, device='cpu'), y], device='cpu')
    exact = getattr(np, name)(x.astype(np.float64))
    np.testing.assert_allclose(y.numpy(), exact, rtol=3e-7, atol=6e-8 if name == 'log' else 0.0)


def test_vector_power_is_exact_to_rounding():
    power = VECTOR_MATH.pow

    @wp.kernel(module='unique', enable_backward=False)
    def evaluate(x: wp.array(dtype=float), y: wp.array(dtype=float)):
        y[wp.tid()] = power(x[wp.tid()], -2.5)

    x = np.linspace(1e-3, 1.0, 1001, dtype=np.float32)
    y = wp.empty(len(x), dtype=float, device='cpu')
    wp.launch(evaluate, dim=len(x), inputs=[wp.array(x, device='cpu'), y], device='cpu')
    np.testing.assert_allclose(y.numpy(), x.astype(np.float64) ** -2.5, rtol=3e-6)


def test_everything_else_is_that_of_warp():
    assert VECTOR_MATH.sqrt is wp.sqrt
