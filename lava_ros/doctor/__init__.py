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

"""What `lava doctor` looks at: the machine and the ROS graph, each finding with its way out."""

from dataclasses import dataclass

#: Nothing to do.
OK = 'OK'

#: It works, though less well than it could, or not for everybody.
WARN = 'WARN'

#: It does not work.
FAIL = 'FAIL'

#: What a check finds: level, text and maybe a remedy.
Said = tuple[str, str] | tuple[str, str, str]


@dataclass(frozen=True)
class Finding:
    """One line of the report: the subject, the level, what was found, and maybe a remedy."""

    check: str
    level: str
    text: str
    way_out: str = ''
