# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Choice of the particle spacing by the width of the flow (course.py)."""

from dataclasses import dataclass, replace
import math

from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy, expected_thickness, MAX_THICKNESS
from lava_ros.simulation.setup.course import course_of

#: Default time span for the choice of spacing and effects [s].
HORIZON = 86400.0

#: Particles across the flow at a refinement of 1 (docs/benchmarks/convergence_h100.csv).
ACROSS = 16.0

#: Maximum spacing over the thickness of the flow at a refinement of 1: the edges of any flow are a
#: few thicknesses wide.
EDGES = 1.5

#: Minimum number of particles across a resolved flow.
MIN_ACROSS = 9.0

#: Factor E and exponent P of the footprint error from the particles, E (d / h)^P d / w, with the
#: particle spacing d, the thickness h and the width w (docs/benchmarks/README.md, expected error).
PARTICLE_ERROR = 0.58, 0.4

#: Footprint error from the terrain's cells, over their size as a fraction of the width.
CELL_ERROR = 0.7

#: Minimum area of a flow that has left its vent, in squares of the minimum resolved width.
_EXTENDED = 2.0

#: Maximum number of particles within the horizon at a refinement of 1, by a larger spacing.
MOST_PARTICLES = 200_000


@dataclass(frozen=True)
class Resolution:
    """Resolution of a flow, expected or measured.

    Attributes:
        spacing: Distance between particles at the expected thickness [m].
        thickness: Expected thickness [m].
        width: Lower quartile of the width of the flow [m]; NaN without a discharge.
        across: Number of particles across the flow; NaN without a discharge.
        cell: Size of the terrain's cells [m].
        limit: Origin of the spacing: ``flow``, the width; ``edges``, the thickness;
            ``particles``, their maximum number; ``given``, the user; ``cells``, those of the
            terrain, without a discharge; or ``measured``, a running simulation.
    """

    spacing: float
    thickness: float
    width: float
    across: float
    cell: float
    limit: str

    @property
    def particle_error(self) -> float:
        """Expected error of the footprint from the particles, 1 - Jaccard index."""
        scale, power = PARTICLE_ERROR
        distance = self.width / self.across
        return min(scale * (distance / self.thickness) ** power / self.across, 1.0)

    @property
    def cell_error(self) -> float:
        """Expected error of the footprint from the terrain's cells, 1 - Jaccard index."""
        return min(CELL_ERROR * self.cell / self.width, 1.0)

    @property
    def error(self) -> float:
        """Expected error of the footprint, 1 - Jaccard index with that of a perfect resolution."""
        return min(math.hypot(self.particle_error, self.cell_error), 1.0)

    @property
    def is_coarse(self) -> bool:
        """True if the flow is under-resolved."""
        return self.across < MIN_ACROSS

    def text(self) -> str:
        """Describe the resolution in one line."""
        if math.isnan(self.width):
            reason = 'the width of the flow is unknown: no effusion rate'
            return f'spacing {self.spacing:.3g} m; {reason}'
        # 180 and not 1.8e+02
        width, across, error, particles, cells = (
            float(f'{value:.2g}')
            for value in (
                self.width, self.across, 100.0 * self.error, 100.0 * self.particle_error,
                100.0 * self.cell_error,
            )
        )
        text = f'{across:g} particles across a flow about {width:g} m wide'
        text += f' (spacing {self.spacing:.3g} m): expected error of the footprint {error:g} %'
        text += f' ({particles:g} % by the particles, {cells:g} % by cells of {self.cell:g} m)'
        if self.is_coarse:
            text += f'; the flow is under-resolved, below {MIN_ACROSS:g} particles across'
        if self.limit == 'particles':
            text += '; the largest number of particles limits the spacing'
        return text


def is_extended(area: float, distance: float) -> bool:
    """Return True if a flow has left its vent; before, its shape is that of the vent.

    Args:
        area: Area of the flow [m2].
        distance: Distance between particles [m].
    """
    return area >= _EXTENDED * (MIN_ACROSS * distance) ** 2


def resolution_of(scene: Scene, accuracy: Accuracy, *, horizon: float = HORIZON) -> Resolution:
    """Return the resolution of a scene at an accuracy, whose own spacing or thickness remains.

    Lava emitted after the ``horizon`` [s] does not count.
    """
    course = course_of(scene, horizon=horizon)
    width = math.nan if course is None else course.width
    thickness, flows = accuracy.thickness, scene.emplaced_flows
    emplaced = sum(flow.volume for flow in flows)
    if thickness is None and course is None and flows:
        thickness = emplaced / sum(flow.area for flow in flows)
    if thickness is None:
        thickness = expected_thickness(scene) if course is None else course.thickness
        thickness = min(thickness, MAX_THICKNESS)
    cell = scene.terrain.resolution
    if accuracy.spacing is not None:
        spacing = accuracy.spacing
        return Resolution(spacing, thickness, width, width / spacing, cell, 'given')
    if math.isnan(width) and not flows:
        spacing = scene.terrain.resolution / accuracy.refinement
        return Resolution(spacing, thickness, width, width, cell, 'cells')
    # emplaced lava has a known thickness but no known width
    by_width, by_edges = width / ACROSS if course else math.inf, EDGES * thickness
    wanted = min(by_width, by_edges) / accuracy.refinement
    most = MOST_PARTICLES * accuracy.refinement**2
    emitted = emplaced + sum(vent.volume_between(0.0, horizon) for vent in scene.vents)
    least = math.sqrt(emitted / (thickness * most))
    limit = 'flow' if by_width <= by_edges else 'edges'
    limit = limit if wanted >= least else 'particles'
    # round, so that a rotated scene has the same spacing
    spacing = float(f'{max(wanted, least):.3g}')
    return Resolution(spacing, thickness, width, width / spacing, cell, limit)


def resolved_accuracy(accuracy: Accuracy, scene: Scene, *, horizon: float = HORIZON) -> Accuracy:
    """Return the accuracy with spacing and thickness filled in from the scales of a scene."""
    if accuracy.spacing is not None and accuracy.thickness is not None:
        return accuracy
    found = resolution_of(scene, accuracy, horizon=horizon)
    return replace(accuracy, spacing=found.spacing, thickness=found.thickness)
