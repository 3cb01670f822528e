# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Series of pilot runs, each finer than the previous one, and predictions for finer runs.

The difference between the last pilot and a run on cells gives the particles' part of the numerical
error, and that between runs on cells on both grounds the ground's part. If cells do not suffice
(``partner_of``), they are the differences between the last two pilots, and between the last but
one and a run on coarser ground (simulation/numerical_error.py). The particles' part is
proportional to the spacing to a power (``ORDERS``); the ground's part does not depend on it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
import math
import time as wall_clock

import numpy as np

from lava_ros.effects import Effects
from lava_ros.forecast.partner_runs import on_coarser_ground, partner_of
from lava_ros.forecast.pilot_runs import cost_at, MIN_GROWTH, Pilot, run_at
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import (
    between_methods,
    COARSER,
    error_of,
    GROUND_ORDER,
    NumericalError,
    ORDERS,
    Pair,
    richardson,
    scaled,
)

#: Maximum fraction of the time of a run, or of runs, for the pilots that plan it.
PLANNING_FRACTION = 0.15

#: Ratio of the refinements of one pilot and the next.
FINER = 1.6

#: Minimum ratio of one pilot to the next, margin of the time of a pilot, and exponent of the
#: refinement with which the time of the second grows.
CLOSEST, PILOT_MARGIN, GROWTH = 1.2, 1.2, 4.0

#: Maximum ratio of the times of runs on cells and on cells of twice the size.
CELLS_GROWTH = 8.0

#: Maximum refinement of a plan.
FINEST = 8.0


@dataclass(frozen=True)
class Option:
    """A run that could be made.

    Attributes:
        refinement: Its refinement.
        spacing: Its particle spacing [m].
        wall_time: Its expected wall time [s].
        error: Its numerical error.
    """

    refinement: float
    spacing: float
    wall_time: float
    error: NumericalError


