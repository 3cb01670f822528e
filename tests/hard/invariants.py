# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Invariants of every flow, however hard the scene, checked against a running simulation.

A ``Watch`` checks a simulation between frames and reports which invariant is violated:

finite  Positions, volumes, temperatures, thicknesses, velocities, cells and the budget.
volume  The emitted volume is in the simulation, has left or has solidified, to ``VOLUME`` of it.
vents   Due lava has been emitted: a conduit contains no more than the next particles.
climb  The surface H + h at a particle does not exceed its maximum so far: at the start, and at
       the vents at any frame since. With inertia, plus the largest u^2 / 2g so far, including that
       of the vents: a jet may have climbed within the frame. Lava on a map has no vertical
       speed, and on ``steep`` ground of slope s climbs against 1 / (1 + s^2) of g: there the head
       is 1 + s^2 times that, s the steepest slope.
       Tolerance: the smaller of its own thickness and the rise of the ground around it within one
       kernel radius. A sum over the neighbours does not resolve heights within its radius, and
       never creates lava elsewhere; ponds at rest are level to a fraction of their thickness
       (verification/bounds.py).
fall   Without inertia u^2 / 2g is at most the fall from the highest surface that lava came from,
       plus the thickness. Not at the paper's formulas, which have no bound.
place  Particles are on cells with data, and nowhere that the scene declares dry.
cost   Velocity evaluations in a frame are at most ``COST`` times those that the lava requires.
       A step dt of lava whose thickness relaxes at the rate r takes s evaluations, the smallest
       s with (s^2 + s - 2) / 4 >= r dt, and is as long as vents, speed and ``MAX_STAGES`` allow:
       ``pace`` is s / dt of the current lava, and a frame requires its integral.
       The ends of the frame suffice to estimate it if r changes little between them. That does
       not hold for power-law lava and lava held by its strength, whose r follows the slope: lava
       that yields for a moment, or runs off within the frame, shows it at neither end (measured:
       17 evaluations by the ends, 6,887 in the frame). Nor does lava that is emitted and leaves
       the map within the frame. A frame that took more than its ends require is therefore
       simulated again, and the evaluations and the lava at the start of each of its steps decide
       (``ground.along``).
energy, heat, temperature  energy.py

The module ``cells`` has what differs for lava on cells.

With ``Watch.renew`` a change from outside (a new terrain) is taken as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain
import math

import numpy as np

from hard import cells
from hard.energy import Energy, Temperature
from hard.ground import along, Bound, distance, head, is_on_cells, Moment, terrain_of
from lava_ros.simulation import Simulation, Snapshot
from lava_ros.simulation.accuracy import expected_thickness
from lava_ros.simulation.output.budget import VOLUMES
from lava_ros.simulation.particles.kernels import smoothing_kernel
from lava_ros.simulation.step.stage import longest_step
from lava_ros.simulation.step.timestep import MAX_STAGES
from lava_ros.verification.bounds import bound

#: Maximum fraction of the lava that may be unaccounted for.
VOLUME = 1e-5

#: Maximum ratio of evaluations to those that the lava requires.
COST = 4.0

#: Fraction of its thickness to which a pond at rest is level, at any preset.
LEVEL = bound('draft', 'pond', 'flatness at rest')

#: Fraction by which u^2 may exceed that of free fall: heights are float32.
FALL = 1e-3

#: Region without lava as a function of positions [m], shape [count, 2]; True where dry.
Dry = Callable[[np.ndarray], np.ndarray]


