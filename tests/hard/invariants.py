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

"""What holds of every flow, however hard the scene: checked against a running simulation.

A ``Watch`` looks at a simulation between frames and says which invariant does not hold:

finite       Positions, volumes, temperatures, thicknesses, velocities, cells and the budget.
volume       What the vents gave is held, has left or has frozen, to ``VOLUME`` of it.
vents        What is due has come out: in a conduit is no more than the particles that come next.
temperature  No colder than air, vents and lava at the start, no hotter than the hottest of them;
             with viscous heating by g / c times the height that its surface can fall by more:
             from the highest ground there was, raised by what new ground has lifted it; twice the
             thickest lava, and once more each time that lava's age grows e-fold, for what is
             behind pushes it and at a front that moves along the surface falls again and again;
             and with inertia what vents have thrown it. Under lateral stress heat appears where
             gravity does the work: lava that is carried along warms by its own slope, which is at
             most ``STEEPEST`` h / l, all the way across the lava. To ``DIGITS`` float32 digits of
             2048 K.
heat         With viscous heating, the heat of what is warmer than the hottest vent is no more
             than the energy below that is gone since the start: rho c sum V (T - hottest).
energy       E = sum V (h / 2 + H), over rho g and from the lowest ground, plus V u^2 / 2g with
             inertia; h is the sum over the neighbours that the flow's gradient belongs to, H the
             ground's surface. From one frame to the next it grows by no more than what came in:
             what the vents gave, at the height of the highest lava and ground at the vents. What
             froze is gone with its energy; the ground it raised lifts what lies on it by no more
             than the thickest lava. With inertia speeds are half a step older than places and
             brought up with the acceleration a, good to V (a dt)^2 / 8g: the tolerance there.
climb        The surface H + h at a particle is no higher than the highest that there was: at the
             start, and at the vents at any frame since. With inertia, plus the largest
             u^2 / 2g so far. Tolerance: the smaller of its own thickness and what the
             ground around it rises in one kernel radius. A sum over the neighbours cannot tell
             heights within its radius apart, and never makes lava where there is none; ponds at
             rest are level to a share of their thickness (verification/bounds.py).
fall         Without inertia u^2 / 2g is at most the fall from the highest surface that lava came
             from, plus the thickness. Not at the paper's formulas, which have no bound.
place        Particles are on cells with data, and nowhere that the scene declares dry.
cost         Velocity evaluations in a frame: at most ``COST`` times those that the lava calls for
             with steps at the limits (cost.py), at the frame's ends or, if that is less than were
             taken, at each of its steps.

With ``Watch.renew`` a change from outside (a new terrain) is taken as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
import math

import numpy as np

from hard.cost import called_for, pace
from hard.ground import distance, Ground, lift
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation, Snapshot
from lava_ros.simulation.accuracy import expected_thickness
from lava_ros.simulation.checkpoint import Checkpoint
from lava_ros.simulation.particles import ParticleSample
from lava_ros.simulation.state import EVALUATIONS, STEPS
from lava_ros.simulation.timestep import MOST_STAGES
from lava_ros.verification.bounds import BOUNDS

#: Largest share of the lava that may be unaccounted for.
VOLUME = 1e-5

#: Digits of a float32 that a temperature may be off by.
DIGITS = 16

#: Slope of a sum over neighbours times its radius over the thickness, at most.
STEEPEST = 1.5

#: Share of the energy that rounding may add in a frame: positions and heights are float32.
ENERGY = 1e-6

#: Share of its thickness to which a pond at rest is level, at any preset.
LEVEL = max(BOUNDS['pond']['flatness at rest'].values())

#: Share by which u^2 may exceed that of free fall: heights are float32.
FALL = 1e-3

#: Evaluations over those that the lava calls for.
COST = 4.0

#: Where lava may not be, as a function of positions [m], shape [count, 2]; True where dry.
Dry = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Violation:
    """An invariant that does not hold.

    Attributes:
        invariant: Which one.
        value: What was found.
        bound: What it may be at most.
        time: When [s].
        what: More about it.
    """

    invariant: str
    value: float
    bound: float
    time: float
    what: str = ''

    def __str__(self) -> str:
        """Say it in a line."""
        more = f' ({self.what})' if self.what else ''
        return f'{self.invariant} {self.value:.6g} > {self.bound:.6g} at {self.time:g} s{more}'


class InvariantError(AssertionError):
    """A simulation broke an invariant."""

    def __init__(self, violations: Iterable[Violation]) -> None:
        self.violations = tuple(violations)
        super().__init__('; '.join(map(str, self.violations)))


@dataclass(frozen=True)
class _Frame:
    """What a check needs of the one before."""

    time: float
    energy: float
    given: float
    source: float
    frozen: float
    thickest: float
    evaluations: int
    steps: int
    cost: float
    half_kick: float
    checkpoint: Checkpoint


class Watch:
    """Checks a simulation frame by frame.

    Attributes:
        violations: What was found so far.
        largest: The worst value of each invariant over its bound so far, by name.
        smallest_step: Smallest mean step of a frame [s].
        highest_cost: Most evaluations in a simulated second of a frame [1/s].
    """

    def __init__(
        self, simulation: Simulation, *, dry: Dry | None = None, raises: bool = True
    ) -> None:
        """Take the simulation as it is now.

        Args:
            simulation: A simulation, best before its first step.
            dry: Where lava may not be.
            raises: Whether ``check`` raises what it finds, or only keeps it.
        """
        self._simulation = simulation
        self._dry = dry
        self._raises = raises
        self.violations: list[Violation] = []
        self.largest: dict[str, float] = {}
        self.smallest_step = math.inf
        self.highest_cost = 0.0
        self._thickest = 0.0
        self._widest = 0.0
        self._hottest = -math.inf
        self._coldest = math.inf
        self._top = -math.inf
        self._source = -math.inf
        self._head = 0.0
        self._thrown = 0.0
        self._first = math.inf
        self._received = 0.0
        self._half_kick = 0.0
        self._terrain = simulation.scene.terrain
        self._highest = float(np.nanmax(self._terrain.elevation))
        self.renew()

    def renew(self) -> None:
        """Take the simulation as it is, after vents or terrain were changed from outside."""
        sample = self._simulation.sample()
        former, self._terrain = self._terrain, self._simulation.scene.terrain
        if former is not self._terrain:
            top = float(np.nanmax(self._terrain.elevation))
            self._highest = max(self._highest + lift(former, self._terrain), top)
            self._source = -math.inf
        self._top = -math.inf
        self._know(sample)
        ground = Ground(self._simulation)
        if len(sample.volume):
            surface = sample.thickness + ground.height(sample.position)
            self._top = max(self._top, float(surface.max()))
            self._source = max(self._source, self._top)
        now = self._frame(sample, ground)
        if not hasattr(self, '_last'):
            self._received = now.energy
        elif now.time == self._last.time:
            self._received += now.energy - self._last.energy
        else:
            # what came in and what is gone since the last check cannot be told apart
            self._received = math.inf
        self._last = now

    def look(self) -> None:
        """Take note of how high and thick the lava is at a moment between two checks."""
        sample = self._simulation.sample()
        if len(sample.volume):
            ground = Ground(self._simulation)
            surface = sample.thickness + ground.height(sample.position)
            self._raise_top(sample, surface, ground)
            self._thickest = max(self._thickest, float(sample.thickness.max()))

    def check(self, snapshot: Snapshot | None = None) -> list[Violation]:
        """Check every invariant at this moment.

        Args:
            snapshot: The simulation's snapshot of this moment; taken when left out.

        Returns:
            What does not hold.

        Raises:
            InvariantError: Something does not hold, and the watch raises.
        """
        found: list[Violation] = []
        if self._simulation.scene.terrain is not self._terrain:
            self.renew()
        snapshot = snapshot or self._simulation.snapshot()
        sample = self._simulation.sample()
        time = self._simulation.time
        self._know(sample)

        def bound(name: str, value: float, most: float, what: str = '') -> None:
            share = value / most if most else (math.inf if value > 0.0 else 0.0)
            if math.isnan(value):
                share = math.inf
            self.largest[name] = max(self.largest.get(name, 0.0), share)
            if not value <= most:
                found.append(Violation(name, value, most, time, what))

        bad = _not_finite(sample, snapshot)
        bound('finite', sum(bad.values()), 0.0, ', '.join(key for key in bad if bad[key]))
        budget = snapshot.budget
        bound('volume', budget.error, VOLUME)
        bound('vents', budget.late, 0.0, 'm3 that wait in them')
        if not found:
            self._check_heat(sample, bound)
            self._check_place(sample, bound)
            ground = Ground(self._simulation)
            now = self._frame(sample, ground)
            self._check_climb(sample, ground, bound)
            self._check_energy(sample, ground, now, bound)
            self._check_cost(now, bound)
            self._last = now
        self.violations += found
        if found and self._raises:
            raise InvariantError(found)
        return found

    def _know(self, sample: ParticleSample) -> None:
        """Widen the range of temperatures by what is there now."""
        scene = self._simulation.scene
        self._coldest = min(
            [self._coldest, scene.ambient_temperature]
            + [vent.temperature for vent in scene.vents]
        )
        self._hottest = max(
            [self._hottest, scene.ambient_temperature]
            + [vent.temperature for vent in scene.vents]
        )
        if self._simulation.effects.inertia:
            speeds = [float(np.hypot(*vent.velocity)) for vent in scene.vents]
            heads = [speed**2 / (2.0 * scene.gravity) for speed in speeds]
            self._thrown = max([self._thrown, *heads])
        if not hasattr(self, '_last') and len(sample.temperature):
            self._coldest = min(self._coldest, float(sample.temperature.min()))
            self._hottest = max(self._hottest, float(sample.temperature.max()))

    def _check_heat(self, sample: ParticleSample, bound: Callable[..., None]) -> None:
        if not len(sample.temperature):
            return
        scene = self._simulation.scene
        tolerance = DIGITS * 2.0**-13
        fall = 0.0
        if self._simulation.effects.viscous_heating:
            self._thickest = max(self._thickest, float(sample.thickness.max()))
            # lava that came out since the last frame was thicker than any frame shows: granted
            # is twice of that
            height = self._highest - float(np.nanmin(scene.terrain.elevation))
            self._first = min(self._first, self._simulation.time)
            spread = math.log(self._simulation.time / self._first) if self._first else 0.0
            height += (2.0 + spread) * self._thickest + self._thrown
            effects = self._simulation.effects
            if effects.green or effects.helmholtz:
                extent = float(np.hypot(*np.ptp(sample.position, axis=0)))
                self._widest = max(self._widest, extent)
                height += STEEPEST * self._thickest / self._simulation.radius * self._widest
            fall = scene.gravity / scene.lava.specific_heat * height
        above = float(sample.temperature.max()) - self._hottest
        below = self._coldest - float(sample.temperature.min())
        bound('temperature', above, fall + tolerance, 'above the hottest vent')
        bound('temperature', below, tolerance, 'below air and vents')

    def _check_place(self, sample: ParticleSample, bound: Callable[..., None]) -> None:
        terrain = self._simulation.scene.terrain
        place = (sample.position - terrain.origin) / terrain.resolution
        cell = np.floor(place).astype(int)
        rows, columns = terrain.shape
        inside = (cell >= 0).all(axis=1) & (cell < [columns, rows]).all(axis=1)
        # on the edge of a cell rounding decides
        edge = 2.0**-22 * max(rows, columns)
        near = np.abs(place - np.rint(place)).min(axis=1) <= edge if len(place) else inside
        known = np.zeros(len(cell), dtype=bool)
        known[inside] = terrain.has_data[cell[inside, 1], cell[inside, 0]]
        bound('place', int((~known & ~near).sum()), 0, 'particles off the terrain')
        if self._dry is not None and len(sample.position):
            wet = self._dry(sample.position)
            bound('place', int(wet.sum()), 0, 'particles where it is dry')

    def _check_climb(
        self, sample: ParticleSample, ground: Ground, bound: Callable[..., None]
    ) -> None:
        if not len(sample.volume):
            return
        surface = sample.thickness + ground.height(sample.position)
        self._raise_top(sample, surface, ground)
        heads = (sample.velocity**2).sum(axis=1) / (2.0 * self._simulation.scene.gravity)
        if self._simulation.effects.inertia:
            self._head = max(self._head, float(heads.max()))
        elif self._simulation.accuracy.formulation != 'as-published':
            self._source = max(self._source, self._top)
            fall = np.maximum(self._source - surface + sample.thickness, 0.0)
            most = (fall + sample.thickness) * (1.0 + FALL)
            worst = int(np.argmax(heads / most))
            where = f'at ({sample.position[worst][0]:.6g}, {sample.position[worst][1]:.6g})'
            bound('fall', float(heads[worst]), float(most[worst]), where)
        rise = ground.rise(sample.position, self._simulation.radius)
        tolerance = np.minimum(sample.thickness, rise) + LEVEL * sample.thickness
        # 64 roundings of 2^-24, as of a sum over so many neighbours
        tolerance += 2.0**-18 * max(abs(self._top), float(sample.thickness.max()))
        above = surface - self._top - self._head
        worst = int(np.argmax(above - tolerance))
        x, y = sample.position[worst]
        where = f'surface over the highest, thickness {sample.thickness[worst]:.3g} m, '
        where += f'at ({x:.6g}, {y:.6g})'
        bound('climb', float(above[worst]), float(tolerance[worst]), where)

    def _raise_top(
        self, sample: ParticleSample, surface: np.ndarray, ground: Ground
    ) -> None:
        """Let the highest surface be that at the vents where that is higher."""
        scene = self._simulation.scene
        radius = self._simulation.radius
        scale = expected_thickness(scene)
        for vent in scene.vents:
            # a pulse may have run off between two frames
            if vent.volume_between(self._last.time, self._simulation.time) > 0.0:
                self._top = max(self._top, ground.highest(vent, 0.0) + ground.lowest + scale)
            near = distance(sample.position, vent.position, vent.end) < vent.radius + radius
            if near.any():
                self._top = max(self._top, float(surface[near].max()))

    def _check_energy(
        self, sample: ParticleSample, ground: Ground, now: _Frame, bound: Callable[..., None]
    ) -> None:
        last = self._last
        scene = self._simulation.scene
        thickest = max(last.thickest, now.thickest)
        given = max(now.given - last.given, 0.0)
        # what came out since may be of vents that were replaced
        source = max(last.source, now.source)
        came_in = given * (source + thickest) + max(now.frozen - last.frozen, 0.0) * thickest
        relief = float(sample.volume.sum()) * (ground.relief + now.thickest)
        rounding = ENERGY * max(relief, last.energy)
        step = (now.time - last.time) / max(now.steps - last.steps, 1)
        # half a step of the frame before may have been a longer one
        half_kick = max(self._half_kick, max(last.half_kick, now.half_kick) * step**2)
        self._half_kick = now.half_kick * step**2
        grown = now.energy - last.energy
        bound('energy', grown, came_in + rounding + half_kick, 'm4 over the last frame')
        self._received += came_in + rounding + half_kick
        if self._simulation.effects.viscous_heating:
            warmer = np.maximum(sample.temperature - self._hottest - DIGITS * 2.0**-13, 0.0)
            heat = float((sample.volume * warmer).sum()) * scene.lava.specific_heat / scene.gravity
            bound('heat', heat, self._received - now.energy, 'm4 since the start')

    def _check_cost(self, now: _Frame, bound: Callable[..., None]) -> None:
        span = now.time - self._last.time
        steps = now.steps - self._last.steps
        if span <= 0.0 or steps <= 0:
            return
        evaluations = now.evaluations - self._last.evaluations
        self.smallest_step = min(self.smallest_step, span / steps)
        self.highest_cost = max(self.highest_cost, evaluations / span)
        if self._simulation.accuracy.fixed_step is not None:
            return
        # the frame's end may cut a step in two, and so does each particle that comes out
        came = (now.given - self._last.given) / self._simulation.particle_volume
        cuts = 2 * MOST_STAGES + 2.0 * came
        most = COST * (max(now.cost, self._last.cost) * span + cuts)
        if evaluations > most:
            most = COST * (called_for(self._last.checkpoint, self._simulation) + cuts)
        bound('cost', evaluations, most, 'evaluations in the frame')

    def _frame(self, sample: ParticleSample, ground: Ground) -> _Frame:
        budget = self._simulation.budget()
        counts = self._simulation._state.counts.numpy()
        energy, thickest, half_kick = 0.0, 0.0, 0.0
        if len(sample.volume):
            energy = self._energy(sample, ground)
            thickest = float(sample.thickness.max())
        if self._simulation.effects.inertia:
            kick = self._simulation._state.kick.numpy()[: len(sample.volume)].astype(float)
            square = (kick**2).sum(axis=1)
            half_kick = float((sample.volume * square).sum()) / 8.0
            half_kick /= self._simulation.scene.gravity
        return _Frame(
            time=self._simulation.time,
            energy=energy,
            given=budget.emitted - budget.pending,
            source=self._highest_source(ground),
            frozen=budget.frozen,
            thickest=thickest,
            evaluations=int(counts[EVALUATIONS]),
            steps=int(counts[STEPS]),
            cost=pace(self._simulation, sample, ground),
            half_kick=half_kick,
            checkpoint=self._simulation.checkpoint(),
        )

    def _highest_source(self, ground: Ground) -> float:
        """Highest energy of what vents emit, over its weight and from the lowest ground [m]."""
        scene, highest = self._simulation.scene, 0.0
        for vent in scene.vents:
            head = float(np.hypot(*vent.velocity)) ** 2 / (2.0 * scene.gravity)
            least = self._simulation.accuracy.spacing or 0.0
            highest = max(highest, ground.highest(vent, least) + head)
        return highest

    def _energy(self, sample: ParticleSample, ground: Ground) -> float:
        simulation = self._simulation
        thickness = sample.thickness
        if not simulation.effects.inertia:
            thickness = _sum_of(sample, simulation)
        height = ground.height(sample.position) - ground.lowest
        energy = float((sample.volume * (0.5 * thickness + height)).sum())
        if simulation.effects.inertia:
            square = (sample.velocity**2).sum(axis=1)
            energy += float((sample.volume * square).sum()) / (2.0 * simulation.scene.gravity)
        return energy


def _sum_of(sample: ParticleSample, simulation: Simulation) -> np.ndarray:
    """The sum over the neighbours that a thickness is, its excess put back on."""
    accuracy = simulation.accuracy
    factor, power = {'wendland': (1.25, 2.5), 'spiky': (2.15, 1.5)}.get(
        accuracy.kernel, (0.0, 1.0)
    )
    total = sample.thickness.copy()
    for _ in range(60):
        share = sample.volume / (total * simulation.radius**2)
        total = sample.thickness / (1.0 - np.minimum(factor * share**power, 0.5))
    return total


def _not_finite(sample: ParticleSample, snapshot: Snapshot) -> dict[str, int]:
    """How many values are not finite, by name."""
    known = snapshot.terrain.has_data
    lava = known & (snapshot.thickness > 0.0)
    budget = snapshot.budget
    values = {
        'position': sample.position,
        'volume': sample.volume,
        'temperature': sample.temperature,
        'thickness': sample.thickness,
        'velocity': sample.velocity,
        'map thickness': snapshot.thickness[known],
        'map temperature': snapshot.temperature[lava],
        'budget': np.array([budget.emitted, budget.held, budget.left, budget.frozen]),
    }
    return {name: int((~np.isfinite(array)).sum()) for name, array in values.items()}


def frame_times(scene: Scene, until: float, count: int) -> list[float]:
    """Moments to check at [s]: evenly spaced ones, and those at which a vent changes."""
    times = {until * (index + 1) / count for index in range(count)}
    times |= {time for vent in scene.vents for time, _ in vent.series if 0.0 < time < until}
    return sorted(times)
