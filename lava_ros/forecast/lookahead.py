# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs from look to look at the flow: members of ensembles, and a fork that runs ahead."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
import time as wall_clock
from typing import TYPE_CHECKING

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.maps.forecast import Forecast
from lava_ros.simulation.checkpoint import Checkpoint

if TYPE_CHECKING:
    from lava_ros.simulation.looks import Seen
    from lava_ros.simulation.simulation import Simulation

#: Looks at the flow within a horizon, which give the peaks. Arrivals are those of the time steps;
#: for another thickness than ``COVERED`` they are known to half of the time between two looks.
LOOKS = 240

#: Looks of the first forecast of a scene, which takes less than half of the time.
FIRST_LOOKS = 60

#: Looks ahead of the first regular one, each twice as early as the next.
EARLY_LOOKS = 4


class Looking:
    """A simulation that runs from one look to the next, up to a horizon.

    Attributes:
        simulation: The simulation.
    """

    def __init__(
        self,
        simulation: 'Simulation',
        due: Sequence[float],
        *,
        threshold: float,
        max_particles: int | None,
        of: str = '',
    ) -> None:
        """Begin without a look; the first one is of the flow as it is.

        Args:
            simulation: The simulation.
            due: Simulated times of the other looks [s], increasing. Each is taken at the first end
                of a time step at or after its time, and the last one exactly then, so the flow
                does not depend on the looks. One that an earlier look has passed is left out.
            threshold: Thickness at which lava counts as arrived [m].
            max_particles: Most particles, None for any number.
            of: How errors refer to the simulation, such as ' of member 3'.

        Raises:
            LavaError: There are too many particles.
        """
        self.simulation = simulation
        self._due, self._done = [simulation.time, *due], 0
        self._looks = simulation.looks(threshold, len(self._due))
        self._max_particles, self._of = max_particles, of
        self._check_size(simulation.particle_count)

    @property
    def progress(self) -> float:
        """Share of the looks that have been taken, the first one left out."""
        return max(self._done - 1, 0) / (len(self._due) - 1)

    @property
    def is_done(self) -> bool:
        """Whether all looks have been taken."""
        return self._done == len(self._due)

    def advance(self, wall_limit: float | None = None) -> None:
        """Run to the next look, or for about a wall time [s].

        Raises:
            LavaError: There are too many particles, or the flow cannot be shown as a map.
        """
        due, limit = self._due[self._done], self._due[-1]
        time = self.simulation.advance(due, limit=limit, wall_limit=wall_limit)
        if time >= due:
            self._check_size(self.simulation.particle_count)
            self.simulation.look(self._looks)
            self._check_flow(self._looks.flaw())
            self._note_look(time)

    def advancing(self) -> Iterator[None]:
        """Run to the next look, in parts: while a GPU is at work others can go on.

        ``seen`` refuses a flow that cannot be shown as a map.

        Raises:
            LavaError: There are too many particles.
        """
        due, limit = self._due[self._done], self._due[-1]
        time = yield from self.simulation.advancing(due, limit=limit)
        self._check_size(self.simulation.most_particles)
        yield from self.simulation.looking(self._looks)
        self._note_look(time)

    def seen(self, *, where_wet: bool = False) -> 'Seen':
        """What has been seen so far, of all cells or of the rectangle of wet ones.

        Raises:
            LavaError: The flow cannot be shown as a map.
        """
        seen = self.simulation.seen(self._looks, where_wet=where_wet)
        self._check_flow(seen.flaw)
        return seen

    def _note_look(self, time: float) -> None:
        self._done = bisect_right(self._due, time)

    def _check_size(self, count: int) -> None:
        if self._max_particles is not None and count > self._max_particles:
            right = f'at most {self._max_particles} (max_particles)'
            raise LavaError(f'particles{self._of}', count, right)

    def _check_flow(self, flaw: str) -> None:
        if flaw:
            raise LavaError(f'flow{self._of}', flaw, 'one that can be shown as a map')


class LookAhead(Looking):
    """A forecast in the making, by a simulation that runs ahead of the one it was forked from.

    The flow is the one that the forked simulation would have if it were advanced to the horizon,
    to the bit on the same device when it is deterministic.
    """

    def __init__(
        self,
        checkpoint: Checkpoint,
        *,
        horizon: float,
        threshold: float,
        looks: int = LOOKS,
        device: str | None = None,
        max_particles: int | None = None,
    ) -> None:
        """Start a simulation from a checkpoint.

        Args:
            checkpoint: The state from which to start.
            horizon: How far to look ahead [s].
            threshold: Thickness at which lava counts as arrived [m].
            looks: Number of regular looks within the horizon, after ``EARLY_LOOKS``.
            device: Warp device; None for the first GPU, or the CPU without one.
            max_particles: Most particles, None for any number.

        Raises:
            LavaError: A number is not usable, the checkpoint is inconsistent, or there is no such
                device.
        """
        # the solver loads Warp, which maps and scores of an ensemble do not need
        from lava_ros.simulation.simulation import Simulation

        begun = wall_clock.monotonic()
        self._horizon = validation.number('horizon', horizon, above=0.0, unit='s')
        self._threshold = validation.number('threshold', threshold, above=0.0, unit='m')
        if looks < 1:
            raise LavaError('looks', looks, 'at least 1')
        self._start = checkpoint.time
        super().__init__(
            Simulation.resume(checkpoint, device=device),
            [self._start + time for time in moments(horizon, looks)],
            threshold=threshold,
            max_particles=max_particles,
        )
        self._duration = wall_clock.monotonic() - begun

    def advance(self, wall_limit: float | None = None) -> None:
        """As ``Looking.advance``; the time that it takes counts."""
        begun = wall_clock.monotonic()
        super().advance(wall_limit)
        self._duration += wall_clock.monotonic() - begun

    def run(self) -> Forecast:
        """Run ahead to the horizon.

        Raises:
            LavaError: As ``advance``.
        """
        while not self.is_done:
            self.advance()
        return self.forecast()

    def forecast(self) -> Forecast:
        """What has been seen, once ``is_done``."""
        seen = self.seen()
        return Forecast(
            time=self._start,
            horizon=self._horizon,
            threshold=self._threshold,
            terrain=self.simulation.scene.terrain,
            arrival=(seen.arrival - self._start).astype('float32'),
            thickness=seen.thickness,
            temperature=seen.temperature,
            duration=self._duration,
            particle_count=self.simulation.particle_count,
        )


def moments(horizon: float, looks: int) -> list[float]:
    """Times after the start at which looks are due [s], the last of them at the horizon."""
    interval = horizon / looks
    early = [interval / 2.0**power for power in range(EARLY_LOOKS, 0, -1)]
    return early + [interval * number for number in range(1, looks)] + [horizon]
