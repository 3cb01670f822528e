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

"""Invariants of where lava is.

climb  The surface H + h at a particle is no higher than the highest that there was: at the start,
       and at the vents at any frame since. With inertia, plus the largest u^2 / 2g so far, that of
       vents included: a jet may have climbed within the frame. Lava on a map has no vertical
       speed, and on ``steep`` ground of slope s climbs against 1 / (1 + s^2) of g: there the head
       is 1 + s^2 times that, s the steepest slope.
       Tolerance: the smaller of its own thickness and what the ground around it rises in one
       kernel radius. A sum over the neighbours cannot tell heights within its radius apart, and
       never makes lava where there is none; ponds at rest are level to a share of their thickness
       (verification/bounds.py).
fall   Without inertia u^2 / 2g is at most the fall from the highest surface that lava came from,
       plus the thickness. Not at the paper's formulas, which have no bound.
place  Particles are on cells with data, and nowhere that the scene declares dry.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import math

import numpy as np

from hard.ground import Bound, distance, Moment
from lava_ros.simulation.accuracy import expected_thickness
from lava_ros.verification.bounds import bound

#: Share of its thickness to which a pond at rest is level, at any preset.
LEVEL = bound('draft', 'pond', 'flatness at rest')

#: Share by which u^2 may exceed that of free fall: heights are float32.
FALL = 1e-3

#: Where lava may not be, as a function of positions [m], shape [count, 2]; True where dry.
Dry = Callable[[np.ndarray], np.ndarray]


class Heights:
    """Knows how high lava has been."""

    def __init__(self, dry: Dry | None) -> None:
        self._dry = dry
        self._source, self._head = -math.inf, 0.0

    def renew(self, moment: Moment, is_new_ground: bool) -> None:
        """Take vents and ground as they are."""
        self._top, self._since = -math.inf, moment.time
        if is_new_ground:
            self._source = -math.inf
        if len(moment.lava.volume):
            self._top = float(moment.surface.max())
            self._source = max(self._source, self._top)

    def look(self, moment: Moment) -> None:
        """Let the highest surface be that at the vents where that is higher."""
        scene, ground, places = moment.simulation.scene, moment.ground, moment.lava.position
        for vent in scene.vents:
            # a pulse may have run off between two frames
            if vent.volume_between(self._since, moment.time) > 0.0:
                above = ground.lowest + expected_thickness(scene)
                self._top = max(self._top, ground.highest(vent, 0.0) + above)
                if moment.simulation.effects.inertia:
                    head = float(np.hypot(*vent.velocity)) ** 2 / (2.0 * scene.gravity)
                    self._head = max(self._head, head)
            reach = vent.radius + moment.simulation.radius
            near = distance(places, vent.position, vent.end) < reach
            if near.any():
                self._top = max(self._top, float(moment.surface[near].max()))

    def check(self, moment: Moment) -> Iterator[Bound]:
        """Hold the lava of a frame's end against all that was before."""
        yield from self._placed(moment)
        if len(moment.lava.volume):
            self.look(moment)
            yield from self._raised(moment)
        self._since = moment.time

    def _placed(self, moment: Moment) -> Iterator[Bound]:
        terrain, places = moment.simulation.scene.terrain, moment.lava.position
        place = (places - terrain.origin) / terrain.resolution
        cell = np.floor(place).astype(int)
        rows, columns = terrain.shape
        inside = (cell >= 0).all(axis=1) & (cell < [columns, rows]).all(axis=1)
        # on the edge of a cell rounding decides
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
        elif simulation.accuracy.formulation != 'as-published':
            self._source = max(self._source, self._top)
            fall = np.maximum(self._source - surface + lava.thickness, 0.0)
            most = (fall + lava.thickness) * (1.0 + FALL)
            worst = int(np.argmax(heads / most))
            yield 'fall', float(heads[worst]), float(most[worst]), at(worst)
        rise = moment.ground.rise(lava.position, simulation.radius)
        tolerance = np.minimum(lava.thickness, rise) + LEVEL * lava.thickness
        # 64 roundings of 2^-24, as of a sum over so many neighbours
        tolerance += 2.0**-18 * max(abs(self._top), moment.thickest)
        climb = self._head
        if simulation.effects.steep:
            climb *= 1.0 + moment.ground.steepest**2
        above = surface - self._top - climb
        worst = int(np.argmax(above - tolerance))
        what = f'surface over the highest, {at(worst)}'
        yield 'climb', float(above[worst]), float(tolerance[worst]), what
