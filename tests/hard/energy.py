# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Invariants of energy and heat.

energy       E = sum V (h / 2 + H), over rho g and from the lowest ground, plus V u^2 / 2g with
             inertia; h is the sum over the neighbours that the flow's gradient belongs to, H the
             ground's surface. From one frame to the next it grows by no more than what came in:
             what the vents gave, at the height of the highest lava and ground at the vents. What
             froze is gone with its energy; the ground it raised lifts what lies on it by no more
             than the thickest lava. With inertia speeds are half a step older than places and
             brought up with the acceleration a, good to V (a dt)^2 / 8g: the tolerance there.
             Two equations do not conserve it, and a frame that gained more is played again for
             what they let it gain (``ground.along``). Lava on a map has no vertical speed: on
             ``steep`` ground of slope s it climbs against 1 / (1 + s^2) of g, and gains the rest.
             The mean of the Green's function is not symmetric where neighbours differ in thickness
             or viscosity, and may push lava up its own slope: counted is what the formula of
             docs/MODEL.md, evaluated here, pushes up.
heat         With viscous heating, the heat of what is warmer than the hottest vent is no more
             than the energy below that is gone since the start: rho c sum V (T - hottest). Lateral
             stress carries lava up, which cools it by what warms the lava that carries it: then
             the heat of all lava counts, what is colder included.
temperature  No colder than air, vents and lava at the start, no hotter than the hottest of them;
             with viscous heating by g / c times the height that its surface can fall by more:
             from the highest ground there was, raised by what new ground has lifted it; twice the
             thickest lava, and once more each time that lava's age grows e-fold, for what is
             behind pushes it and at a front that moves along the surface falls again and again;
             and with inertia what vents have thrown it. Under lateral stress heat appears where
             gravity does the work: lava that is carried along warms by its own slope, which is at
             most ``STEEPEST`` h / l, all the way across the lava. To ``DIGITS`` float32 digits of
             2048 K.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np
from scipy.special import k0, k1

from hard.ground import along, Bound, head, lift, Moment
from lava_ros.effects.laws import LATERAL_DRAG
from lava_ros.simulation.kernels import SQUARED_SUPPORT
from lava_ros.simulation.state import STEPS

#: Digits of a float32 that a temperature may be off by.
DIGITS = 16

#: Slope of a sum over neighbours times its radius over the thickness, at most.
STEEPEST = 1.5

#: Share of the energy that rounding may add in a frame: positions and heights are float32.
ENERGY = 1e-6


class Temperature:
    """Knows how cold and how hot lava may be."""

    def __init__(self, moment: Moment) -> None:
        self._thickest = self._widest = self._thrown = 0.0
        self._first = math.inf
        temperature = moment.lava.temperature
        self._coldest = float(temperature.min(initial=math.inf))
        self.hottest = float(temperature.max(initial=-math.inf))
        self._terrain = moment.simulation.scene.terrain
        self._highest = float(np.nanmax(self._terrain.elevation))

    def renew(self, moment: Moment) -> None:
        """Widen what may be by vents, air and ground as they are now."""
        scene = moment.simulation.scene
        bounds = [scene.ambient_temperature, *(vent.temperature for vent in scene.vents)]
        self._coldest, self.hottest = min(self._coldest, *bounds), max(self.hottest, *bounds)
        if moment.simulation.effects.inertia:
            heads = [head(vent, scene.gravity) for vent in scene.vents]
            self._thrown = max([self._thrown, *heads])
        if scene.terrain is not self._terrain:
            top = float(np.nanmax(scene.terrain.elevation))
            self._highest = max(self._highest + lift(self._terrain, scene.terrain), top)
            self._terrain = scene.terrain

    def look(self, moment: Moment) -> None:
        """Take note of how thick lava is."""
        self._thickest = max(self._thickest, moment.thickest)

    def check(self, moment: Moment) -> Iterator[Bound]:
        """Hold the lava of a frame's end against what may be."""
        self.renew(moment)
        temperature = moment.lava.temperature
        if not len(temperature):
            return
        effects, scene = moment.simulation.effects, moment.simulation.scene
        tolerance, fall = DIGITS * 2.0**-13, 0.0
        if effects.viscous_heating:
            # lava that came out since the last frame was thicker than any frame shows: granted
            # is twice of that
            self.look(moment)
            height = self._highest - float(np.nanmin(scene.terrain.elevation))
            self._first = min(self._first, moment.time)
            spread = math.log(moment.time / self._first) if self._first else 0.0
            height += (2.0 + spread) * self._thickest + self._thrown
            if effects.green or effects.helmholtz:
                extent = float(np.hypot(*np.ptp(moment.lava.position, axis=0)))
                self._widest = max(self._widest, extent)
                height += STEEPEST * self._thickest / moment.simulation.radius * self._widest
            fall = scene.gravity / scene.lava.specific_heat * height
        above = float(temperature.max()) - self.hottest
        yield 'temperature', above, fall + tolerance, 'above the hottest vent'
        below = self._coldest - float(temperature.min())
        yield 'temperature', below, tolerance, 'below air and vents'