class Heights:
    """Highest surface of lava so far."""

    def __init__(self, dry: Dry | None) -> None:
        self._dry = dry
        self._source, self._head = -math.inf, 0.0

    def renew(self, moment: Moment, is_new_ground: bool) -> None:
        """Store the current vents and ground."""
        self._top, self._since = -math.inf, moment.time
        if is_new_ground:
            self._source = -math.inf
        if len(moment.lava.volume):
            self._top = float(moment.surface.max())
            self._source = max(self._source, self._top)

    def look(self, moment: Moment) -> None:
        """Raise the highest surface to that at the vents."""
        scene, ground, places = moment.simulation.scene, moment.ground, moment.lava.position
        for vent in scene.vents:
            # a pulse may have run off between two frames
            if vent.volume_between(self._since, moment.time) > 0.0:
                above = ground.lowest + expected_thickness(scene)
                self._top = max(self._top, ground.highest(vent, 0.0) + above)
                if moment.simulation.effects.inertia:
                    self._head = max(self._head, head(vent, scene.gravity))
            reach = vent.radius + moment.reach
            near = distance(places, vent.position, vent.end) < reach
            if near.any():
                self._top = max(self._top, float(moment.surface[near].max()))

    def check(self, moment: Moment) -> Iterator[Bound]:
        """Compare the lava at the end of a frame with its history."""
        yield from self._placed(moment)
        # emitted lava may have left the map within the frame
        self.look(moment)
        if len(moment.lava.volume):
            yield from self._raised(moment)
        self._since = moment.time

    def _placed(self, moment: Moment) -> Iterator[Bound]:
        terrain, places = terrain_of(moment.simulation), moment.lava.position
        place = (places - terrain.origin) / terrain.resolution
        cell = np.floor(place).astype(int)
        rows, columns = terrain.shape
        inside = (cell >= 0).all(axis=1) & (cell < [columns, rows]).all(axis=1)
        # rounding decides on the edge of a cell
        edge = 2.0**-22 * max(rows, columns)
        near = np.abs(place - np.rint(place)).min(axis=1) <= edge if len(place) else inside
        known = np.zeros(len(cell), dtype=bool)
        known[inside] = terrain.has_data[cell[inside, 1], cell[inside, 0]]
        yield 'place', int((~known & ~near).sum()), 0, 'particles off the terrain'
        if self._dry is not None and len(places):
            yield 'place', int(self._dry(places).sum()), 0, 'particles where it is dry'

    def _raised(self, moment: Moment) -> Iterator[Bound]:
        simulation, lava, surface = moment.simulation, moment.lava, moment.surface
        heads = (lava.velocity**2).sum(axis=1) / (2.0 * simulation.scene.gravity)

        def at(worst: int) -> str:
            x, y = lava.position[worst]
            return f'thickness {lava.thickness[worst]:.3g} m, at ({x:.6g}, {y:.6g})'

        if simulation.effects.inertia:
            self._head = max(self._head, float(heads.max()))
        elif not (
            simulation.accuracy.formulation == 'as-published' or is_on_cells(simulation)
        ):
            self._source = max(self._source, self._top)
            fall = np.maximum(self._source - surface + lava.thickness, 0.0)
            most = (fall + lava.thickness) * (1.0 + FALL)
            worst = int(np.argmax(heads / most))
            yield 'fall', float(heads[worst]), float(most[worst]), at(worst)
        tolerance = LEVEL * lava.thickness
        if not is_on_cells(simulation):
            rise = moment.ground.rise(lava.position, moment.reach)
            tolerance += np.minimum(lava.thickness, rise)
        # 64 roundings of 2^-24, for a sum over as many neighbours
        tolerance += 2.0**-18 * max(abs(self._top), moment.thickest)
        climb = self._head
        if simulation.effects.steep:
            climb *= 1.0 + moment.ground.steepest**2
        above = surface - self._top - climb
        worst = int(np.argmax(above - tolerance))
        what = f'surface over the highest, {at(worst)}'
        yield 'climb', float(above[worst]), float(tolerance[worst]), what


