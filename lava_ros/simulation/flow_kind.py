# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The kind of a flow: channel, sheet, tube-fed, dome or turbulent, by dimensionless numbers.

The number of the crust is the time t_s that a surface takes to solidify over the time t_a = H / U
in which lava moves by its own thickness (Griffiths & Fink 1993, Journal of Fluid Mechanics 252,
667-702), for lava with a yield strength tau on a slope b:

    Psi = t_s / t_a = t_s Q (rho g sin(b) / tau)^3,  H = tau / (rho g sin(b)),  U = Q / H^2.

Where it is small, the crust is older than the flow and lava moves under it: tubes. Where it is
large, shear breaks the crust: a mobile crust on an open channel (Griffiths, Kerr & Cashman 2003,
Journal of Fluid Mechanics 496, 33-62; Cashman, Kerr & Griffiths 2006, Bulletin of Volcanology 68,
753-770). docs/MODEL.md has all numbers, and the described flows that set the limits.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from lava_ros.effects import considered
from lava_ros.effects.heat import STEFAN_BOLTZMANN
from lava_ros.effects.scales import CRUST_CONDUCTIVITY
from lava_ros.scene import Scene
from lava_ros.simulation.setup.course import course_of

#: Maximum Reynolds number rho u h / mu of laminar flow in a channel (Chow 1959, Open-Channel
#: Hydraulics).
LAMINAR = 500.0

#: Number of the crust below which lava moves under it: the crust forms as fast as lava flows.
MIN_OPEN = 1.0

#: Minimum width of a sheet over its thickness (docs/MODEL.md).
MIN_SHEET = 200.0

#: Minimum viscosity of the lava of a dome [Pa s], and minimum thickness over its diameter.
MIN_DOME_VISCOSITY, MIN_DOME_ASPECT = 1e6, 0.05

#: Temperature at which a surface of basalt is solid: its glass transition [K] (Ryan & Sammis 1981,
#: Journal of Geophysical Research 86, 9519-9535), and minimum cooling of lava that erupts near it.
GLASS, MIN_COOLING = 1000.0, 100.0

#: Yield strength of a basalt flow as a whole [Pa], if that of the lava is lower (Hulme 1974,
#: Geophysical Journal of the Royal Astronomical Society 39, 361-383).
STRENGTH = 1e4

#: Maximum shear stress at the base of a flow [Pa]: twice the yield strength of the crusts of ten
#: flows (Castruccio et al. 2013, Bulletin of Volcanology 75, 681), and that of stiff domes (Blake
#: 1990, in Lava Flows and Domes, 88-126).
MAX_STRESS, MAX_DOME_STRESS = 2e5, 2e6

#: Kind of a flow whose crust is older than the time in which it moves by its own thickness.
TUBE_FED = 'tube-fed'

#: Kind of an emplaced flow that no vent feeds.
UNFED = 'unfed'

#: Effects that a kind calls for, and the parts of its physics that the model lacks.
_CALLED_FOR: dict[str, tuple[str, str]] = {
    'channel': ('cover and crust_strength', ''),
    'sheet': ('cooling or crust', ''),
    TUBE_FED: (
        'insulation',
        'the model has no tubes, inflation or single lobes: only length, area and thickness of '
        'the whole flow are meaningful',
    ),
    'dome': (
        'yielding and crust_strength',
        'the model has no spines, collapses or brittle carapace: only area and thickness are '
        'meaningful',
    ),
    'turbulent': (
        'inertia',
        'turbulent lava would be slower and thicker than the laminar flow that is computed',
    ),
    UNFED: ('no effect of its own', ''),
}


