# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What the kernels of a stage read and write, in one argument."""

from functools import lru_cache
import math
from typing import Any

import warp as wp

from lava_ros.effects import EFFECTS
from lava_ros.effects.effect import join_names
from lava_ros.effects.laws import heat_type, law_type
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.cells import cell_frame
from lava_ros.simulation.kernels import smoothing_kernel
from lava_ros.simulation.state import ARRAYS, kinds_of, State
from lava_ros.simulation.terrain import ground_type

#: Thickness over the expected one up to which the Helmholtz solve converges in full.
THICKEST = 2.0

#: What kernels read beside arrays of ``State``.
_OTHERS = ('arrived', 'ground', 'cells', 'constants', 'law', 'heat')

#: The arrays that effects add, by name.
_MORE_ARRAYS = join_names('arrays', EFFECTS, (*ARRAYS, *_OTHERS))


@lru_cache
def flow_constants_of(real: Any) -> Any:
    """What the flow's equations need beside the particles.

    ``radius`` is the kernel's [m], ``weight`` is rho g [N/m3], ``stiffness`` the rate at which
    thickness diffuses at the kernel's stiffest wave number, over the diffusivity and over the
    diffusion number [1/m2], ``share`` one over the diffusion number, ``reach`` the largest
    displacement in a step [m], ``gravity`` g [m/s2] and ``thickest`` the thickness up to which
    the lateral stress is solved for in full [m].
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
    """Collect the constants from a scene, its accuracy and the kernel's radius [m]."""
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
    """What kernels read and write: arrays of ``State``, the ground, the cells, constants."""
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


def motion_arguments(state: State, ground: Any, cells: Any, **constants: Any) -> Any:
    """Collect what kernels read and write, for as long as the arrays and the cells are these.

    ``constants`` are those of flow, its law and the heat balance; none to sort particles.
    """
    made = arguments_type(state.real)()
    parts = {'ground': ground, 'cells': cells, **constants}
    for name in arguments_type(state.real).vars:
        if name in parts or hasattr(state, name):
            setattr(made, name, parts[name] if name in parts else getattr(state, name))
    return made
