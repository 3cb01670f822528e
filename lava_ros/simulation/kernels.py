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

"""Smoothing kernels in two dimensions and the Bessel functions of the Green's function.

Each smoothing kernel of radius l is W(r) = norm / l^2 * shape(r / l), and its gradient is
norm / l^4 * slope(r / l) * (x_i - x_j), with slope(q) = shape'(q) / q. Both are 0 from q = 1 on,
so that sums need not ask: threads that go different ways wait for each other.
"""

from collections.abc import Sequence
from functools import lru_cache
import math
from typing import Any, NamedTuple

import warp as wp

from lava_ros.simulation.compiled import exp2, one_less

_WIDE_WENDLAND = """
    wide left = 1.0f - distance * inverse;
    left = left > 0.0f ? left : none;
    const wide slopes = volume * (left * left * left);
    const wide shapes = slopes * left * (5.0f - 4.0f * left);
"""

#: log2(e^x K0(x)), x = 2 sqrt(s), as a polynomial of log2 s, its highest power first.
_K0 = (
    -1.2741719e-08,
    -4.5190392e-07,
    1.42949739e-06,
    0.000170826538,
    -0.00285269651,
    -0.228058267,
    -0.248646405,
)

#: log2(1.5 + t) and 2^(0.5 + t) for t from -0.5 to 0.5, to 2.4e-6 and 1.1e-7.
_LOG2 = (
    -0.0245685347,
    0.0439074798,
    -0.07079686,
    0.141724736,
    -0.320613035,
    0.961820821,
    0.584962501,
)
_EXP2 = (
    0.00189375406,
    0.0136839756,
    0.0784939031,
    0.339723902,
    0.980258154,
    1.41421367,
)


def _wide_polynomial(name: str, x: str, powers: Sequence[float]) -> str:
    """C++ that makes a wide polynomial, its highest power first."""
    first, *rest = (f'({power!r}f)' for power in powers)
    steps = (f'{name} = {name} * {x} + {power};' for power in rest)
    return '\n    '.join((f'wide {name} = none + {first};', *steps))


#: C++ that makes wide ``weights`` K0(2 sqrt(s)) of a wide ``s`` > 0 that is no denormal (wide.py).
WIDE_K0 = f"""
    whole bits;
    __builtin_memcpy(&bits, &s, 32);
    const wide power = __builtin_convertvector((bits >> 23) - 127, wide);
    bits = (bits & 0x7fffff) | 0x3f800000;
    wide t;
    __builtin_memcpy(&t, &bits, 32);
    t -= 1.5f;
    {_wide_polynomial('log', 't', _LOG2)}
    const wide y = power + log;
    {_wide_polynomial('k', 'y', _K0)}
    k -= 2.88539008f * __builtin_elementwise_sqrt(s);
    k = k > -126.0f ? k : none - 126.0f;
    const wide below = __builtin_elementwise_floor(k);
    t = k - below - 0.5f;
    {_wide_polynomial('weights', 't', _EXP2)}
    bits = (__builtin_convertvector(below, whole) + 127) << 23;
    __builtin_memcpy(&t, &bits, 32);
    weights *= t;
"""


class SmoothingKernel(NamedTuple):
    """A kernel as device functions of q = r / l.

    Attributes:
        norm: Factor that makes the integral over the plane 1.
        shape: Device function, the kernel over ``norm``.
        slope: Device function, the derivative of ``shape`` over q.
        terms: Device function of a volume, r and 1 / l: the volume times ``shape``, and times
            ``slope`` over ``factor``. The two have factors in common.
        factor: What ``terms`` leaves out of ``slope``.
        wide_terms: C++ that makes wide ``shapes`` and ``slopes``, what ``terms`` gives, of a wide
            ``volume`` and ``distance`` and of ``inverse`` (wide.py); None where there is none.
        stiffness: Largest value of (q l)^2 W^(q), W^ the kernel's Fourier transform: a thickness
            wave with diffusivity D decays at most at the rate D stiffness / l^2, so explicit steps
            are stable up to 2 l^2 / (D stiffness) whatever the particle spacing.
        excess: Device function of V / (h l^2): the relative excess of the sum of V W over evenly
            spaced particles, the own one included, over their thickness. It is what the kernel's
            transform aliases, measured on hexagonal and square lattices (after Dehnen & Aly 2012,
            who take it off the own weight).
    """

    norm: float
    shape: Any
    slope: Any
    terms: Any
    factor: float
    wide_terms: str | None
    stiffness: float
    excess: Any


