# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Forecasts by simulations that run ahead of the live simulation."""

import math
import time as wall_clock

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.layers.forecast import Forecast
from lava_ros.runs.drive import drive
from lava_ros.runs.sinks import PeakSink
from lava_ros.simulation.output.checkpoint import Checkpoint

#: Number of observations within a horizon, from which peaks are taken. Arrival times are exact to
#: a time step.
N_SAMPLES = 240

#: Number of observations in a scene's first forecast, which takes less than half the time.
N_FIRST_SAMPLES = 60

#: Number of observations before the first regular one, each at half the time of the next.
N_EARLY_SAMPLES = 4


class ForecastRun:
    """A forecast by a simulation that runs ahead of the one it was forked from.

    The flow equals the original simulation advanced to the horizon; on the same device it is
    bitwise identical if the simulation is deterministic.

    Attributes:
        simulation: The simulation.
        peaks: Its observations.
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
        self.simulation = Simulation.resume(checkpoint.counting(self._threshold), device=device)
        times = [self._start + time for time in moments(horizon, samples)]
        self.peaks = PeakSink(
            self.simulation, times, threshold=threshold, max_particles=max_particles
        )
        self._end = times[-1]
        self._duration = wall_clock.monotonic() - begun

    @property
    def progress(self) -> float:
        """Completed fraction of the observations, without the first one."""
        return self.peaks.progress

    @property
    def is_done(self) -> bool:
        """True if all observations are complete."""
        return self.peaks.is_done

    def advance(self, wall_limit: float = math.inf) -> None:
        """Run to the horizon, or for about a wall time [s].

        Raises:
            LavaError: If there are too many particles, or the flow cannot be shown as a map.
        """
        begun = wall_clock.monotonic()
        drive(self.simulation, self._end, [self.peaks], wall_limit=wall_limit)
        self.peaks.check()
        self._duration += wall_clock.monotonic() - begun

    def run(self) -> Forecast:
        """Run to the horizon; errors as in ``advance``."""
        self.advance()
        return self.forecast()

    def forecast(self) -> Forecast:
        """Return the forecast, once ``is_done``."""
        seen = self.peaks.seen(self.simulation)
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
            method=self.simulation.accuracy.method,
        )


def moments(horizon: float, samples: int) -> list[float]:
    """Return the times of observations after the start [s], the last one at the horizon."""
    interval = horizon / samples
    early = [interval / 2.0**power for power in range(N_EARLY_SAMPLES, 0, -1)]
    return early + [interval * number for number in range(1, samples)] + [horizon]
