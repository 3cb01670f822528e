# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""First guess of the particle spacing by the expected flow (course.py), and the longest step.

Pilot runs replace the guess where a run is long enough for them (forecast/preset_spacing.py).
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
import math

from lava_ros.effects import considered, EFFECTS, Effects, existing
from lava_ros.effects.heat import host_temperature
from lava_ros.effects.laws import Rheology
from lava_ros.effects.scales import footprint_change
from lava_ros.errors import LavaError
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import (
    Accuracy,
    expected_thickness,
    FORMULATIONS,
    MAX_PARTICLES_PER_SECOND,
    MIN_THICKNESS,
)
from lava_ros.simulation.cells.cell_size import cell_size
from lava_ros.simulation.flow_kind import FlowKind, kind_of
from lava_ros.simulation.setup.course import course_of

#: Default time span for the choice of spacing and effects [s].
HORIZON = 86400.0

#: Particles across the flow at a refinement of 1 (docs/benchmarks/convergence_h100.csv).
ACROSS = 16.0

#: Maximum spacing over the thickness of lava that freezes, at a refinement of 1: it freezes in
#: columns as wide as the spacing.
EDGES = 1.5

#: Fraction of the way to the solidus at and above which half of the lava is expected to freeze: in
#: scenes with `solidification` it is at least 0.37, in scenes without it at most 0.24.
COOLED = 0.3

#: Minimum spacing over the thickness of the flow at a refinement of 1: lateral stress smooths the
#: flow over 0.63 thicknesses (docs/MODEL.md).
MIN_SPACING = 1.0 / 16.0

#: Minimum number of particles across a resolved flow.
MIN_ACROSS = 9.0

#: Maximum thickness of a thin layer over the longer side of the terrain.
THIN = 0.5

#: Minimum area of a flow that has left its vent, in squares of the minimum resolved width.
_EXTENDED = 2.0

#: Maximum step over the horizon: maps, and ages in the laws of lava, are late by up to a step.
MAX_STEP_FRACTION = 1.0 / 128.0

#: Maximum change of the logarithm of the viscosity of new lava in a step. Lava moves with the
#: viscosity at the start of a step, as if it were younger by half a step.
MAX_STIFFENING = 0.2

