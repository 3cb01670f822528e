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

"""What a simulation said about itself while it was recorded, over its simulated time."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from lava_ros.bag.decoding import Decoder
from lava_ros.bag.reader import BagReader

DIAGNOSTICS = '/diagnostics'


@dataclass(frozen=True)
class Moment:
    """The diagnostics of the simulation at one of its frames.

    Attributes:
        stamp_ns: ROS time of the frame [ns].
        time: Simulated time [s].
        values: The texts of its status by name, such as ``volume_held_m3``.
    """

    stamp_ns: int
    time: float
    values: Mapping[str, str]

    def number(self, name: str) -> float:
        """A value as a number, NaN where there is none."""
        try:
            return float(self.values.get(name, 'nan'))
        except ValueError:
            return float('nan')


class Timeline:
    """The moments of a bag, and which simulated time was shown when.

    Attributes:
        moments: The newest diagnostics of every frame they speak of, in the order of stamps.
    """

    def __init__(self, bag: BagReader, decoder: Decoder) -> None:
        """Read the diagnostics of a bag; without any there are no moments."""
        known: dict[int, Moment] = {}
        for message in bag.messages([DIAGNOSTICS] if DIAGNOSTICS in bag.topics else []):
            for moment in decoder.decode(message, _moments):
                known[moment.stamp_ns] = moment
        self.moments = tuple(known[stamp] for stamp in sorted(known))

    @property
    def last_run(self) -> tuple[Moment, ...]:
        """The moments since the simulation was last set back to an earlier time."""
        start = 0
        for index in range(1, len(self.moments)):
            if self.moments[index].time < self.moments[index - 1].time:
                start = index
        return self.moments[start:]

    def stamp_at(self, time: float | None) -> int | None:
        """Stamp of the newest frame up to a simulated time [s], None for the newest of all."""
        for moment in reversed(self.moments):
            if time is None or moment.time <= time:
                return moment.stamp_ns
        return None

    def time_at(self, stamp_ns: int) -> float | None:
        """Simulated time [s] at a stamp, None where nothing is known."""
        moments = self.moments
        if not moments or not moments[0].stamp_ns <= stamp_ns <= moments[-1].stamp_ns:
            return None
        # Nanoseconds since 1970 have more digits than a float64.
        since_first = [moment.stamp_ns - moments[0].stamp_ns for moment in moments]
        times = [moment.time for moment in moments]
        return float(np.interp(stamp_ns - moments[0].stamp_ns, since_first, times))

    @property
    def span(self) -> str:
        """The simulated times there are, for errors."""
        times = [moment.time for moment in self.moments]
        if not times:
            return 'absent: the bag does not say its simulated time'
        return f'{min(times):g} to {max(times):g} s'


def last_moment(bag: BagReader, decoder: Decoder) -> Moment | None:
    """The newest moment of a bag, None where it says nothing; quick where the node was alone."""
    for message in bag.newest([DIAGNOSTICS], (bag.end_ns or 0) + 1):
        found: list[Moment] = decoder.decode(message, _moments)
        if found:
            return found[0]
    moments = Timeline(bag, decoder).moments
    return moments[-1] if moments else None


def _moments(message: Any) -> list[Moment]:
    return [item for item in map(moment_of, message.status) if item is not None]


def moment_of(status: Any) -> Moment | None:
    """What the status of a simulation says of its newest frame; None for another status."""
    values = {item.key: item.value for item in status.values}
    try:
        stamp, time = int(values['frame_stamp_ns']), float(values['simulated_time_s'])
    except (KeyError, ValueError):
        # the status of something else
        return None
    is_usable = math.isfinite(time) and 0 <= stamp < 2**63
    return Moment(stamp, time, values) if is_usable else None