@dataclass(frozen=True)
class _Account:
    """Energy at a moment [m4], what vents and frost then add to it, the error of a step^2."""

    energy: float
    source: float
    half_kick: float


class Energy:
    """Keeps account of energy from frame to frame."""

    def __init__(self) -> None:
        self._half_kick = self._received = 0.0
        self._last: Moment | None = None

    def renew(self, moment: Moment) -> None:
        """Take energy as it is, after vents or ground were changed from outside."""
        now = _account(moment)
        if self._last is None:
            self._received = now.energy
        elif moment.time == self._last.time:
            self._received += now.energy - self._known.energy
        else:
            # what came in and what is gone since the last check cannot be told apart
            self._received = math.inf
        self._begin(moment, now)

    def _begin(self, moment: Moment, now: _Account) -> None:
        self._last, self._known = moment, now
        effects = moment.simulation.effects
        self._gains = effects.green or (effects.inertia and effects.steep)
        self._start = moment.simulation.checkpoint() if self._gains else None

    def check(self, moment: Moment, hottest: float) -> Iterator[Bound]:
        """Hold energy, and heat above the hottest vent's, against the frame before."""
        assert self._last is not None
        last, before, now = self._last, self._known, _account(moment)
        lava, simulation = moment.lava, moment.simulation
        thickest = max(last.thickest, moment.thickest)
        given = max(moment.given - last.given, 0.0)
        # what came out since may be of vents that were replaced
        received = given * (max(before.source, now.source) + thickest)
        received += max(moment.budget.frozen - last.budget.frozen, 0.0) * thickest
        relief = float(lava.volume.sum()) * (moment.ground.relief + moment.thickest)
        received += ENERGY * max(relief, before.energy)
        steps = max(int(moment.counts[STEPS] - last.counts[STEPS]), 1)
        square = ((moment.time - last.time) / steps) ** 2
        # half a step of the frame before may have been a longer one
        received += max(self._half_kick, max(before.half_kick, now.half_kick) * square)
        self._half_kick = now.half_kick * square
        if self._start is not None and now.energy - before.energy > received:
            gains = along(self._start, simulation, steps, _gain)
            received += sum(max(start, end) * length for start, end, length in gains)
        yield 'energy', now.energy - before.energy, received, 'm4 over the last frame'
        self._received += received
        if simulation.effects.viscous_heating:
            warmer = lava.temperature - hottest - DIGITS * 2.0**-13
            scene, effects = simulation.scene, simulation.effects
            if not (effects.green or effects.helmholtz):
                # what has cooled would hide what was made
                warmer = np.maximum(warmer, 0.0)
            heat = float((lava.volume * warmer).sum()) * scene.lava.specific_heat / scene.gravity
            yield 'heat', heat, self._received - now.energy, 'm4 since the start'
        self._begin(moment, now)