#: Bisections of the longest step: the last is 1e-6 of the first interval.
_BISECTIONS = 20

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
        limit: Origin of the spacing: ``flow``, the width; ``edges``, the thickness; ``particles``,
            their maximum number or rate; ``stress``, which smooths the flow over
            most of its thickness; ``given``, the user; ``cells``, those of the
            terrain, with method cells or without a discharge; or ``measured``, a running
            simulation.
        kind: Kind of the flow (flow_kind.py); None without lava.
        extent: Longer side of the terrain [m]; infinite if measured.
        finest: Minimum spacing [m], by the number of particles and by lateral stress; 0 if
            unknown.
        emitted: Volume that the vents emit [m3], and that is already there.
        method: Carriers of the lava (``Accuracy.method``); then ``spacing`` is that of cells.
    """

    spacing: float
    thickness: float
    width: float
    across: float
    cell: float
    limit: str
    kind: FlowKind | None = None
    extent: float = math.inf
    finest: float = 0.0
    emitted: float = math.nan
    method: str = 'particles'

    @property
    def particles(self) -> float:
        """Number of particles at the end, without losses."""
        return self.emitted / (self.spacing**2 * self.thickness)

    @property
    def is_coarse(self) -> bool:
        """True if the flow is under-resolved."""
        return self.across < MIN_ACROSS

    def warnings(self, threshold: float | None = None) -> list[str]:
        """Return warnings as phrases.

        Args:
            threshold: Minimum thickness of lava that inundates ground [m], if a user has given it.
        """
        found = []
        if self.is_coarse:
            found.append(f'the flow is under-resolved, below {MIN_ACROSS:g} {self.method} across')
        if threshold is not None and self.thickness < threshold and not math.isnan(self.width):
            found.append(
                f'lava about {self.thickness:.2g} m thick is expected, and only lava of '
                f'{threshold:g} m or more counts as inundation'
            )
        if self.thickness > THIN * self.extent and not math.isnan(self.width):
            found.append(
                f'lava about {self.thickness:.2g} m thick is expected on a terrain of '
                f'{self.extent:.2g} m, and the model is for lava that is thin compared with its '
                'extent: check effusion rate, viscosity and yield strength'
            )
        return [*found, *(self.kind.warnings() if self.kind is not None else [])]

    def text(self) -> str:
        """Describe the resolution in one line."""
        if math.isnan(self.width):
            reason = 'the width of the flow is unknown: no effusion rate'
            return f'spacing {self.spacing:.3g} m; {reason}'
        # 180 and not 1.8e+02
        width, across = (float(f'{value:.2g}') for value in (self.width, self.across))
        text = f'{across:g} {self.method} across a flow of an expected width of {width:g} m'
        text += f' (spacing {self.spacing:.3g} m)'
        notes = self.warnings()
        if self.limit == 'particles':
            notes.append('the largest number of particles limits the spacing')
        return '; '.join([text, *notes])


def is_extended(area: float, distance: float) -> bool:
    """Return True if a flow has left its vent; before, its shape is that of the vent.

    Args:
        area: Area of the flow [m2].
        distance: Distance between particles [m].
    """
    return area >= _EXTENDED * (MIN_ACROSS * distance) ** 2


def estimated_effects(
    scene: Scene, accuracy: Accuracy, forced: Mapping[str, bool] | None, *, horizon: float
) -> Effects:
    """Return the effects that estimates of a flow include.

    They are those of ``effects.considered``, those of the formulation, and those that the expected
    kind of the flow calls for.

    Args:
        scene: The scene.
        accuracy: The resolution, with the formulation.
        forced: Effects that a user has switched on or off, by name.
        horizon: Time span to consider [s].
    """
    implied = FORMULATIONS[accuracy.formulation]
    switched = {name: implied[name] for name in implied if name in EFFECTS}
    called_for: dict[str, bool] = {}
    special = [name for name in existing(scene) if EFFECTS[name].kind]
    if special and (kind := kind_of(scene, horizon)) is not None:
        called_for = {name: True for name in special if EFFECTS[name].kind == kind.name}
    return considered(scene, {**called_for, **(forced or {}), **switched})


def resolution_of(
    scene: Scene,
    accuracy: Accuracy,
    forced: Mapping[str, bool] | None = None,
    *,
    horizon: float = HORIZON,
) -> Resolution:
    """Return the resolution of a scene.

    Args:
        scene: The scene.
        accuracy: Its accuracy; a spacing or thickness that it states is kept. Cells have the size
            that is nearest to the spacing.
        forced: Effects that a user has switched on or off, by name.
        horizon: Time after which emitted lava does not count [s].

    Raises:
        LavaError: If the spacing is too small for cells of the terrain.
    """
    effects = estimated_effects(scene, accuracy, forced, horizon=horizon)
    found = _resolution_with(scene, accuracy, effects, horizon=horizon)
    return replace(found, kind=kind_of(scene, horizon))


def _resolution_with(
    scene: Scene, accuracy: Accuracy, effects: Effects, *, horizon: float
) -> Resolution:
    """Return the resolution of a scene, without a kind, by estimates that include some effects."""
    mobility = math.inf if accuracy.mobility_limit is None else accuracy.mobility_limit
    course = course_of(scene, effects, horizon=horizon, mobility=mobility)
    width = math.nan if course is None else course.width
    thickness, flows = accuracy.thickness, scene.emplaced_flows
    emplaced = sum(flow.volume for flow in flows)
    emitted = emplaced + (0.0 if course is None else course.emitted)
    if thickness is None and course is None and flows:
        thickness = emplaced / sum(flow.area for flow in flows)
    if thickness is None:
        thickness = expected_thickness(scene)
        if course is not None:
            thickness = max(course.thickness_of(emitted), MIN_THICKNESS)
    cell = scene.terrain.resolution
    # lava that has hardly left its vent is a disc, not a flow as wide as the path allows
    width = min(width, 2.0 * math.sqrt(emitted / (math.pi * thickness)))
    extent = cell * max(scene.terrain.shape)

    most = MOST_PARTICLES * accuracy.refinement**2
    # rounding of the spacing must not exceed the maximum, by which vents are refused
    fastest = 1.02 * sum(vent.peak for vent in scene.vents) / MAX_PARTICLES_PER_SECOND
    by_number = math.sqrt(max(emitted / most, fastest) / thickness)
    by_stress = MIN_SPACING * thickness / accuracy.refinement
    least = max(by_number, by_stress)

    def known(spacing: float, limit: str) -> Resolution:
        across = width / spacing
        return Resolution(
            spacing, thickness, width, across, cell, limit, None, extent, least, emitted,
            accuracy.method,
        )

    if accuracy.method == 'cells':
        # the cells of the terrain, halved from a refinement of 1.4, doubled below 0.7
        halvings = math.floor(math.log2(accuracy.refinement) + 0.52)
        with naming_the_cause(scene, accuracy):
            size = cell_size(scene.terrain, accuracy.spacing or cell * 0.5**halvings)
        return known(size, 'cells' if accuracy.spacing is None else 'given')
    if accuracy.spacing is not None:
        return known(accuracy.spacing, 'given')
    if math.isnan(width) and not flows:
        return known(cell / accuracy.refinement, 'cells')
    # emplaced lava has a known thickness but no known width
    by_width = width / ACROSS if course else math.inf
    freezes = effects.any('freezes') and (course is None or course.cooled >= COOLED)
    by_edges = EDGES * thickness if freezes or course is None else math.inf
    wanted = min(by_width, by_edges) / accuracy.refinement
    limit = 'flow' if by_width <= by_edges else 'edges'
    if wanted < least:
        limit = 'particles' if by_number >= by_stress else 'stress'
    # round, so that a rotated scene has the same spacing
    return known(float(f'{max(wanted, least):.3g}'), limit)


def longest_step_of(
    scene: Scene, effects: Effects, thickness: float, *, horizon: float
) -> float:
    """Return the longest step [s] that the horizon and the heat balance of new lava allow.

    The motion of the lava, which limits steps further, is not included. A change of the yield
    strength counts as the change of the viscosity that changes as much of the inundated area.

    Args:
        scene: The scene.
        effects: Effects of the lava.
        thickness: Thickness of the lava across the flow [m].
        horizon: Time span to consider [s].
    """
    rheology, after = Rheology(scene.lava, effects), host_temperature(scene, effects)
    laws = (rheology.viscosity_at, 1.0), (rheology.strength_at, 1.0 / footprint_change(1.0))
    temperatures = {vent.temperature for vent in scene.vents}

    def stiffening(step: float) -> float:
        """Return the largest change of new lava in a step, as that of the logarithm of mu."""
        largest = 0.0
        for hot in temperatures:
            cold = after(
                temperature=hot, age=0.0, step=step, normal_thickness=thickness, drop=0.0,
                speed=0.0,
            )
            for law, weight in laws:
                if (before := law(hot)) > 0.0:
                    ratio = max(law(cold), 1e-300) / before
                    largest = max(largest, weight * abs(math.log(ratio)))
        return largest

    longest = MAX_STEP_FRACTION * horizon
    if stiffening(longest) <= MAX_STIFFENING:
        return longest
    shortest = 0.0
    for _ in range(_BISECTIONS):
        step = 0.5 * (shortest + longest)
        if stiffening(step) > MAX_STIFFENING:
            longest = step
        else:
            shortest = step
    return longest


def resolved_accuracy(
    accuracy: Accuracy,
    scene: Scene,
    forced: Mapping[str, bool] | None = None,
    *,
    horizon: float = HORIZON,
) -> Accuracy:
    """Return the accuracy with spacing, thickness and longest step filled in for a scene.

    The spacing of cells becomes their size. ``forced`` are the effects that a user has switched on
    or off, by name.

    Raises:
        LavaError: If they are out of range; it names what has led to them.
    """
    filled: dict[str, float] = {}
    if None in (accuracy.spacing, accuracy.thickness, accuracy.longest_step):
        effects = estimated_effects(scene, accuracy, forced, horizon=horizon)
    if accuracy.spacing is None or accuracy.thickness is None:
        found = _resolution_with(scene, accuracy, effects, horizon=horizon)
        filled = {'spacing': found.spacing, 'thickness': found.thickness}
    elif accuracy.method == 'cells':
        filled = {'spacing': cell_size(scene.terrain, accuracy.spacing)}
    if accuracy.longest_step is None:
        thickness = filled.get('thickness', accuracy.thickness)
        assert thickness is not None
        longest = longest_step_of(scene, effects, thickness, horizon=horizon)
        filled['longest_step'] = float(f'{longest:.3g}')
    with naming_the_cause(scene, accuracy):
        return replace(accuracy, **filled) if filled else accuracy


@contextmanager
def naming_the_cause(scene: Scene, given: Accuracy) -> Iterator[None]:
    """Refuse what has led to a refused spacing or thickness, unless the user has given that.

    It is the strongest vent, the lava without vents, or for the spacing of cells the refinement.

    Raises:
        LavaError: In place of that of an automatic ``accuracy.spacing`` or ``accuracy.thickness``.
    """
    try:
        yield
    except LavaError as error:
        name = error.field.removeprefix('accuracy.')
        if name not in ('spacing', 'thickness') or getattr(given, name) is not None:
            raise
        field, value = 'lava.viscosity', scene.lava.viscosity
        peaks = [vent.peak for vent in scene.vents]
        if given.method == 'cells' and name == 'spacing':
            field, value = 'accuracy.refinement', given.refinement
        elif peaks:
            value = max(peaks)
            field = f'vents[{peaks.index(value)}].discharge'
        expected = f'one for which the automatic {name} of {error.value:.3g} m is '
        expected += f'{error.expected}; or give `{name}`'
        raise LavaError(field, value, expected) from error
