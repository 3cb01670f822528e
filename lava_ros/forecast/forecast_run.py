# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs that observe the flow at scheduled times: ensemble members and forecasts."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
import time as wall_clock
from typing import TYPE_CHECKING

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.maps.forecast import Forecast
from lava_ros.simulation.output.checkpoint import Checkpoint

if TYPE_CHECKING:
    from lava_ros.simulation.output.looks import Seen
    from lava_ros.simulation.simulation import Simulation

#: Number of observations within a horizon, from which peaks are taken. Arrival times are those of
#: time steps.
N_SAMPLES = 240

#: Number of observations of a scene's first forecast, which takes less than half of the time.
N_FIRST_SAMPLES = 60

#: Number of observations before the first regular one, each at half the time of the next.
N_EARLY_SAMPLES = 4


class SampledRun:
    """A simulation that runs from one observation to the next, up to a horizon.

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
        """Initialize; the first observation is of the flow at the start.

        Args:
            simulation: The simulation.
            due: Simulated times of the other observations [s], increasing. Each takes place at the
                end of the first time step at or after its time, and the last one exactly at its
                time, so observations do not change the flow. One already passed is left out.
            threshold: Thickness at or above which lava has arrived [m].
            max_particles: Maximum number of particles, None for no limit.
            of: Suffix for errors about the simulation, such as ' of member 3'.

        Raises:
            LavaError: If there are too many particles.
        """
        self.simulation = simulation
        self._due, self._done = [simulation.time, *due], 0
        self._looks = simulation.looks(threshold, len(self._due))
        self._max_particles, self._of = max_particles, of
        self._check_size(simulation.particle_count)

    @property
    def progress(self) -> float:
        """Completed fraction of the observations, without the first one."""
        return max(self._done - 1, 0) / (len(self._due) - 1)

    @property
    def is_done(self) -> bool:
        """True if all observations are complete."""
        return self._done == len(self._due)

    def advance(self, wall_limit: float | None = None) -> None:
        """Run to the next observation, or for about a wall time [s].

        Raises:
            LavaError: If there are too many particles, or the flow cannot be shown as a map.
        """
        due, limit = self._due[self._done], self._due[-1]
        time = self.simulation.advance(due, limit=limit, wall_limit=wall_limit)
        if time >= due:
            self._check_size(self.simulation.particle_count)
            self.simulation.look(self._looks)
            self._check_flow(self._looks.flaw())
            self._note_sample(time)

    def advancing(self) -> Iterator[None]:
        """Run to the next observation, yielding so that callers can overlap work with the GPU.

        ``seen`` refuses a flow that cannot be shown as a map.

        Raises:
            LavaError: If there are too many particles.
        """
        due, limit = self._due[self._done], self._due[-1]
        time = yield from self.simulation.advancing(due, limit=limit)
        self._check_size(self.simulation.most_particles)
        yield from self.simulation.looking(self._looks)
        self._note_sample(time)

    def seen(self, *, where_wet: bool = False) -> 'Seen':
        """Return the observations so far, of all cells or of the rectangle around wet cells.

        Raises:
            LavaError: If the flow cannot be shown as a map.
        """
        seen = self.simulation.seen(self._looks, where_wet=where_wet)
        self._check_flow(seen.flaw)
        return seen

    def _note_sample(self, time: float) -> None:
        self._done = bisect_right(self._due, time)

    def _check_size(self, count: int) -> None:
        if self._max_particles is not None and count > self._max_particles:
            expected = f'at most {self._max_particles} (max_particles)'
            raise LavaError(f'particles{self._of}', count, expected)

    def _check_flow(self, flaw: str) -> None:
        if flaw:
            raise LavaError(f'flow{self._of}', flaw, 'one that can be shown as a map')


class ForecastRun(SampledRun):
    """A forecast by a simulation that runs ahead of the one it was forked from.

    The flow equals that of the original simulation advanced to the horizon; it is bitwise
    identical on the same device if the simulation is deterministic.
    """

    def __init__(
        self,
        checkpoint: Checkpoint,
        *,
        horizon: float,
        threshold: float,
        samples: int = N_SAMPLES,
        device: str | None = None,
        max_particles: int | None = None,
    ) -> None:
        """Start a simulation from a checkpoint.

        Args:
            checkpoint: The state from which to start.
            horizon: Simulated duration of the forecast [s].
            threshold: Thickness at or above which lava has arrived [m].
            samples: Number of regular observations within the horizon, after ``N_EARLY_SAMPLES``.
            device: Warp device; None for the first GPU, or the CPU without one.
            max_particles: Maximum number of particles, None for no limit.

        Raises:
            LavaError: If a number is not valid, the checkpoint is inconsistent, or the device
                does not exist.
        """
        # the solver loads Warp, which the maps and scores of an ensemble do not need
        from lava_ros.simulation.simulation import Simulation

        begun = wall_clock.monotonic()
        self._horizon = validation.number('horizon', horizon, above=0.0, unit='s')
        self._threshold = validation.number('threshold', threshold, above=0.0, unit='m')
        if samples < 1:
            raise LavaError('samples', samples, 'at least 1')
        self._start = checkpoint.time
        super().__init__(
            Simulation.resume(checkpoint.counting(self._threshold), device=device),
            [self._start + time for time in moments(horizon, samples)],
            threshold=threshold,
            max_particles=max_particles,
        )
        self._duration = wall_clock.monotonic() - begun

    def advance(self, wall_limit: float | None = None) -> None:
        """Run as ``SampledRun.advance``, and add the wall time to the forecast's duration."""
        begun = wall_clock.monotonic()
        super().advance(wall_limit)
        self._duration += wall_clock.monotonic() - begun

    def run(self) -> Forecast:
        """Run to the horizon.

        Raises:
            LavaError: As in ``advance``.
        """
        while not self.is_done:
            self.advance()
        return self.forecast()

    def forecast(self) -> Forecast:
        """Return the forecast, once ``is_done``."""
        seen = self.seen()
        return Forecast(
            time=self._start,
            horizon=self._horizon,
            threshold=self._threshold,
            terrain=self.simulation.scene.terrain,
            arrival=(seen.arrival - self._start).astype('float32'),
            inundated=seen.inundated,
            thickness=seen.thickness,
            temperature=seen.temperature,
            duration=self._duration,
            particle_count=self.simulation.particle_count,
        )


def moments(horizon: float, samples: int) -> list[float]:
    """Return the times of observations after the start [s], the last one at the horizon."""
    interval = horizon / samples
    early = [interval / 2.0**power for power in range(N_EARLY_SAMPLES, 0, -1)]
    return early + [interval * number for number in range(1, samples)] + [horizon]