class Cost:
    """Count of evaluations from frame to frame.

    Attributes:
        smallest_step: Minimum mean step of a frame [s].
        highest: Maximum number of evaluations per simulated second of a frame [1/s].
    """

    def __init__(self) -> None:
        self.smallest_step, self.highest = math.inf, 0.0

    def renew(self, moment: Moment) -> None:
        """Begin a frame."""
        self._begin(moment, pace(moment))

    def _begin(self, moment: Moment, pace: float) -> None:
        self._last, self._pace = moment, pace
        self._start = moment.simulation.checkpoint()

    def check(self, moment: Moment) -> Iterator[Bound]:
        """Yield the cost of the frame that ends."""
        last, simulation, now = self._last, moment.simulation, pace(moment)
        span = moment.time - last.time
        evaluations = moment.evaluations - last.evaluations
        steps = moment.steps - last.steps
        if span > 0.0 and steps > 0:
            self.smallest_step = min(self.smallest_step, span / steps)
            self.highest = max(self.highest, evaluations / span)
            if simulation.accuracy.fixed_step is None:
                if is_on_cells(simulation):
                    cuts = cells.CUTS
                else:
                    # the frame's end may divide a step, and so may each emitted particle
                    came = (moment.given - last.given) / simulation.accuracy.particle_volume
                    cuts = 2.0 * (MAX_STAGES + came)
                most = COST * (max(now, self._pace) * span + cuts)
                if evaluations > most:
                    # each step's s follows the lava at its start
                    called = list(along(self._start, simulation, steps, pace))
                    evaluations = sum(count for *_, count in called)
                    most = COST * (sum(start * length for start, _, length, _ in called) + cuts)
                yield 'cost', evaluations, most, 'evaluations in the frame'
        self._begin(moment, now)


def pace(moment: Moment) -> float:
    """Return the evaluations per second that the current lava requires, with maximum steps."""
    simulation, sample = moment.simulation, moment.lava
    if is_on_cells(simulation):
        return cells.pace(simulation)
    accuracy, scene = simulation.accuracy, simulation.scene
    reach = simulation.solver.stage.constants.reach
    ends, limits, _ = simulation.solver.vents.step_limits.T
    limit = limits[np.searchsorted(ends, moment.time, side='right')]
    longest = min(limit, longest_step(scene, accuracy, simulation.effects, reach))
    if not len(sample.volume):
        return 3.0 / longest
    lava = scene.lava
    kernel = smoothing_kernel(accuracy.kernel, simulation.solver.state.real)
    thickness = sample.thickness.astype(np.float64)
    reach = accuracy.courant_number * min(simulation.accuracy.radius, scene.terrain.resolution)
    advection = float(np.linalg.norm(sample.velocity, axis=1).max()) / reach
    bend = moment.ground.bend(sample.position)
    # decay rate of the shortest waves of thickness over the mobility, in a hollow of the ground
    stiffness = thickness * kernel.stiffness / simulation.accuracy.radius**2 + bend
    stiffness /= accuracy.diffusion_number
    if simulation.effects.inertia:
        waves = scene.gravity * float(stiffness.max()) / accuracy.diffusion_number
        return max(1.0 / longest, math.sqrt(waves) + advection)
    if simulation.effects.power_law:
        explicit = float(simulation.solver.state.rates.numpy()[0])
    else:
        viscosity = np.array([lava.viscosity_at(float(value)) for value in sample.temperature])
        if not (simulation.effects.arrhenius or simulation.effects.vft):
            viscosity[:] = lava.viscosity
        weight = lava.density * scene.gravity
        explicit = float((weight * thickness**2 / (3.0 * viscosity) * stiffness).max())
    explicit = max(explicit, 1.0 / longest)
    if accuracy.integrator == 'euler':
        return max(explicit, advection)
    most = 0.25 * (MAX_STAGES**2 + MAX_STAGES - 2)
    step = min(longest, most / explicit, 1.0 / max(advection, 1e-300))
    stages = max(2.0, math.ceil(0.5 * (math.sqrt(9.0 + 16.0 * step * explicit) - 1.0)))
    return stages / step


