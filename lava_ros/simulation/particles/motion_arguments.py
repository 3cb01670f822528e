# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The argument of all kernels of a stage: everything that they read and write."""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects import EFFECTS, Effects
from lava_ros.effects.effect import join_names
from lava_ros.effects.laws import heat_type, law_type
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.particles.cells import cell_frame
from lava_ros.simulation.particles.kernels import smoothing_kernel
from lava_ros.simulation.particles.state import ARRAYS, kinds_of, State
from lava_ros.simulation.particles.terrain import ground_type

#: Thickness over the expected thickness up to which the Helmholtz solve converges fully.
THICKEST = 2.0

#: Fields that kernels read in addition to arrays of ``State``.
_OTHERS = ('arrived', 'ground', 'cells', 'constants', 'law', 'heat')

#: The arrays that effects add, by name.
_MORE_ARRAYS = join_names('arrays', EFFECTS, (*ARRAYS, *_OTHERS))


@lru_cache
def flow_constants_of(real: Any) -> Any:
    """Return the struct of the constants of the flow's equations.

    ``radius`` is the kernel radius [m], ``weight`` is rho g [N/m3], ``stiffness`` the diffusion
    rate of thickness at the kernel's stiffest wave number, over the diffusivity and over the
    diffusion number [1/m2], ``share`` one over the diffusion number, ``reach`` the maximum
    displacement in a step [m], ``gravity`` g [m/s2] and ``thickest`` the thickness up to which
    the lateral stress is solved fully [m].
    """

    @wp.struct
    class FlowConstants:
        radius: real
        weight: real
        stiffness: real
        share: real
        reach: real
        gravity: real
        thickest: real

    return FlowConstants


def flow_constants(scene: Scene, accuracy: Accuracy, radius: float, real: Any) -> Any:
    """Return the constants for a scene, its accuracy and the kernel radius [m]."""
    kernel = smoothing_kernel(accuracy.kernel, real, accuracy.ratio)
    constants = flow_constants_of(real)()
    constants.radius = radius
    constants.weight = scene.lava.density * scene.gravity
    constants.reach = accuracy.courant_number * min(radius, scene.terrain.resolution)
    constants.stiffness = kernel.stiffness / (accuracy.diffusion_number * radius**2)
    constants.share = 1.0 / accuracy.diffusion_number
    constants.gravity = scene.gravity
    constants.thickest = math.inf
    if accuracy.thickness is not None:
        constants.thickest = THICKEST * accuracy.thickness
    return constants


@lru_cache
def arguments_type(real: Any) -> Any:
    """Return the struct that kernels take: arrays of ``State``, ground, cells and constants."""
    kinds = kinds_of(real)
    types = {
        'arrived': wp.array2d(dtype=wp.float32),
        'ground': ground_type(real),
        'cells': cell_frame(real),
        'constants': flow_constants_of(real),
        'law': law_type(real),
        'heat': heat_type(real),
    }
    for name, array in (ARRAYS | _MORE_ARRAYS).items():
        types[name] = wp.array(dtype=kinds[array.dtype])
        if array.is_carried:
            types[f'ordered_{name}'] = types[name]
    members = {'__annotations__': types, '__module__': __name__}
    return wp.struct(type('MotionArguments', (), members))


@lru_cache
def law_arguments_function(real: Any, effects: Effects) -> Any:
    """Return the device function for temperature [K] and age [s], which laws of flow depend on.

    The temperature is the mean around a particle, once ``mean_temperature`` has been computed.
    """
    vec2 = wp.types.vector(2, real)
    vec4 = wp.types.vector(4, real)

    @wp.func
    def law_arguments(i: int, p: vec4, m: arguments_type(real)) -> vec2:
        temperature = p[3]
        if wp.static(effects.any('stiffens')):
            temperature = m.ordered_mean_temperature[i]
        age = real(0.0)
        if wp.static(effects.any('needs_age')):
            age = m.ordered_age[i]
        return vec2(temperature, age)

    return law_arguments


def motion_arguments(state: State, ground: Any, cells: Any, **constants: Any) -> Any:
    """Build the argument of the kernels, valid until an array or the cells are replaced.

    ``constants`` are those of the flow, its law and the heat balance; none for sorting.
    """
    made = arguments_type(state.real)()
    parts = {'ground': ground, 'cells': cells, **constants}
    for name in arguments_type(state.real).vars:
        if name in parts or hasattr(state, name):
            setattr(made, name, parts[name] if name in parts else getattr(state, name))
    return made
