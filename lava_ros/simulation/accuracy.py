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

"""The knobs that trade accuracy for time."""

from dataclasses import dataclass, fields
import math
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.scene import Scene

#: Smoothing kernels by name: equations 3.6 to 3.8 of the paper, and Wendland C2.
KERNELS = ('wendland', 'poly6', 'spiky', 'visc')

#: Thickness from which on ground counts as covered [m].
COVERED = 0.1

#: Least thickness that a flow is expected to have [m].
LEAST_THICKNESS = 1e-6

#: Largest ratio of viscosities at solidus and vent that counts: what is stiffer has stopped.
MOST_STIFFENING = 1e4

FORMULATIONS = ('corrected', 'as-published')

INTEGRATORS = ('rkl2', 'euler')

PRECISIONS = ('float32', 'float64')

GRADIENTS = ('energy', 'difference', 'balanced')


@dataclass(frozen=True)
class Accuracy:
    """How finely a scene is resolved in space and time.

    Attributes:
        spacing: Distance between neighbouring particles where the flow has its expected thickness
            [m]; None derives it from the width of the flow (``resolution.py``).
        refinement: Particles across the flow over those of preset ``standard``. An explicit
            spacing is taken as it is.
        thickness: Expected thickness of the flow [m], with the spacing it sets the volume of a
            particle; None derives it from discharge and viscosity (``mature_thickness``).
        ratio: Kernel radius over spacing: 3 to 6, neighbours 28 to 113.
        kernel: One of ``wendland``, ``poly6``, ``spiky``, ``visc``.
        raster_ratio: Kernel radius of the output grid over the particles' kernel radius; at least
            one and a half cells are always covered.
        diffusion_number: Rate of the fastest decaying thickness wave times the step: explicit
            steps are stable up to 2.
        courant_number: Largest displacement in a step over the smaller of kernel radius and
            terrain cell.
        longest_step: Longest step [s].
        fixed_step: Step [s] to take whatever the limits say, as the paper does with 0.01 s; None
            follows the limits.
        gradient: Form of the surface's gradient: ``energy``, that of the particles' potential
            energy; ``difference``, of differences between particles, zero on a level surface; or
            ``balanced``, the first as far as the second allows: as accurate, at rest when level,
            at the cost of one more pass over the neighbours (``simulation/flow.py``). With
            inertia it is ``energy``, which keeps the momentum.
        formulation: ``corrected``, or ``as-published``: the velocity by equations 3.36 to 3.44 as
            they are printed, for comparison only.
        deterministic: Whether runs on a GPU are identical to the bit; on the CPU they always are.
        symmetric: Whether vents emit particles eight at a time (fissures four), in places that
            have the grid's symmetries: a scene mirrored or turned by 90 degrees then gives the
            same flow, mirrored or turned. Otherwise particles come out one by one.
        integrator: ``rkl2``, second-order super-time-stepping, or ``euler``, the reference.
        precision: ``float32``, or ``float64`` as the reference.
    """

    spacing: float | None = None
    refinement: float = 1.0
    thickness: float | None = None
    ratio: float = 3.0
    kernel: str = 'wendland'
    raster_ratio: float = 1.2
    diffusion_number: float = 1.6
    courant_number: float = 0.5
    longest_step: float = 60.0
    fixed_step: float | None = None
    gradient: str = 'energy'
    formulation: str = 'corrected'
    deterministic: bool = False
    symmetric: bool = False
    integrator: str = 'rkl2'
    precision: str = 'float32'

    def __post_init__(self) -> None:
        """Validate every field.

        Raises:
            LavaError: A field is not usable.
        """
        optional: dict[str, dict[str, Any]] = {
            'spacing': {'at_least': 1e-6, 'at_most': 1e7, 'unit': 'm'},
            'thickness': {'at_least': 1e-9, 'at_most': 1e5, 'unit': 'm'},
            'fixed_step': {'at_least': 1e-9, 'at_most': 1e9, 'unit': 's'},
        }
        for name, limit in optional.items():
            value = getattr(self, name)
            if value is not None:
                value = validation.number(f'accuracy.{name}', value, **limit)
                object.__setattr__(self, name, value)
        limits: dict[str, dict[str, Any]] = {
            'refinement': {'at_least': 0.05, 'at_most': 20.0},
            'ratio': {'at_least': 1.5, 'at_most': 12.0},
            'raster_ratio': {'at_least': 1e-3, 'at_most': 2.0},
            'diffusion_number': {'at_least': 1e-4, 'at_most': 2.0},
            'courant_number': {'at_least': 1e-4, 'at_most': 1.0},
            'longest_step': {'at_least': 1e-6, 'at_most': 1e9, 'unit': 's'},
        }
        for name, limit in limits.items():
            value = validation.number(f'accuracy.{name}', getattr(self, name), **limit)
            object.__setattr__(self, name, value)
        validation.choice('accuracy.kernel', self.kernel, KERNELS)
        validation.choice('accuracy.gradient', self.gradient, GRADIENTS)
        validation.choice('accuracy.formulation', self.formulation, FORMULATIONS)
        for name in ('deterministic', 'symmetric'):
            if not isinstance(getattr(self, name), bool):
                raise LavaError(f'accuracy.{name}', getattr(self, name), 'true or false')
        validation.choice('accuracy.integrator', self.integrator, INTEGRATORS)
        validation.choice('accuracy.precision', self.precision, PRECISIONS)


def accuracy_from_dict(data: object) -> Accuracy:
    """Build an ``Accuracy`` from the plain data of a YAML file.

    Raises:
        LavaError: A key is unknown or a value is not usable.
    """
    names = [item.name for item in fields(Accuracy)]
    return Accuracy(**validation.keys('accuracy', data, allowed=names))


def expected_thickness(scene: Scene) -> float:
    """Thickness scale of a flow at its vent, (3 mu Q / (rho g))^(1/4) [m].

    It is the thickness at which spreading balances supply, on a plane (Huppert 1982) as on a slope
    (Lister 1992). Q is the largest discharge of any vent; without one it is 1 m3/s. mu is the
    viscosity at the hottest vent.
    """
    discharge = max((vent.peak for vent in scene.vents), default=0.0)
    scale = 3.0 * vent_viscosity(scene) * (discharge or 1.0)
    scale /= scene.lava.density * scene.gravity
    return max(math.sqrt(math.sqrt(scale)), LEAST_THICKNESS)


def mature_thickness(scene: Scene) -> float:
    """Thickness scale of a flow that has cooled half-way to its solidus [m].

    Most of a flow is lava on its way, not lava at its vent: it is the scale above at
    ``mature_viscosity``.
    """
    stiffer = mature_viscosity(scene) / vent_viscosity(scene)
    return expected_thickness(scene) * math.sqrt(math.sqrt(stiffer))


def mature_viscosity(scene: Scene) -> float:
    """Geometric mean of the viscosities at the hottest vent and at the solidus [Pa s].

    Without a solidus it is that at the vent.
    """
    viscosity = vent_viscosity(scene)
    if not scene.lava.solidus:
        return viscosity
    ratio = scene.lava.viscosity_at(scene.lava.solidus) / viscosity
    return viscosity * math.sqrt(min(max(ratio, 1.0), MOST_STIFFENING))


def vent_viscosity(scene: Scene) -> float:
    """Viscosity at the hottest vent [Pa s], at the reference temperature without a vent."""
    reference = scene.lava.reference_temperature
    hottest = max((vent.temperature for vent in scene.vents), default=reference)
    return scene.lava.viscosity_at(hottest)
