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

"""A simulation that runs ahead of the one it was forked from."""

import time as wall_clock

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.forecast.arrival_time import Looking
from lava_ros.maps.forecast import Forecast
from lava_ros.simulation import Simulation
from lava_ros.simulation.checkpoint import Checkpoint

#: Looks at the flow within a horizon; arrivals are known to half of the time between two.
LOOKS = 240

#: Looks of the first forecast of a scene, which takes less than half of the time.
FIRST_LOOKS = 60

#: Looks ahead of the first regular one, each twice as early as the next: near is pressing.
EARLY_LOOKS = 4


class LookAhead(Looking):
    """A forecast in the making.

    The flow is the one that the forked simulation would have, to the bit on the same device when
    it is deterministic and is advanced to the same times.
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
            looks: Number of regular looks within the horizon. ``EARLY_LOOKS`` come before the
                first.
            device: Warp device; None for the first GPU, or the CPU without one.
            max_particles: Most particles, None for any number.

        Raises:
            LavaError: A number is not usable, the checkpoint is inconsistent, or there is no such
                device.
        """
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
            self.advance(1.0)
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
    """Times of the looks after the start [s], the last of them at the horizon."""
    interval = horizon / looks
    early = [interval / 2.0**power for power in range(EARLY_LOOKS, 0, -1)]
    return early + [interval * number for number in range(1, looks)] + [horizon]
