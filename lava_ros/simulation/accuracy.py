# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Settings that trade accuracy for computing time."""

from dataclasses import dataclass, fields
import math

import numpy as np

from lava_ros import validation
from lava_ros.effects.effect import check_fields, choice, flag, number
from lava_ros.scene import Scene
from lava_ros.simulation.carriers import METHODS

#: Smoothing kernels by name: Wendland C2, and equations 3.6 and 3.7 of the paper.
KERNELS = ('wendland', 'poly6', 'spiky')

#: Minimum thickness of lava that inundates ground [m], and the same as a fraction of the expected
#: thickness of a thinner flow.
COVERED, COVERED_FRACTION = 0.1, 0.2

#: Minimum expected thickness of a flow [m].
MIN_THICKNESS = 1e-6

#: Maximum thickness [m], the greatest relief on Earth.
MAX_THICKNESS = 1e4

#: Maximum number of particles that the vents may emit per second: more cannot be computed.
MAX_PARTICLES_PER_SECOND = 1e6

#: Formulations by name, with the effects that each switches on or off. Effects that exclude one
#: that it switches on are off too.
FORMULATIONS: dict[str, dict[str, bool]] = {
    'corrected': {},
    'as-published': {'green': True, 'steep': False},
}

INTEGRATORS = ('rkl2', 'rkl1', 'euler')

PRECISIONS = ('float32', 'float64')

GRADIENTS = ('energy', 'balanced')


@dataclass(frozen=True)
class Accuracy:
    """Resolution of a simulation in space and time; each field has its own description."""

    method: str = choice(
        'particles', 'Carriers of the lava; cells are cheaper, and lack some effects', METHODS
    )
    spacing: float | None = number(
        None, 'Distance between neighbouring particles where the flow has its expected thickness; '
        'None: from the width of the flow (resolution.py)', 1e-6, 1e7, 'm',
    )
    refinement: float = number(
        1.0, 'Ratio of the particles across the flow to those of preset standard; an explicit '
        'spacing is not changed', 0.05, 20.0,
    )
    thickness: float | None = number(
        None, 'Expected thickness of the flow, which sets the volume of a particle with the '
        'spacing; None: that of the expected course of the flow (course.py)', 1e-9, MAX_THICKNESS,
        'm',
    )
    ratio: float = number(
        3.0, 'Ratio of kernel radius to spacing: 3 to 6 gives 28 to 113 neighbours', 1.5, 12.0
    )
    kernel: str = choice('wendland', 'Smoothing kernel', KERNELS)
    raster_ratio: float = number(
        1.2, "Ratio of the output grid's kernel radius to that of the particles; at least one and "
        'a half cells are always covered', 1e-3, 2.0,
    )
    diffusion_number: float = number(
        1.6, 'Ratio of the step to the decay time of the fastest thickness wave; explicit steps '
        'are stable up to 2', 1e-4, 2.0,
    )
    courant_number: float = number(
        0.5, 'Ratio of the largest displacement in a step to the smaller of kernel radius and '
        'terrain cell', 1e-4, 2.0,
    )
    mobility_limit: float | None = number(
        None, 'Maximum derivative of the speed of lava by its slope: lava above it moves as if '
        'its viscosity were higher; None: none', 1e-9, 1e9, 'm/s',
    )
    longest_step: float | None = number(
        None, 'Longest step; None: a fraction of the horizon in which new lava hardly stiffens '
        '(resolution.py)', 1e-6, 1e9, 's',
    )
    fixed_step: float | None = number(
        None, 'Step that overrides all limits, as 0.01 s in the paper; None: the limits decide',
        1e-9, 1e9, 's',
    )
    # energy: gradient of the particles' potential energy. balanced: that as far as differences
    # between particles allow, which are 0 on a level surface; equally accurate, at rest when
    # level, for one more pass over the neighbours (simulation/step/flow.py). With inertia it is
    # always energy, which conserves momentum.
    gradient: str = choice('energy', "Form of the surface's gradient", GRADIENTS)
    formulation: str = choice(
        'corrected', 'Equations of the velocity; as-published: 3.36 to 3.44 as they are printed, '
        'for comparison only', tuple(FORMULATIONS),
    )
    deterministic: bool = flag(
        False, 'Make runs on a GPU bitwise identical; on the CPU they always are'
    )
    # a mirrored scene, or one rotated by 90 degrees, then gives the mirrored or rotated flow;
    # otherwise particles are emitted one by one
    symmetric: bool = flag(
        False, 'Let vents emit particles eight at a time (fissures four), in places that have '
        "the grid's symmetries",
    )
    integrator: str = choice(
        'rkl2', 'Time integration: super-time-stepping of second order; rkl1: of first order, for '
        'steady flows; euler: explicit steps, for comparison', INTEGRATORS,
    )
    precision: str = choice('float32', 'Precision; float64 is the reference', PRECISIONS)
    threshold: float | None = number(
        None, 'Minimum thickness of lava that inundates ground; None: 0.1 m, or a fifth of the '
        'expected thickness if that is less', 1e-9, MAX_THICKNESS, 'm',
    )

    def __post_init__(self) -> None:
        """Validate every field.

        Raises:
            LavaError: If a field is not valid.
        """
        check_fields('accuracy', self)

    @property
    def radius(self) -> float:
        """Radius of the smoothing kernel [m]; the spacing must be known."""
        assert self.spacing is not None
        return self.ratio * self.spacing

    @property
    def particle_volume(self) -> float:
        """Volume of the particles that vents emit [m3]; spacing and thickness must be known.

        It is a float32, so that the sum of the particles' volumes is their number times this.
        """
        assert self.spacing is not None and self.thickness is not None
        return float(np.float32(self.spacing**2 * self.thickness))

    @property
    def inundation_threshold(self) -> float:
        """Minimum thickness of lava that inundates ground [m]; of one digit if it is automatic."""
        if self.threshold is not None:
            return self.threshold
        if self.thickness is None or COVERED_FRACTION * self.thickness >= COVERED:
            return COVERED
        least = COVERED_FRACTION * self.thickness
        return float(f'{least:.0e}')


def accuracy_from_dict(data: object) -> Accuracy:
    """Build an ``Accuracy`` from the plain data of a YAML file.

    Raises:
        LavaError: If a key is unknown or a value is not valid.
    """
    names = [item.name for item in fields(Accuracy)]
    return Accuracy(**validation.keys('accuracy', data, allowed=names))


def expected_thickness(scene: Scene) -> float:
    """Return the thickness scale of a flow at its vent, (3 mu Q / (rho g))^(1/4) [m].

    At this thickness spreading balances effusion, on a plane (Huppert 1982) as on a slope
    (Lister 1992). Q is the largest discharge of any vent, or 1 m3/s without a vent. mu is the
    viscosity at the hottest vent.
    """
    discharge = max((vent.peak for vent in scene.vents), default=0.0)
    scale = 3.0 * vent_viscosity(scene) * (discharge or 1.0)
    scale /= scene.lava.density * scene.gravity
    return max(math.sqrt(math.sqrt(scale)), MIN_THICKNESS)


def vent_viscosity(scene: Scene) -> float:
    """Return the viscosity at the hottest vent (or the reference temperature) [Pa s]."""
    reference = scene.lava.reference_temperature
    hottest = max((vent.temperature for vent in scene.vents), default=reference)
    return scene.lava.viscosity_at(hottest)
