# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A time step of the flow on cells: fluxes through faces, in stages of super-time-stepping.

Between two cells of thickness a and b, whose surfaces differ by S, the flux per cell area is

    rho g / (3 mu) cos^4 (a + b) (a^2 + b^2) / 4 * S / cell^2,

h^3 in its mean over the thicknesses from a to b. It is central, of second order, and steps are
short enough for it. Lava whose speed is not proportional to the slope has the speed of
its law (effects/laws.py) at the mean thickness, times the same mean of h^3 over the cube of it.

A step has several stages (RKL2: Meyer, Balsara & Aslam 2014, doi:10.1016/j.jcp.2013.08.021), in
float32. The recursion is that of the thickness passed through each face, not that of the
thickness: what leaves a cell enters the next one, and the thickness in float64 has no error of
rounding in its sum.

With lateral stress (``helmholtz``) the local speed u0 at each face, the flux over the
thickness h that it carries, is replaced by the solution of

    d h^2 / H (u - u0) = sum over the four faces around of h' (u' - u) / cell^2

with d of effects/laws.py, H the mean of h^3 and h' the thickness between two faces, sideways the
harmonic mean: the finite volumes of the equation in simulation/step/effects/helmholtz.py on the
grids of the faces, one for each direction. The left side of u0 is the weight of the lava, and the
matrix is symmetric, so the energy does not grow. The speed hardly changes from a face to the next,
so h is limited: a mean would pile lava up behind a front.

