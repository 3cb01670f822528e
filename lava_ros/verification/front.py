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

"""Rows reduced to points of error and cost, and the front that no other point beats."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import math

from lava_ros.presets import PRESETS
from lava_ros.verification.rows import Row


@dataclass(frozen=True)
class Point:
    """A setting in a case: the largest error of its quantities, and the time it took.

    Attributes:
        case: Name of the case.
        setting: Name of the setting.
        preset: Name of the preset that the setting is, or empty.
        error: Largest relative error.
        cost: Wall time for a simulated hour [s].
        particles: Particles at the end.
        least: Largest of the errors that are numbers; the error is infinite where one is not.
    """

    case: str
    setting: str
    preset: str
    error: float
    cost: float
    particles: int
    least: float


def points(rows: Iterable[Row]) -> list[Point]:
    """Reduce rows to one point for each case and setting, in their order."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row.case, row.setting), []).append(row)
    return [
        Point(
            case=case,
            setting=setting,
            preset=group[0].preset,
            # NaN, no result at all, is the worst
            error=max(math.inf if math.isnan(row.error) else row.error for row in group),
            cost=group[0].wall_s_per_simulated_hour,
            particles=group[0].particles,
            least=max((row.error for row in group if math.isfinite(row.error)), default=1.0),
        )
        for (case, setting), group in groups.items()
    ]


def presets_of(found: Iterable[Point]) -> list[str]:
    """Names of the presets among points, from the cheapest to the dearest."""
    names = {point.preset for point in found}
    return [name for name in PRESETS if name in names]


def pareto_front(candidates: Iterable[Point]) -> list[Point]:
    """The points that no other beats in both error and cost, from cheap to dear."""
    front: list[Point] = []
    candidates = [item for item in candidates if math.isfinite(item.error + item.cost)]
    for point in sorted(candidates, key=lambda item: (item.cost, item.error)):
        if not front or point.error < front[-1].error:
            front.append(point)
    return front
