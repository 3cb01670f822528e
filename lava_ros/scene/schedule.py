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

"""What has come out of vents that were changed while lava came out of them."""

from collections.abc import Sequence
from dataclasses import replace

from lava_ros.scene.vents import Vent

#: Most vents that have closed which are remembered, and most entries of a vent's series.
MOST_CLOSED, LONGEST_SERIES = 100, 1000


def schedule(before: Sequence[Vent], vents: Sequence[Vent], time: float) -> tuple[Vent, ...]:
    """Combine the discharges of vents before and after a change at ``time``, simulated [s].

    Each vent emits as in ``before`` up to that time, and as in ``vents`` from then on; a vent that
    is no longer there emits 0. Vents that differ only in name and discharge are the same vent.
    """
    coming = {_identity(vent): vent for vent in vents}
    closed, open_ = [], []
    for vent in before:
        after = coming.pop(_identity(vent), None)
        start = [(0.0, vent.discharge_at(0.0))] if time > 0.0 else []
        past = [*start, *(entry for entry in vent.series if 0.0 < entry[0] < time)]
        if after is not None:
            open_.append(_with(after, past, after, time))
        elif any(flux > 0.0 for _, flux in past):
            closed.append(_with(vent, past, None, time))
    new = [_with(vent, [], vent, time) for vent in coming.values()]
    return (*closed[-MOST_CLOSED:], *open_, *new)


def _identity(vent: Vent) -> Vent:
    return replace(vent, name='', discharge=0.0)


def _with(
    vent: Vent, past: Sequence[tuple[float, float]], after: Vent | None, time: float
) -> Vent:
    """A vent with a past; from a time on it emits what another does, or nothing."""
    now = (time, after.discharge_at(time) if after is not None else 0.0)
    rest = [entry for entry in after.series if entry[0] > time] if after is not None else []
    changes: list[tuple[float, float]] = []
    for at, flux in (*past, now, *rest):
        if flux != (changes[-1][1] if changes else 0.0):
            changes.append((at, flux))
    if not changes or (changes[0] == (0.0, now[1]) and len(changes) == 1):
        # it has always been what it is
        return replace(vent, discharge=now[1])
    return replace(vent, discharge=tuple(changes[-LONGEST_SERIES:]))
