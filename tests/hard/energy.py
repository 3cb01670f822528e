# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Invariants of energy and heat.

energy       E = sum V (h / 2 + H), over rho g and from the lowest ground, plus V u^2 / 2g with
             inertia; h is the sum over the neighbours of the flow's gradient, H the surface of the
             ground. From one frame to the next it grows by no more than the supply: the volume
             from the vents, at the height of the highest lava and ground at the vents. Solidified
             lava is removed with its energy; the ground that it raises lifts other lava by no more
             than the thickest lava. With inertia speeds are half a step older than positions and
             advanced by the acceleration a, accurate to V (a dt)^2 / 8g: the tolerance there.
             Two equations do not conserve it, and a frame that gained more is simulated again to
             integrate their gain (``ground.along``). Lava on a map has no vertical speed: on
             ``steep`` ground of slope s it climbs against 1 / (1 + s^2) of g, and gains the rest.
             The mean of the Green's function is not symmetric where neighbours differ in thickness
             or viscosity, and may push lava up its own slope: that work is computed by the formula
             of docs/MODEL.md, evaluated here.
heat         With viscous heating, the heat of lava above the temperature of the hottest vent is no
             more than the energy lost since the start: rho c sum V (T - hottest). Lateral stress
             carries lava up, which cools it by as much as it warms the lava that carries it: then
             the heat of all lava counts, including colder lava.
temperature  No colder than air, vents and lava at the start, no hotter than the hottest of them;
             with viscous heating plus g / c times the height that its surface can fall: from the
             highest ground so far, plus the lift by new ground; twice the thickest lava, and once
             more each time that lava's age grows e-fold, because lava behind pushes it and at an
             advancing front the surface falls again and again; and with inertia the head of the
             vents. Under lateral stress heat appears where gravity does the work: lava that is
             carried along warms by its own slope, which is at most ``STEEPEST`` h / l, all the way
             across the lava. To ``DIGITS`` float32 digits of 2048 K.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np
from scipy.special import k0, k1

from hard.ground import along, Bound, head, is_on_cells, lift, Moment
from lava_ros.effects.laws import LATERAL_DRAG
from lava_ros.simulation.particles.kernels import SQUARED_SUPPORT

#: Tolerance of temperatures in float32 digits.
DIGITS = 16

#: Maximum slope of a sum over neighbours, times its radius over the thickness.
STEEPEST = 1.5

#: Fraction of the energy that rounding may add in a frame: positions and heights are float32.
ENERGY = 1e-6


class Temperature:
    """Bounds of the temperature of lava."""

    def __init__(self, moment: Moment) -> None:
        self._thickest = self._widest = self._thrown = 0.0
        self._first = math.inf
        temperature = moment.lava.temperature
        self._coldest = float(temperature.min(initial=math.inf))
        self.hottest = float(temperature.max(initial=-math.inf))
        self._terrain = moment.simulation.scene.terrain
        self._highest = float(np.nanmax(self._terrain.elevation))

    def renew(self, moment: Moment) -> None:
        """Widen the bounds by the current vents, air and ground."""
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
        """Record the thickness of lava."""
        self._thickest = max(self._thickest, moment.thickest)

    def check(self, moment: Moment) -> Iterator[Bound]:
        """Compare the lava at the end of a frame with the bounds."""
        self.renew(moment)
        temperature = moment.lava.temperature
        if not len(temperature):
            return
        effects, scene = moment.simulation.effects, moment.simulation.scene
        tolerance, fall = DIGITS * 2.0**-13, 0.0
        if effects.viscous_heating:
            # lava emitted since the last frame was thicker than in any frame: allow for twice the
            # thickness
            self.look(moment)
            height = self._highest - float(np.nanmin(scene.terrain.elevation))
            self._first = min(self._first, moment.time)
            spread = math.log(moment.time / self._first) if self._first else 0.0
            height += (2.0 + spread) * self._thickest + self._thrown
            if effects.green or effects.helmholtz:
                extent = float(np.hypot(*np.ptp(moment.lava.position, axis=0)))
                self._widest = max(self._widest, extent)
                radius = moment.reach
                height += STEEPEST * self._thickest / radius * self._widest
            fall = scene.gravity / scene.lava.specific_heat * height
        above = float(temperature.max()) - self.hottest
        yield 'temperature', above, fall + tolerance, 'above the hottest vent'
        below = self._coldest - float(temperature.min())
        yield 'temperature', below, tolerance, 'below air and vents'


@dataclass(frozen=True)
class _Account:
    """Energy at a moment [m4], later supply by vents and solidification, error of a step^2."""

    energy: float
    source: float
    half_kick: float