@dataclass(frozen=True)
class Violation:
    """A violated invariant: its value, its maximum, and the time [s]."""

    invariant: str
    value: float
    bound: float
    time: float
    what: str = ''

    def __str__(self) -> str:
        """Return the violation as one line."""
        more = f' ({self.what})' if self.what else ''
        return f'{self.invariant} {self.value:.6g} > {self.bound:.6g} at {self.time:g} s{more}'


class InvariantError(AssertionError):
    """A simulation broke an invariant."""


class Watch:
    """Checks of a simulation frame by frame.

    Attributes:
        violations: Violations so far.
        largest: Largest value of each invariant over its bound so far, by name.
        cost: Counter of steps and evaluations.
    """

    def __init__(
        self, simulation: Simulation, *, dry: Dry | None = None, raises: bool = True
    ) -> None:
        """Store the state of the simulation, preferably before its first step.

        ``dry`` is the region without lava; with ``raises``, ``check`` raises what it finds.
        """
        self._simulation, self._raises = simulation, raises
        self.violations: list[Violation] = []
        self.largest: dict[str, float] = {}
        self._terrain = simulation.scene.terrain
        self._heights, self._energy, self.cost = Heights(dry), Energy(), Cost()
        self._temperature = Temperature(Moment(simulation))
        self.renew()

    def renew(self) -> None:
        """Store the state of the simulation, after vents or terrain were changed from outside."""
        moment = Moment(self._simulation)
        former, self._terrain = self._terrain, self._simulation.scene.terrain
        self._temperature.renew(moment)
        self._heights.renew(moment, former is not self._terrain)
        self._energy.renew(moment)
        self.cost.renew(moment)

    def look(self) -> None:
        """Record height and thickness of the lava at a moment between two checks."""
        moment = Moment(self._simulation)
        self._heights.look(moment)
        if len(moment.lava.volume):
            self._temperature.look(moment)

    def check(self, snapshot: Snapshot | None = None) -> None:
        """Check every invariant at this moment, to which the snapshot belongs.

        Raises:
            InvariantError: If an invariant is violated, and the watch raises.
        """
        if self._simulation.scene.terrain is not self._terrain:
            self.renew()
        moment = Moment(self._simulation)
        found = self._broken(moment, _whole(moment, snapshot or self._simulation.snapshot()))
        if not found:
            # with NaN the other invariants are meaningless
            hottest = self._temperature.hottest
            found = self._broken(moment, chain(
                self._temperature.check(moment), self._heights.check(moment),
                self._energy.check(moment, hottest), self.cost.check(moment),
            ))
        self.violations += found
        if found and self._raises:
            raise InvariantError('; '.join(map(str, found)))

    def _broken(self, moment: Moment, bounds: Iterator[Bound]) -> list[Violation]:
        found = []
        for name, value, most, what in bounds:
            ratio = value / most if most else (math.inf if value > 0.0 else 0.0)
            ratio = math.inf if math.isnan(value) else ratio
            self.largest[name] = max(self.largest.get(name, 0.0), ratio)
            if not value <= most:
                found.append(Violation(name, value, most, moment.time, what))
        return found


def _whole(moment: Moment, snapshot: Snapshot) -> Iterator[Bound]:
    """Check that all values are finite, and that the volume is complete."""
    lava, budget, known = moment.lava, snapshot.budget, snapshot.terrain.has_data
    names = ('position', 'volume', 'temperature', 'thickness', 'velocity')
    values = {
        **{name: getattr(lava, name) for name in names},
        'map thickness': snapshot.thickness[known],
        'map temperature': snapshot.temperature[known & (snapshot.thickness > 0.0)],
        'budget': np.array([getattr(budget, name) for name in VOLUMES]),
    }
    bad = {name: int((~np.isfinite(array)).sum()) for name, array in values.items()}
    yield 'finite', sum(bad.values()), 0.0, ', '.join(name for name in bad if bad[name])
    yield 'volume', budget.error, VOLUME, ''
    yield 'vents', budget.overdue, 0.0, 'm3 that wait in them'
