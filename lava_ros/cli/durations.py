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

"""Times as people write them: 6h, 90min, 30s."""

import re

from lava_ros import validation
from lava_ros.errors import LavaError

#: Seconds of each unit.
UNITS = {'s': 1.0, 'min': 60.0, 'h': 3600.0, 'd': 86400.0}


def seconds_of(field: str, text: str) -> float:
    """Read a time.

    Args:
        field: What it is called in errors.
        text: A number with a unit, or of seconds without one.

    Returns:
        The time [s].

    Raises:
        LavaError: It is no time above 0.
    """
    match = re.fullmatch(r'\s*([^a-z\s]+(?:e[+-]?\d+)?)\s*([a-z]*)\s*', text)
    if match is None or (match[2] or 's') not in UNITS:
        raise LavaError(field, text, f'a number with a unit, {", ".join(UNITS)}: 6h, 90min')
    return validation.number(field, match[1], above=0.0) * UNITS[match[2] or 's']
