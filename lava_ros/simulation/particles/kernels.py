# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Smoothing kernels in two dimensions and the Bessel functions of the Green's function.

Each smoothing kernel of radius l is W(r) = norm / l^2 * shape(r / l), and its gradient is
norm / l^4 * slope(r / l) * (x_i - x_j), with slope(q) = shape'(q) / q. Both are 0 for q >= 1, so
that sums need no branch, at which the threads of a warp would wait for each other.
"""

from collections.abc import Sequence
from functools import lru_cache
import math
from typing import Any, NamedTuple

import warp as wp

from lava_ros.simulation.backend.compiled import on_cuda

_WIDE_WENDLAND = """
    wide left = 1.0f - distance * inverse;
    left = left > 0.0f ? left : none;
    const wide squared = left * left;
    const wide slopes = volume * (squared * left);
    const wide shapes = slopes * (squared - 1.25f * left);
"""

#: The hardware clamps a sum to the range 0 to 1; the compiler does not make use of it.
_ONE_LESS = """
    float left;
    asm("fma.rn.ftz.sat.f32 %0, %1, %2, %3;" : "=f"(left) : "f"(-a), "f"(b), "f"(1.0f));
    return left;"""

#: Octaves of squared distances, up to the support's, in which K0 varies: starting at a twelfth of
#: the support, less than the radius of a particle's own disc.
_OCTAVES = 7.0

#: The square of the support in the units of ``K0Within``, whose octaves lie to both sides of 1.
SQUARED_SUPPORT = 2.0 ** (_OCTAVES / 2.0)

#: The square below which distances are not distinguished.
MIN_SQUARED_DISTANCE = 1.0 / SQUARED_SUPPORT

#: log2(e^x K0(x)), x = 2 sqrt(s), as a polynomial of log2 s, its highest power first, to 2e-4 for
#: x from 0.004 to 20.
_K0 = (
    -1.2741719e-08, -4.5190392e-07, 1.42949739e-06, 0.000170826538, -0.00285269651, -0.228058267,
    -0.248646405,
)

#: 2^(t/2) for t from -3.5 to 3.5, to 1.4e-4 2^(0.15 t).
_ROOT = (
    4.307390714808505e-05, 0.0006464656938273085, 0.006940395607739791, 0.059848329705461195,
    0.34654181226319425, 1.0001396563621365,
)

#: Range of the support over the thickness that is distinguished: below it K0 is practically
#: constant, above it K0 is negligible at any neighbour.
_MIN_RADII, _MAX_RADII = 0.01, 1000.0

#: log2(1.5 + t) and 2^(0.5 + t) for t from -0.5 to 0.5, to 2.4e-6 and 1.1e-7.
_LOG2 = (
    -0.0245685347, 0.0439074798, -0.07079686, 0.141724736, -0.320613035, 0.961820821, 0.584962501,
)
_EXP2 = 0.00189375406, 0.0136839756, 0.0784939031, 0.339723902, 0.980258154, 1.41421367


def _wide_polynomial(name: str, x: str, powers: Sequence[float]) -> str:
    """Return the C++ of a wide polynomial, its highest power first."""
    first, *rest = (f'({power!r}f)' for power in powers)
    steps = (f'{name} = {name} * {x} + {power};' for power in rest)
    return '\n    '.join((f'wide {name} = none + {first};', *steps))


#: C++ that computes wide ``weights`` from wide ``squares`` without denormals, and ``powers``: the
#: float32 values of ``K0Within.at`` (simd.py).
WIDE_K0 = f"""
    whole bits;
    __builtin_memcpy(&bits, &squares, 32);
    const wide power = __builtin_convertvector((bits >> 23) - 127, wide);
    bits = (bits & 0x7fffff) | 0x3f800000;
    wide t;
    __builtin_memcpy(&t, &bits, 32);
    t -= 1.5f;
    {_wide_polynomial('log', 't', _LOG2)}
    const wide y = power + log;
    wide k = none + powers[0];
    for (int n = 1; n < {len(_ROOT)}; ++n)
        k = k * y + powers[n];
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
            ``slope``, each divided by its constant in ``factors``. The products share factors.
        factors: Constant factors that ``terms`` omits from ``shape`` and ``slope``.
        wide_terms: C++ that computes wide ``shapes`` and ``slopes``, the values of ``terms``, from
            a wide ``volume`` and ``distance`` and from ``inverse`` (simd.py); None if missing.
        stiffness: Largest value of (q l)^2 W^(q), W^ the kernel's Fourier transform: a thickness
            wave with diffusivity D decays at most at the rate D stiffness / l^2, so explicit steps
            are stable up to 2 l^2 / (D stiffness) whatever the particle spacing.
        excess: Device function of V / (h l^2): the relative excess of the sum of V W over evenly
            spaced particles, including the particle itself, over their thickness. It is the
            aliasing of the kernel's transform, measured on hexagonal and square lattices (after
            Dehnen & Aly 2012, who subtract it from the particle's own weight).
        excess_power: Power of its argument to which ``excess`` is proportional.
    """

    norm: float
    shape: Any
    slope: Any
    terms: Any
    factors: tuple[float, float]
    wide_terms: str | None
    stiffness: float
    excess: Any
    excess_power: float


@lru_cache
def _one_less(real: Any) -> Any:
    """Return the device function max(1 - a b, 0), a and b >= 0: one instruction in float32."""
    plain = 'return a * b < 1 ? 1 - a * b : 0;'

    @wp.func_native(on_cuda(_ONE_LESS, plain) if real is wp.float32 else plain)
    def left(a: real, b: real) -> real: ...

    return left


@lru_cache
def smoothing_kernel(name: str, real: Any) -> SmoothingKernel:
    """Return a smoothing kernel by name.

    Args:
        name: ``wendland`` (C2), or ``poly6``, ``spiky``: equations 3.6, 3.7.
        real: Warp scalar type to compute in.
    """

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
    def wendland_excess(x: real) -> real:
        return real(1.25) * x * x * wp.sqrt(x)

    @wp.func
    def spiky_excess(x: real) -> real:
        return real(2.15) * x * wp.sqrt(x)

    @wp.func
    def no_excess(x: real) -> real:
        return real(0.0)

    kernels = {
        'wendland': (7.0, wendland_shape, wendland_slope, (10.18, wendland_excess, 2.5)),
        'poly6': (4.0, poly6_shape, poly6_slope, (6.76, no_excess, 1.0)),
        'spiky': (10.0, spiky_shape, spiky_slope, (10.28, spiky_excess, 1.5)),
    }
    norm, shape, slope, others = kernels[name]
    vec2 = wp.types.vector(2, real)
    what_is_left = _one_less(real)

    @wp.func
    def wendland_terms(volume: real, distance: real, inverse: real) -> vec2:
        p = what_is_left(distance, inverse)
        square = p * p
        weight = volume * (square * p)
        return vec2(weight * (square - real(1.25) * p), weight)

    @wp.func
    def terms(volume: real, distance: real, inverse: real) -> vec2:
        q = distance * inverse
        return vec2(volume * shape(q), volume * slope(q))

    both: tuple[Any, tuple[float, float], str | None] = (terms, (1.0, 1.0), None)
    if name == 'wendland':
        both = (wendland_terms, (-4.0, -20.0), _WIDE_WENDLAND)
    return SmoothingKernel(norm / math.pi, shape, slope, *both, *others)


@lru_cache
def bessel(real: Any) -> tuple[Any, Any]:
    """Return the device functions K0(2 sqrt(s)) and x K1(x), of s = (x / 2)^2 and x > 0.

    Squared distances give s without a root. They are accurate to 2e-7 absolute: polynomials 9.8.1,
    9.8.3 and 9.8.5 to 9.8.8 of Abramowitz & Stegun, Handbook of Mathematical Functions.
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

    return k0, x_k1