class Energy:
    """Energy balance from frame to frame."""

    def __init__(self) -> None:
        self._half_kick = self._received = 0.0
        self._last: Moment | None = None

    def renew(self, moment: Moment) -> None:
        """Store the current energy, after a change of vents or ground from outside."""
        now = _account(moment)
        if self._last is None:
            self._received = now.energy
        elif moment.time == self._last.time:
            self._received += now.energy - self._known.energy
        else:
            # supply and losses since the last check cannot be separated
            self._received = math.inf
        self._begin(moment, now)

    def _begin(self, moment: Moment, now: _Account) -> None:
        self._last, self._known = moment, now
        effects = moment.simulation.effects
        self._gains = effects.green or (effects.inertia and effects.steep)
        self._start = moment.simulation.checkpoint() if self._gains else None

    def check(self, moment: Moment, hottest: float) -> Iterator[Bound]:
        """Compare energy, and heat above the hottest vent's, with the previous frame."""
        assert self._last is not None
        last, before, now = self._last, self._known, _account(moment)
        lava, simulation = moment.lava, moment.simulation
        thickest = max(last.thickest, moment.thickest)
        given = max(moment.given - last.given, 0.0)
        # lava may have been emitted since by vents that were replaced
        received = given * (max(before.source, now.source) + thickest)
        received += max(moment.budget.solidified - last.budget.solidified, 0.0) * thickest
        relief = float(lava.volume.sum()) * (moment.ground.relief + moment.thickest)
        received += ENERGY * max(relief, before.energy)
        steps = max(moment.steps - last.steps, 1)
        square = ((moment.time - last.time) / steps) ** 2
        # half a step of the previous frame may have been longer
        received += max(self._half_kick, max(before.half_kick, now.half_kick) * square)
        self._half_kick = now.half_kick * square
        if self._start is not None and now.energy - before.energy > received:
            gains = along(self._start, simulation, steps, _gain)
            received += sum(max(start, end) * length for start, end, length, _ in gains)
        yield 'energy', now.energy - before.energy, received, 'm4 over the last frame'
        self._received += received
        if simulation.effects.viscous_heating:
            warmer = lava.temperature - hottest - DIGITS * 2.0**-13
            scene, effects = simulation.scene, simulation.effects
            if not (effects.green or effects.helmholtz):
                # cooled lava would hide heat that was created
                warmer = np.maximum(warmer, 0.0)
            heat = float((lava.volume * warmer).sum()) * scene.lava.specific_heat / scene.gravity
            yield 'heat', heat, self._received - now.energy, 'm4 since the start'
        self._begin(moment, now)


def _account(moment: Moment) -> _Account:
    simulation, lava, ground = moment.simulation, moment.lava, moment.ground
    gravity, energy, half_kick = simulation.scene.gravity, 0.0, 0.0
    if len(lava.volume):
        inertia = simulation.effects.inertia
        is_exact = inertia or is_on_cells(simulation)
        thickness = lava.thickness if is_exact else _sum_of(moment)
        height = ground.height(lava.position) - ground.lowest
        energy = float((lava.volume * (0.5 * thickness + height)).sum())
        if inertia:
            square = (lava.velocity**2).sum(axis=1)
            energy += float((lava.volume * square).sum()) / (2.0 * gravity)
            kick = simulation.solver.state.arrays['kick'].numpy()
            kick = kick[: len(lava.volume)].astype(float)
            half_kick = float((lava.volume * (kick**2).sum(axis=1)).sum()) / (8.0 * gravity)
    # highest energy of emitted lava, over its weight and from the lowest ground
    source, least = 0.0, simulation.accuracy.spacing or 0.0
    for vent in simulation.scene.vents:
        source = max(source, ground.highest(vent, least) + head(vent, gravity))
    return _Account(energy, source, half_kick)


def _gain(moment: Moment) -> float:
    """Return the energy that the equations let lava gain [m4/s]."""
    simulation, lava, ground = moment.simulation, moment.lava, moment.ground
    if not len(lava.volume) or simulation.accuracy.kernel != 'wendland':
        return 0.0
    offset = lava.position[:, None] - lava.position
    distance, radius = np.linalg.norm(offset, axis=2), simulation.accuracy.radius
    pull = -140.0 / (math.pi * radius**4) * np.maximum(1.0 - distance / radius, 0.0) ** 3
    slope = ground.slope(lava.position)
    surface = np.einsum('ij,ijk,j->ik', pull, offset, lava.volume) + slope
    if simulation.effects.inertia:
        square = (slope**2).sum(axis=1)
        fraction, velocity = square / (1.0 + square), lava.velocity
    else:
        fraction, velocity = np.ones(len(lava.volume)), _mean(moment, distance)
    climbs = np.maximum((velocity * surface).sum(axis=1), 0.0)
    return float((lava.volume * fraction * climbs).sum())


def _mean(moment: Moment, distance: np.ndarray) -> np.ndarray:
    """Return the Green's function's mean of the local velocities [m/s]."""
    simulation, lava = moment.simulation, moment.lava
    simulation.solver.stage.compute_flow()
    local = simulation.solver.state.flow.numpy()[: len(lava.volume), 1:].astype(float)
    k, area = math.sqrt(LATERAL_DRAG) / lava.thickness, lava.volume / lava.thickness
    disc = np.sqrt(area / math.pi)
    # in a particle's disc, and below the smallest distance that the solver distinguishes, K0 is
    # constant
    radius = simulation.accuracy.radius
    least = np.maximum(math.exp(-0.5) * disc, radius / SQUARED_SUPPORT)
    weight = k0(k[:, None] * np.maximum(distance, least[:, None])) * (distance < radius)
    own = k * disc
    np.fill_diagonal(weight, 2.0 / own**2 * (1.0 - own * k1(own)))
    total = lava.thickness * (weight @ area)
    return np.asarray((weight @ (lava.volume[:, None] * local)) / total[:, None])


def _sum_of(moment: Moment) -> np.ndarray:
    """Return the sum over the neighbours that corresponds to a thickness, with its excess."""
    simulation, lava = moment.simulation, moment.lava
    factor, power = {'wendland': (1.25, 2.5), 'spiky': (2.15, 1.5)}.get(
        simulation.accuracy.kernel, (0.0, 1.0)
    )
    total = lava.thickness.copy()
    for _ in range(60):
        cover = lava.volume / (total * simulation.accuracy.radius**2)
        total = lava.thickness / (1.0 - np.minimum(factor * cover**power, 0.5))
    return total