@dataclass(frozen=True)
class FlowKind:
    """Numbers of a flow, expected, measured or described, and the kind that follows from them.

    Attributes:
        discharge: Mean effusion rate of the flow while it is fed [m3/s].
        slope: Slope of the ground, rise over run.
        thickness: Thickness [m].
        width: Width [m]; NaN if unknown.
        diameter: Diameter of a circle with the area of the flow [m]; NaN if unknown.
        viscosity: Viscosity at the vent [Pa s].
        reynolds: Reynolds number rho u h / mu.
        crust_time: Time t_s in which a bare surface becomes solid [s]; infinite if it loses no
            heat.
        weight: Density times gravity [N/m3].
        strength: Yield strength at the vent [Pa].
        stress: Median shear stress at the base, weighted by volume [Pa]; 0 if not measured.
        is_measured: True if thickness, width, diameter and stress are those of a running
            simulation.
    """

    discharge: float
    slope: float
    thickness: float
    width: float
    diameter: float
    viscosity: float
    reynolds: float
    crust_time: float
    weight: float = 2600.0 * 9.81
    strength: float = 0.0
    stress: float = 0.0
    is_measured: bool = False

    @property
    def crust(self) -> float:
        """Number of the crust Psi: time to form a crust over time to flow."""
        sine = self.slope / math.hypot(1.0, self.slope)
        height = max(self.strength, STRENGTH) / (self.weight * max(sine, 1e-6))
        return self.crust_time * self.discharge / height**3

    @property
    def name(self) -> str:
        """Kind: ``turbulent``, ``dome``, ``tube-fed``, ``sheet``, ``channel`` or ``unfed``."""
        if self.discharge <= 0.0:
            return UNFED
        if self.reynolds > LAMINAR:
            return 'turbulent'
        is_stiff = self.viscosity >= MIN_DOME_VISCOSITY
        if is_stiff and self.thickness >= MIN_DOME_ASPECT * self.diameter:
            return 'dome'
        if self.crust < MIN_OPEN:
            return TUBE_FED
        return 'sheet' if self.width >= MIN_SHEET * self.thickness else 'channel'

    @property
    def reason(self) -> str:
        """Numbers that decide, in a few words."""
        name, width = self.name, self.width / self.thickness
        return {
            UNFED: 'lava lies there, and no vent has an effusion rate',
            'turbulent': f'Reynolds number {self.reynolds:.2g} is above {LAMINAR:g}',
            'dome': f'viscosity {self.viscosity:.2g} Pa s at the vent, thickness over diameter '
            f'{self.thickness / self.diameter:.2g} >= {MIN_DOME_ASPECT:g}',
            TUBE_FED: f'crust forms in {self.crust:.2g} of the time to flow, less than '
            f'{MIN_OPEN:g}',
            'sheet': f'width over thickness {width:.2g} >= {MIN_SHEET:g}',
            'channel': f'crust forms in {self.crust:.2g} times the time to flow, width over '
            f'thickness {width:.2g}',
        }[name]

    def text(self) -> str:
        """Describe the kind in one line: numbers, effects called for, and the missing physics."""
        called_for, lack = _CALLED_FOR[self.name]
        origin = 'measured' if self.is_measured else 'expected'
        parts = [f'{self.name} flow {origin}: {self.reason}', f'it calls for {called_for}']
        return '; '.join([*parts, lack] if lack else parts)

    def warnings(self) -> list[str]:
        """Return warnings as phrases: physics outside the model, and implausible stresses."""
        _, lack = _CALLED_FOR[self.name]
        origin = 'measured' if self.is_measured else 'expected'
        found = [f'{self.name} flow {origin} ({self.reason}), outside the model: {lack}'] if (
            lack
        ) else []
        limit = MAX_STRESS if self.viscosity < MIN_DOME_VISCOSITY else MAX_DOME_STRESS
        if self.stress > limit:
            found.append(
                f'implausible: lava {self.thickness:.2g} m thick on its slope has a stress of '
                f'{self.stress:.2g} Pa at its base, and no such lava is known to hold more than '
                f'{limit:.2g} Pa'
            )
        return found


def crust_time(scene: Scene, temperature: float) -> float:
    """Return the time [s] in which the surface of bare lava at a temperature [K] becomes solid.

    The surface of a half-space with the mean of the fluxes q at the start and at the end cools by
    2 q sqrt(t / (pi k rho c)) (Carslaw & Jaeger 1959, Conduction of Heat in Solids, 2.9).
    """
    lava, ambient = scene.lava, scene.ambient_temperature
    solid = min(GLASS, temperature - MIN_COOLING)
    flux = 0.5 * sum(
        lava.emissivity * STEFAN_BOLTZMANN * (value**4 - ambient**4)
        + lava.convection * (value - ambient)
        for value in (temperature, solid)
    )
    if flux <= 0.0:
        return math.inf
    inertia = (lava.conductivity or CRUST_CONDUCTIVITY) * lava.density * lava.specific_heat
    return math.pi * inertia * ((temperature - solid) / (2.0 * flux)) ** 2


def kind_of(scene: Scene, horizon: float) -> FlowKind | None:
    """Return the kind of the flow that is expected up to a horizon [s]; None without lava.

    The course is that of lava with the effects of every kind of flow, so that the kind does not
    depend on the effects that it calls for.
    """
    course, flows = course_of(scene, considered(scene), horizon=horizon), scene.emplaced_flows
    volume, area = sum(flow.volume for flow in flows), sum(flow.area for flow in flows)
    if course is not None:
        volume += course.emitted
        thickness = course.thickness_of(volume)
        diameter = 2.0 * math.sqrt(volume / (math.pi * thickness))
        return _kind_at(
            scene, course.temperature, discharge=course.discharge, slope=course.slope,
            thickness=thickness, width=min(course.width, diameter), diameter=diameter,
            reynolds=course.reynolds,
        )
    if area <= 0.0:
        return None
    hottest = max(flow.temperature or scene.lava.reference_temperature for flow in flows)
    diameter = 2.0 * math.sqrt(area / math.pi)
    return _kind_at(
        scene, hottest, discharge=0.0, slope=0.0, thickness=volume / area, width=diameter,
        diameter=diameter, reynolds=0.0,
    )


def _kind_at(scene: Scene, temperature: float, **flow: float) -> FlowKind:
    """Return the kind of a flow whose lava has a temperature [K] at its source."""
    lava = scene.lava
    return FlowKind(
        **flow,
        viscosity=lava.viscosity_at(temperature),
        crust_time=crust_time(scene, temperature),
        weight=lava.density * scene.gravity,
        strength=lava.yield_strength_at(temperature),
    )