class K0Within(NamedTuple):
    """K0(k r) of distances r up to a support, as device functions.

    ``powers_of`` takes the support times k and returns the values that ``at`` needs in addition to
    the squared distance, in units in which the square of the support is ``SQUARED_SUPPORT``.

    Attributes:
        powers: Warp type of the values that depend on k only.
        powers_of: Device function.
        at: Device function, for squared distances of at least ``MIN_SQUARED_DISTANCE``.
    """

    powers: Any
    powers_of: Any
    at: Any


def _powers_of() -> str:
    """Return C++ for the polynomial of log2 K0 around the middle of the octaves.

    In sums over neighbours K0 is the weight of a mean, and most of the work of the slowest pass.
    The slowest operations are not multiplications but those for which a GPU has one unit in
    eight: log2, 2^x and the root. So all of log2 K0 is one polynomial of log2 r^2, without a
    root: the sum of the polynomials of log2(e^x K0) around the middle of the octaves, and of x.
    """
    degree = len(_K0) - 1
    lines = [f'float p{n} = {power!r}f;' for n, power in enumerate(_K0)]
    lines += [
        f'p{m} += p{m - 1} * shift;'
        for n in range(degree)
        for m in range(1, degree + 1 - n)
    ]
    # without the sixth power, which changes K0 by 2e-5 at most
    scale = -math.log2(math.e) / math.sqrt(SQUARED_SUPPORT)
    powers = [
        f'powers.c[{n}] = p{n + 1} + {scale * root!r}f * support;' for n, root in enumerate(_ROOT)
    ]
    min_radii, max_radii = (f'{radii!r}f' for radii in (_MIN_RADII, _MAX_RADII))
    return f"""
    const float support = x < {min_radii} ? {min_radii} : x > {max_radii} ? {max_radii} : x;
    const float shift = wp::log2(support * support * {0.25 / SQUARED_SUPPORT!r}f);
    {' '.join(lines)}
    wp::vec_t<6, wp::float32> powers;
    {' '.join(powers)}
    return powers;
"""


@lru_cache
def _exp2(real: Any) -> Any:
    """Return the device function 2^x."""
    cuda = 'return exp2f(x);' if real is wp.float32 else 'return exp2(x);'
    log2 = f'wp::{real.__name__}(0.6931471805599453)'

    @wp.func_native(on_cuda(cuda, f'return wp::exp({log2} * x);'))
    def power(x: real) -> real: ...

    return power


@lru_cache
def k0_within(real: Any) -> K0Within:
    """Return K0 for sums over neighbours.

    In float64 it is K0 of ``bessel``. In float32 it is accurate to 2e-4 for k times the support
    from 0.05 to 1, to 4e-4 up to 5, and to 2e-3 up to 30, where only a particle's own weight
    counts.
    """
    if real is wp.float64:
        k0, _ = bessel(real)

        @wp.func
        def quarter_of(x: real) -> real:
            u = wp.max(x, real(_MIN_RADII))
            return real(wp.static(0.25 / SQUARED_SUPPORT)) * u * u

        @wp.func
        def exact(quarter: real, square: real) -> real:
            return k0(quarter * square)

        return K0Within(real, quarter_of, exact)

    vec6 = wp.types.vector(len(_ROOT), real)
    power = _exp2(real)

    @wp.func_native(_powers_of())
    def powers_of(x: real) -> vec6: ...

    @wp.func
    def at(powers: vec6, square: real) -> real:
        y = wp.log2(square)
        p = powers[0]
        for n in range(1, wp.static(len(_ROOT))):
            p = p * y + powers[n]
        return power(p)

    return K0Within(vec6, powers_of, at)
