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

"""Cases that run the solver where an exact solution is known."""

from lava_ros.verification.cases import confined, cooling, heat, inertia, rheology, sheets, slopes
from lava_ros.verification.cases.case import Case, Measurement, Run
from lava_ros.verification.cases.spreading import CASES as SPREADING
from lava_ros.verification.cases.spreading import spread_of_fixed_volume

__all__ = ['CASES', 'EFFECT_CASES', 'Case', 'Measurement', 'Run', 'spread_of_fixed_volume']

#: Cases of what lava does beside flowing and spreading: they have a chart of their own.
EFFECT_CASES = frozenset(
    case.name for case in (*heat.CASES, *cooling.CASES, *rheology.CASES, *inertia.CASES)
)

#: Every case by its name, from the simplest.
CASES: dict[str, Case] = {
    case.name: case
    for cases in (
        sheets.CASES, heat.CASES, cooling.CASES, rheology.CASES, confined.CASES, SPREADING,
        slopes.CASES, inertia.CASES,
    )
    for case in cases
}