@lru_cache
def smoothing_kernel(name: str, real: Any, ratio: float = 3.0) -> SmoothingKernel:
    """Return a smoothing kernel by name.

    Args:
        name: ``wendland`` (C2), or ``poly6``, ``spiky``, ``visc``: equations 3.6, 3.7, 3.8.
        real: Warp scalar type to compute in.
        ratio: Kernel radius over particle spacing. It only enters ``visc``, which is infinite at
            r = 0: there its mean over the particle's own disc of area spacing^2 stands in.
    """
    own_disc = 1.0 / (ratio * math.sqrt(math.pi))
    visc_centre = -5.0 + 6.0 * (0.5 - math.log(own_disc)) + 4.5 * own_disc**2

    @wp.func
    def wendland_shape(q: real) -> real:
        p = wp.max(real(1.0) - q, real(0.0))
        return p * p * p * p * (real(5.0) - real(4.0) * p)

    @wp.func
    def wendland_slope(q: real) -> real:
        p = wp.max(real(1.0) - q, real(0.0))
        return p * p * p * real(-20.0)

    @wp.func
    def poly6_shape(q: real) -> real:
        p = wp.max(real(1.0) - q * q, real(0.0))
        return p * p * p

    @wp.func
    def poly6_slope(q: real) -> real:
        p = wp.max(real(1.0) - q * q, real(0.0))
        return real(-6.0) * p * p

    @wp.func
    def spiky_shape(q: real) -> real:
        p = wp.max(real(1.0) - q, real(0.0))
        return p * p * p

    @wp.func
    def spiky_slope(q: real) -> real:
        p = wp.max(real(1.0) - q, real(0.0))
        return real(-3.0) * p * p / wp.max(q, real(1.0e-6))

    @wp.func
    def visc_shape(q: real) -> real:
        if q < real(1.0e-6):
            return real(wp.static(visc_centre))
        p = wp.min(q, real(1.0))
        return real(-4.0) * p * p * p + real(9.0) * p * p - real(5.0) - real(6.0) * wp.log(p)

    @wp.func
    def visc_slope(q: real) -> real:
        p = wp.clamp(q, real(1.0e-6), real(1.0))
        return real(-12.0) * p + real(18.0) - real(6.0) / (p * p)

    @wp.func
    def wendland_excess(x: real) -> real:
        return real(1.25) * x * x * wp.sqrt(x)

    @wp.func
    def spiky_excess(x: real) -> real:
        return real(2.15) * x * wp.sqrt(x)

    @wp.func
    def no_excess(x: real) -> real:
        return real(0.0)

    norms = {'wendland': 7.0, 'poly6': 4.0, 'spiky': 10.0, 'visc': 10.0 / 9.0}
    functions = {
        'wendland': (wendland_shape, wendland_slope, 10.18, wendland_excess),
        'poly6': (poly6_shape, poly6_slope, 6.76, no_excess),
        'spiky': (spiky_shape, spiky_slope, 10.28, spiky_excess),
        'visc': (visc_shape, visc_slope, 13.62, no_excess),
    }

    vec2 = wp.types.vector(2, real)

    what_is_left = one_less(real)

    @wp.func
    def wendland_terms(volume: real, distance: real, inverse: real) -> vec2:
        p = what_is_left(distance, inverse)
        weight = volume * (p * p * p)
        return vec2(weight * p * (real(5.0) - real(4.0) * p), weight)

    shape, slope, *_ = functions[name]

    @wp.func
    def terms(volume: real, distance: real, inverse: real) -> vec2:
        q = distance * inverse
        return vec2(volume * shape(q), volume * slope(q))

    both: tuple[Any, float, str | None] = (terms, 1.0, None)
    if name == 'wendland':
        both = (wendland_terms, -20.0, _WIDE_WENDLAND)
    norm, (stiffness, excess) = norms[name] / math.pi, functions[name][2:]
    return SmoothingKernel(norm, shape, slope, *both, stiffness, excess)