On a CPU a step is one function whose loops over rows the compiler vectorises. It needs pointers
that do not overlap and no branches, so it is C++.
"""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.column import column_type
from lava_ros.effects.laws import LATERAL_DRAG, MAX_SWEEPS, REDUCTION
from lava_ros.simulation.backend.compiled import callable_name
from lava_ros.simulation.backend.vector_math import VECTOR_MATH
from lava_ros.simulation.cells import flow_source, stress_source
from lava_ros.simulation.cells.limiter import KOREN
from lava_ros.simulation.cells.spans import COLUMNS, spans_function
from lava_ros.simulation.cells.state import Cells, FaceLaw
from lava_ros.simulation.cells.threads import CLEAR, shared, SLOTS

#: Maximum number of stages of a step.
MAX_STAGES = 99

#: Maximum displacement of lava in a step, in cells.
DISPLACEMENT = 2.0

#: Maximum displacement in a step of lava that carries heat, which passes on at most the heat of a
#: cell, and of lava with lateral stress, in cells. Stages of longer steps would amplify waves that
#: a common speed carries from cell to cell.
HEATED_DISPLACEMENT, LATERAL_DISPLACEMENT = 0.8, 0.4

#: Maximum ratio of the lengths of consecutive steps.
GROWTH = 1.5

#: Fall of the surface between two cells over the mean thickness above which steps are no shorter:
#: down walls lava is limited by what the upper cell has.
_STEEPEST = 10.0

#: Fraction of the largest stable step that a step of a number of stages has.
_STABLE = 0.9

#: Factor by which the sweeps of all stages but the first reduce the error of their initial guess,
#: the speeds of the previous stage.
_LATER_REDUCTION = 1e-2

#: Maximum number of passes that limit what cells give.
_LIMITS = 4


def most_displaced(effects: Effects, *, is_heated: bool) -> float:
    """Return the maximum displacement of lava in a step, in cells."""
    if effects.any('is_lateral'):
        return LATERAL_DISPLACEMENT
    return HEATED_DISPLACEMENT if is_heated else DISPLACEMENT


@lru_cache
def face_law(effects: Effects) -> Any:
    """Return the device function of the speed at a face, None if lava is Newtonian.

    Of weight [N/m3], thickness [m], gradients of surface and ground along and across the flux, the
    viscosity [Pa s] and the yield strength [Pa] it returns the mobility on the map, u / |grad
    S|, and its bound (``laws.speed_function``) [m/s].
    """
    real = wp.float32
    vec2 = wp.types.vector(2, real)

    @wp.func
    def viscosity(law: FaceLaw, temperature: real) -> real:
        return law.viscosity

    @wp.func
    def held(law: FaceLaw, column: column_type(real)) -> real:
        return law.strength

    strength = held if effects.having('strength') else None
    speed = effects.function(
        'speed', VECTOR_MATH, real, FaceLaw, column_type(real), viscosity, strength
    )
    if speed is None:
        return None
    along = effects.function('along', real)
    column_struct = column_type(real)

    @wp.func
    def at_face(
        law: FaceLaw, weight: real, height: real, surface_x: real, surface_y: real,
        ground_x: real, ground_y: real, viscosity: real, strength: real,
    ) -> vec2:
        own = law
        own.viscosity = viscosity
        own.strength = strength
        surface = vec2(surface_x, surface_y)
        column = column_struct()
        column.thickness = height
        column.normal_thickness = height
        column.slope = wp.length(surface)
        on_map = real(1.0)
        if wp.static(along is not None):
            layer = along(height, surface, vec2(ground_x, ground_y))
            column.normal_thickness = layer[0]
            column.slope = layer[1]
            on_map = layer[2]
        return on_map * speed(own, weight, column)

    return at_face


@lru_cache
def step_function(effects: Effects, *, is_uniform: bool, blocks: int = 1) -> Any:
    """Return the device function that takes a step.

    Args:
        effects: The effects that are on.
        is_uniform: True if all lava has the same viscosity, that of the first cell. Otherwise it
            carries heat, and steps are shorter.
        blocks: Number of blocks of a world on a GPU.
    """
    law = face_law(effects)
    faces = flow_source.NEWTONIAN_FACE, flow_source.NEWTONIAN
    if law is not None:
        faces = flow_source.LAW_FACE, flow_source.BY_LAW
    is_lateral = effects.any('is_lateral')
    is_steep = effects.function('factor', wp.float32) is not None
    own = 'fluid * (a * fluidity[p] + b * fluidity[q]) / (a + b + 1e-30f)'
    parts = {
        'SHARED': shared(blocks),
        'SOLVER': stress_source.LATERAL_SOLVER if is_lateral else '',
        'EVALUATE': stress_source.LATERAL_STAGE if is_lateral else '',
        'FLOW': stress_source.LATERAL_FLUX if is_lateral else flow_source.OWN_FLUX,
        'KOREN': KOREN,
        'ON_SLOPE': '* steep[p]' if is_steep else '',
        'DRAG': LATERAL_DRAG,
        'MAX_SWEEPS': MAX_SWEEPS,
        'LOGARITHM': math.log(2.0 / REDUCTION),
        'LATER': math.log(2.0 / _LATER_REDUCTION),
        'COLUMNS': COLUMNS,
        'SLOTS': SLOTS,
        'CLEAR_OWN': CLEAR.replace('WHICH', 'slots'),
        'CLEAR': CLEAR.replace('WHICH', 'others'),
        'FLUX': ''.join(faces),
        'HELD': '0.0f' if law is None else 'held[p]',
        'FLUID': 'fluid' if is_uniform else own,
        'UNIFORM': '* fluidity[0]' if is_uniform else '',
        'FACTOR': '* factor[p]' if is_steep else '',
        'SIDE': 'factor' if law is None else 'cross',
        'LAG': '0' if law is None else '1',
        'LAW': '' if law is None else callable_name(law),
        'MAX_STAGES': MAX_STAGES,
        'DISPLACEMENT': most_displaced(effects, is_heated=not is_uniform),
        'GROWTH': GROWTH,
        'STABLE': _STABLE,
        'LIMITS': _LIMITS,
        'STEEPEST': f'{_STEEPEST}f',
    }
    code = flow_source.STEP
    for name, text in parts.items():
        code = code.replace(name, str(text))

    find_spans = spans_function(Cells, blocks)

    @wp.func_native(f'{{{code}}}')
    def take_step(s: Cells): ...

    @wp.func
    def step(s: Cells):
        if wp.static(law is not None):  # noqa: SIM102, what is called is compiled before
            if s.rows < 0:
                law(s.law, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        find_spans(s)
        take_step(s)

    return step
