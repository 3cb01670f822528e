# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Particle spacing from the width of the flow (course.py)."""

from dataclasses import dataclass, replace
import math

from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy, expected_thickness
from lava_ros.simulation.course import course_of

#: How far ahead is looked, unless somebody says otherwise [s].
HORIZON = 86400.0

#: Particles across the flow at a refinement of 1 (docs/benchmarks/convergence_h200.csv).
ACROSS = 16.0

#: Largest spacing over the thickness of the flow at a refinement of 1: the edges of a flow are a
#: few thicknesses wide, however wide the flow.
EDGES = 1.5

#: Particles across the flow below which it is under-resolved: its footprint is another one.
LEAST_ACROSS = 9.0

#: Error of a footprint from the particles, E (d / h)^P d / w, with their distance d, the thickness
#: h and the width w of the flow: E and P (docs/benchmarks/README.md, expected error).
PARTICLE_ERROR = 0.58, 0.4

#: Error of a footprint from the terrain's cells, over their size as a fraction of the width.
CELL_ERROR = 0.7

#: Least area of a flow that has left its vent, in squares of the width of a just resolved one.
_EXTENDED = 2.0

#: Particles that the horizon may bring at a refinement of 1; the spacing grows with more.
MOST_PARTICLES = 200_000


@dataclass(frozen=True)
class Resolution:
    """How a flow is resolved, expected or measured.

    Attributes:
        spacing: Distance between particles where the flow has its expected thickness [m].
        thickness: That thickness [m].
        width: Width of the flow, the lower quartile [m]; NaN without a discharge.
        across: Particles across it, NaN likewise.
        cell: Size of the terrain's cells [m].
        limit: What decided: ``flow``, its width; ``edges``, its thickness; ``particles``, their
            largest number; ``given``, the user; ``cells``, the terrain's, without a discharge; or
            ``measured``, a running simulation.
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
        """Whether the flow is under-resolved."""
        return self.across < LEAST_ACROSS

    def text(self) -> str:
        """Say it in a line."""
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
            text += f'; the flow is under-resolved, below {LEAST_ACROSS:g} particles across'
        if self.limit == 'particles':
            text += '; the largest number of particles limits the spacing'
        return text


def is_extended(area: float, distance: float) -> bool:
    """Return True if a flow has left its vent: a patch around that is as the vent is.

    Args:
        area: Area of the flow [m2].
        distance: Distance between its particles [m].
    """
    return area >= _EXTENDED * (LEAST_ACROSS * distance) ** 2


def resolution_of(scene: Scene, accuracy: Accuracy, *, horizon: float = HORIZON) -> Resolution:
    """Find the spacing that an accuracy means in a scene; what it has of its own is kept.

    Lava that comes after the ``horizon`` [s] does not count.
    """
    course = course_of(scene, horizon=horizon)
    width = math.nan if course is None else course.width
    thickness = accuracy.thickness
    if thickness is None:
        thickness = expected_thickness(scene) if course is None else course.thickness
    cell = scene.terrain.resolution
    if accuracy.spacing is not None:
        spacing = accuracy.spacing
        return Resolution(spacing, thickness, width, width / spacing, cell, 'given')
    if math.isnan(width):
        spacing = scene.terrain.resolution / accuracy.refinement
        return Resolution(spacing, thickness, width, width, cell, 'cells')
    by_width, by_edges = width / ACROSS, EDGES * thickness
    wanted = min(by_width, by_edges) / accuracy.refinement
    most = MOST_PARTICLES * accuracy.refinement**2
    emitted = sum(vent.volume_between(0.0, horizon) for vent in scene.vents)
    least = math.sqrt(emitted / (thickness * most))
    limit = 'flow' if by_width <= by_edges else 'edges'
    limit = limit if wanted >= least else 'particles'
    # digits that rounding decides would make another flow of a scene that is turned
    spacing = float(f'{max(wanted, least):.3g}')
    return Resolution(spacing, thickness, width, width / spacing, cell, limit)


def resolved_accuracy(accuracy: Accuracy, scene: Scene, *, horizon: float = HORIZON) -> Accuracy:
    """Fill in the automatic values: a spacing and a thickness of the scene's own scales."""
    if accuracy.spacing is not None and accuracy.thickness is not None:
        return accuracy
    found = resolution_of(scene, accuracy, horizon=horizon)
    return replace(accuracy, spacing=found.spacing, thickness=found.thickness)
