# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Functions in place of those of Warp, for laws in loops that a CPU vectorises.

Compilers do not vectorise a loop that calls ``exp`` of the C library. The laws take the module
whose functions they call as an argument, so these polynomials need no other laws. Errors are
below 2e-7 of the result.
"""

from typing import Any

import warp as wp

from lava_ros.simulation.backend.compiled import on_cuda

# 2^n e^r with |r| <= ln 2 / 2 (Cephes, expf)
_EXP = """
    x = x < -87.0f ? -87.0f : (x > 88.0f ? 88.0f : x);
    const float n = __builtin_rintf(x * 1.44269504f);
    const float r = (x - n * 0.693145752f) - n * 1.42860677e-6f;
    float p = 1.3981999507e-3f;
    p = p * r + 8.3334519073e-3f;
    p = p * r + 4.1665795894e-2f;
    p = p * r + 1.6666665459e-1f;
    p = p * r + 5.0000001201e-1f;
    p = p * r * r + r + 1.0f;
    return p * __builtin_bit_cast(float, ((int)n + 127) << 23);
"""

# n ln 2 + ln m with m between sqrt(1/2) and sqrt(2) (Cephes, logf)
_LOG = """
    const int bits = __builtin_bit_cast(int, x);
    const int n = (bits - 0x3f3504f3) >> 23;
    const float f = __builtin_bit_cast(float, bits - (n << 23)) - 1.0f;
    float p = 7.0376836292e-2f;
    p = p * f - 1.1514610310e-1f;
    p = p * f + 1.1676998740e-1f;
    p = p * f - 1.2420140846e-1f;
    p = p * f + 1.4249322787e-1f;
    p = p * f - 1.6668057665e-1f;
    p = p * f + 2.0000714765e-1f;
    p = p * f - 2.4999993993e-1f;
    p = p * f + 3.3333331174e-1f;
    const float square = f * f;
    return p * f * square - 0.5f * square + f + n * 0.6931471806f;
"""


@wp.func_native(on_cuda('return expf(x);', _EXP))
def _exp(x: wp.float32) -> wp.float32: ...


@wp.func_native(on_cuda('return logf(x);', _LOG))
def _log(x: wp.float32) -> wp.float32: ...


@wp.func
def _pow(base: wp.float32, power: wp.float32) -> wp.float32:
    return _exp(power * _log(base))


class _VectorMath:
    """Warp, except ``exp``, ``log`` (of normal numbers > 0) and ``pow`` (bases > 0)."""

    exp, log, pow = _exp, _log, _pow

    def __getattr__(self, name: str) -> Any:
        return getattr(wp, name)


#: Module that laws in vectorised loops use in place of Warp.
VECTOR_MATH = _VectorMath()