@dataclass
class PilotSearch:
    """The pilots of a scene.

    Attributes:
        scene: The scene.
        horizon: Simulated duration [s].
        accuracy_at: Returns the accuracy at a refinement, with its spacing.
        effects: Effects of all pilots.
        first: Refinement of the first pilot.
        device: Warp device; None for the first GPU, or the CPU without one.
        clock: Returns the time [s]; None counts the work of the pilots instead.
        on_pilot: Called with each pilot.
        finer: Ratio of the refinements of one pilot and the next.
        doubles: True if all refinements are ``first`` times a power of 2, as on cells.
        pilots: Pilots on the ground as it is, from the coarsest to the finest.
        spent: Time of all pilots [s].
        count: Number of all pilots.
    """

    scene: Scene
    horizon: float
    accuracy_at: Callable[[float], Accuracy]
    effects: Effects
    first: float
    device: str | None = None
    clock: Callable[[], float] | None = wall_clock.monotonic
    on_pilot: Callable[[Pilot], None] = lambda _: None
    finer: float = FINER
    doubles: bool = False
    pilots: list[Pilot] = field(default_factory=list)
    spent: float = 0.0
    count: int = 0

    def __post_init__(self) -> None:
        """Prepare the runs on cells by the size of the cells [m], on both grounds."""
        self._on_cells: dict[float, list[Pilot | None]] = {}

    @property
    def method(self) -> str:
        """Carriers of the lava."""
        return self.accuracy_at(self.first).method

    @property
    def order(self) -> float:
        """Power of the spacing in the particles' part of the error."""
        return ORDERS[self.method]

    def compile_kernels(self) -> None:
        """Compile the kernels of the pilots, whose times then exclude that."""
        accuracy = self.accuracy_at(self.first)
        partner, _ = partner_of(self.scene, accuracy, self.effects)
        for one in {partner.method: partner, accuracy.method: accuracy}.values():
            run_at(
                self.scene, self.first, 1e-3, device=self.device, effects=self.effects,
                accuracy=one,
            )

    def run_pilots(
        self, budget: Callable[[], float], useful: Callable[[], float], *,
        limit: float = math.inf, reserved: Callable[[float], float] = lambda _: 0.0,
    ) -> None:
        """Run pilots while time remains, until the next would be finer than is useful.

        Args:
            budget: Returns the time for all pilots [s].
            useful: Returns the refinement above which pilots are not needed. Like ``budget``, it
                is called between pilots.
            limit: Maximum time of the first two pilots [s].
            reserved: Returns the part of the remaining time that is reserved for other pilots [s].
        """
        ground, refinement = on_coarser_ground(self.scene), self.first
        while refinement <= FINEST:
            left = budget() - self.spent
            pilot = self.run(self.scene, refinement, left if len(self.pilots) > 1 else limit)
            if pilot is None:
                break
            self.pilots = sorted([*self.pilots, pilot], key=lambda pilot: pilot.refinement)
            if len(self.pilots) > 1:
                if not self._measure_on_cells():
                    before, coarse = self.pilots[-2], None
                    if ground is not None:
                        # cheaper than a pilot of the newest spacing
                        coarse = self.run(ground, before.refinement, 3.0 * before.wall_time + 1.0)
                    self._error = self._measure(before, coarse)
                refinement = self._next(budget() - self.spent, reserved)
                last = self.pilots[-1].refinement
                if refinement < CLOSEST * last or useful() <= self.finer * last:
                    break
            elif self.finer**GROWTH * pilot.wall_time <= budget() - self.spent:
                refinement *= self.finer
            elif self.clock is not None:
                # a coarser pilot if the time is short
                refinement /= self.finer
            else:
                break

    def steps(self, finest: float) -> list[float]:
        """Return refinements of possible runs, from the first pilot's to ``finest``."""
        first = self.pilots[0].refinement if self.doubles and self.pilots else self.first
        if self.doubles:
            count = 1 + math.floor(math.log2(max(finest / first, 1.0)) + 1e-6)
            return [first * 2.0**power for power in range(count)]
        return np.geomspace(first, finest, 400).tolist()

    def measure_finest_ground(self, left: float) -> None:
        """Measure the ground's part again, at the finest pilot, if it fits into a time [s].

        Runs on cells have measured it there already, perhaps on cells that are too large for it.
        """
        ground, last = on_coarser_ground(self.scene), self.pilots[-1]
        if self._on_cells:
            self._measure_on_smaller_cells(left)
        elif ground is not None and PILOT_MARGIN * last.wall_time <= left:
            coarse = self.run(ground, last.refinement, left)
            if coarse is not None:
                self._error = self._measure(last, coarse)

    def _next(self, left: float, reserved: Callable[[float], float]) -> float:
        """Return the refinement of the next pilot, which fits into the remaining time [s]."""
        last = self.pilots[-1]
        steps = last.refinement * np.linspace(1.0, self.finer, 2 if self.doubles else 13)
        # before the pilots on coarser ground and others, which are coarser
        left -= 1.3 * last.wall_time + reserved(left)
        fitting = [step for step in steps.tolist() if PILOT_MARGIN * self.cost(step) <= left]
        return fitting[-1] if fitting else 0.0

    def run(
        self, scene: Scene, refinement: float, limit: float, *, is_told: bool = True,
        accuracy: Accuracy | None = None,
    ) -> Pilot | None:
        """Make a pilot; None if it takes more than ``limit`` [s].

        ``on_pilot`` is called with it if ``is_told``. ``accuracy`` is that of a run on cells.
        """
        clock = self.clock or wall_clock.monotonic
        begun = clock()
        pilot = run_at(
            scene, refinement, self.horizon, device=self.device,
            accuracy=accuracy or self.accuracy_at(refinement), effects=self.effects,
            wall_limit=math.inf if self.clock is None else limit, clock=clock,
        )
        took = clock() - begun
        if self.clock is None and pilot is not None:
            pilot = pilot.timed_by_work()
            took = pilot.wall_time
        self.spent += took
        self.count += 1
        if pilot is not None and is_told:
            self.on_pilot(pilot)
        return pilot

    def _measure_on_cells(self, size: float | None = None) -> bool:
        """Measure the error of the finest pilot by runs on cells; return False if it cannot be.

        ``size`` is that of the cells [m]; None for that of ``partner_of``.
        """
        finest = self.pilots[-1]
        accuracy = self.accuracy_at(finest.refinement)
        partner, _ = partner_of(self.scene, accuracy, self.effects)
        if partner.method == accuracy.method:
            return False
        assert partner.spacing is not None
        size = size or partner.spacing
        if size not in self._on_cells:
            limit, chosen = 3.0 * finest.wall_time + 1.0, replace(partner, spacing=size)
            self._on_cells[size] = [
                None if ground is None else
                self.run(ground, finest.refinement, limit, is_told=False, accuracy=chosen)
                for ground in (self.scene, on_coarser_ground(self.scene))
            ]
        own, coarse = self._on_cells[size]
        if own is None:
            return False
        pair = Pair(finest.areas, own.areas, between_methods(size, finest.spacing))
        self._error = self._error_of(pair, own, coarse)
        return True

    def _measure_on_smaller_cells(self, left: float) -> None:
        """Measure the error by cells down to the size of the terrain's, if they fit in a time."""
        size = min(self._on_cells)
        while size > 1.5 * self.scene.terrain.resolution:
            takes = sum(
                pilot.setup + CELLS_GROWTH * (pilot.wall_time - pilot.setup)
                for pilot in self._on_cells[size] if pilot is not None
            )
            before, size = self.spent, 0.5 * size
            if takes > left or not self._measure_on_cells(size):
                break
            left -= self.spent - before

    def _measure(self, pilot: Pilot, coarse: Pilot | None) -> NumericalError:
        """Return the error of the finest pilot.

        ``coarse`` is a run of a ``pilot`` on coarser ground.
        """
        finest = self.pilots[-1]
        wanted = COARSER[self.method] * finest.spacing
        partner = min(
            self.pilots[:-1], key=lambda pilot: abs(math.log(pilot.spacing / wanted))
        )
        reduction = richardson(partner.spacing / finest.spacing, self.order)
        return self._error_of(Pair(finest.areas, partner.areas, reduction), pilot, coarse)

    def _error_of(self, pair: Pair, pilot: Pilot, coarse: Pilot | None) -> NumericalError:
        """Return the error of the finest pilot by a pair; ``coarse`` as for ``_measure``."""
        pairs, finest = {'lava': pair}, self.pilots[-1]
        if coarse is not None:
            pairs['ground'] = Pair(pilot.areas, coarse.areas, richardson(2.0, GROUND_ORDER))
        return error_of(
            pairs, spacing=finest.spacing, cell=self.scene.terrain.resolution, time=self.horizon,
            cost=self.spent, method=self.method,
        )

    def cost(self, refinement: float) -> float:
        """Return the time of a run [s]; the work is estimated low."""
        least = MIN_GROWTH if self.clock else 0.0
        return cost_at(self.pilots, refinement, min_growth=least)

    def error(self, refinement: float) -> NumericalError:
        """Return the numerical error of a run."""
        ratio = self.pilots[-1].refinement / refinement
        inundated, standing = (
            replace(area, lava=scaled(area.lava, ratio**self.order))
            for area in (self._error.inundated, self._error.standing)
        )
        spacing = self.accuracy_at(refinement).spacing
        assert spacing is not None
        return replace(self._error, inundated=inundated, standing=standing, spacing=spacing)

    def option(self, refinement: float) -> Option:
        """Return a run at a refinement."""
        error = self.error(refinement)
        return Option(refinement, error.spacing, self.cost(refinement), error)

    def refinement_for(self, wanted: Callable[[float], float]) -> float:
        """Return the refinement with the wanted particles' part of the error, 0 to infinity.

        Args:
            wanted: Returns the wanted particles' part for a given ground's part.
        """
        area = self._error.inundated
        target = wanted(area.ground)
        if not target > 0.0:
            return math.inf
        # errors of areas multiply (scaled)
        found, target = (min(max(part, 1e-9), 0.999) for part in (area.lava, target))
        ratio = math.log1p(-found) / math.log1p(-target)
        return self.pilots[-1].refinement * ratio ** (1.0 / self.order)