def _account(moment: Moment) -> _Account:
    simulation, lava, ground = moment.simulation, moment.lava, moment.ground
    gravity, energy, half_kick = simulation.scene.gravity, 0.0, 0.0
    if len(lava.volume):
        inertia = simulation.effects.inertia
        thickness = lava.thickness if inertia else _sum_of(moment)
        height = ground.height(lava.position) - ground.lowest
        energy = float((lava.volume * (0.5 * thickness + height)).sum())
        if inertia:
            square = (lava.velocity**2).sum(axis=1)
            energy += float((lava.volume * square).sum()) / (2.0 * gravity)
            kick = simulation._state.kick.numpy()[: len(lava.volume)].astype(float)
            half_kick = float((lava.volume * (kick**2).sum(axis=1)).sum()) / (8.0 * gravity)
    # highest energy of what vents emit, over its weight and from the lowest ground
    source, least = 0.0, simulation.accuracy.spacing or 0.0
    for vent in simulation.scene.vents:
        source = max(source, ground.highest(vent, least) + head(vent, gravity))
    return _Account(energy, source, half_kick)


def _gain(moment: Moment) -> float:
    """Energy that the equations let lava gain [m4/s]."""
    simulation, lava, ground = moment.simulation, moment.lava, moment.ground
    if not len(lava.volume) or simulation.accuracy.kernel != 'wendland':
        return 0.0
    offset = lava.position[:, None] - lava.position
    distance, radius = np.linalg.norm(offset, axis=2), simulation.radius
    pull = -140.0 / (math.pi * radius**4) * np.maximum(1.0 - distance / radius, 0.0) ** 3
    slope = ground.slope(lava.position)
    surface = np.einsum('ij,ijk,j->ik', pull, offset, lava.volume) + slope
    if simulation.effects.inertia:
        square = (slope**2).sum(axis=1)
        share, velocity = square / (1.0 + square), lava.velocity
    else:
        share, velocity = np.ones(len(lava.volume)), _mean(moment, distance)
    climbs = np.maximum((velocity * surface).sum(axis=1), 0.0)
    return float((lava.volume * share * climbs).sum())


def _mean(moment: Moment, distance: np.ndarray) -> np.ndarray:
    """The Green's function's mean of the local velocities [m/s]."""
    simulation, lava = moment.simulation, moment.lava
    simulation._stage.compute_flow()
    local = simulation._state.flow.numpy()[: len(lava.volume), 1:].astype(float)
    k, area = math.sqrt(LATERAL_DRAG) / lava.thickness, lava.volume / lava.thickness
    disc = np.sqrt(area / math.pi)
    # in the disc of a particle, and as near as the solver tells distances apart, K0 is level
    least = np.maximum(math.exp(-0.5) * disc, simulation.radius / SQUARED_SUPPORT)
    weight = k0(k[:, None] * np.maximum(distance, least[:, None])) * (distance < simulation.radius)
    own = k * disc
    np.fill_diagonal(weight, 2.0 / own**2 * (1.0 - own * k1(own)))
    total = lava.thickness * (weight @ area)
    return np.asarray((weight @ (lava.volume[:, None] * local)) / total[:, None])


def _sum_of(moment: Moment) -> np.ndarray:
    """The sum over the neighbours that a thickness is, its excess put back on."""
    simulation, lava = moment.simulation, moment.lava
    factor, power = {'wendland': (1.25, 2.5), 'spiky': (2.15, 1.5)}.get(
        simulation.accuracy.kernel, (0.0, 1.0)
    )
    total = lava.thickness.copy()
    for _ in range(60):
        share = lava.volume / (total * simulation.radius**2)
        total = lava.thickness / (1.0 - np.minimum(factor * share**power, 0.5))
    return total