class Bessel(NamedTuple):
    """Modified Bessel functions of the second kind as device functions.

    ``k0`` takes s = (x / 2)^2, which squared distances give without a root, ``x_k1`` takes x > 0.
    """

    k0: Any
    x_k1: Any


@lru_cache
def bessel(real: Any) -> Bessel:
    """Return K0(2 sqrt(s)) and x K1(x).

    In float64, and x K1(x) always, they are good to 2e-7 absolute: polynomials 9.8.1, 9.8.3 and
    9.8.5 to 9.8.8 of Abramowitz & Stegun, Handbook of Mathematical Functions. In float32 K0 is a
    weight of a mean, and the dearest pass is of little else: there it is 2^P e^-x, P a polynomial
    of log2 s fitted to log2(e^x K0), good to 2e-4 of it for x from 0.004 to 20, where it is 1e-9.
    """

    @wp.func
    def i0_small(s: real) -> real:
        t = s / real(3.515625)
        return real(1.0) + t * (real(3.5156229) + t * (real(3.0899424) + t * (real(1.2067492)
               + t * (real(0.2659732) + t * (real(0.0360768) + t * real(0.0045813))))))

    @wp.func
    def i1_over_x_small(x: real) -> real:
        t = x * x / real(14.0625)
        return real(0.5) + t * (real(0.87890594) + t * (real(0.51498869) + t * (real(0.15084934)
               + t * (real(0.02658733) + t * (real(0.00301532) + t * real(0.00032411))))))

    @wp.func
    def k0(s: real) -> real:
        if s <= real(1.0):
            return real(-0.5) * wp.log(s) * i0_small(s) + (real(-0.57721566) + s * (
                real(0.42278420) + s * (real(0.23069756) + s * (real(0.03488590) + s * (
                    real(0.00262698) + s * (real(0.00010750) + s * real(0.00000740)))))))
        half = wp.sqrt(s)
        t = real(1.0) / half
        return wp.exp(real(-2.0) * half) * wp.sqrt(real(0.5) * t) * (real(1.25331414) + t * (
            real(-0.07832358) + t * (real(0.02189568) + t * (real(-0.01062446) + t * (
                real(0.00587872) + t * (real(-0.00251540) + t * real(0.00053208)))))))

    @wp.func
    def x_k1(x: real) -> real:
        if x <= real(2.0):
            t = real(0.25) * x * x
            return x * x * wp.log(real(0.5) * x) * i1_over_x_small(x) + (real(1.0) + t * (
                real(0.15443144) + t * (real(-0.67278579) + t * (real(-0.18156897) + t * (
                    real(-0.01919402) + t * (real(-0.00110404) + t * real(-0.00004686)))))))
        t = real(2.0) / x
        return wp.exp(-x) * wp.sqrt(x) * (real(1.25331414) + t * (real(0.23498619) + t * (
            real(-0.03655620) + t * (real(0.01504268) + t * (real(-0.00780353) + t * (
                real(0.00325614) + t * real(-0.00068245)))))))

    power = exp2(real)

    @wp.func
    def fitted_k0(s: real) -> real:
        y = wp.log2(s)
        p = real(wp.static(_K0[0]))
        for n in range(1, wp.static(len(_K0))):
            p = p * y + real(wp.static(_K0[n]))
        return power(p - real(2.88539008) * wp.sqrt(s))

    return Bessel(fitted_k0 if real is wp.float32 else k0, x_k1)
