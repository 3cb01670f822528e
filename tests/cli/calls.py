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

"""Commands as tests call them: those that have to go well, and those that have to be refused."""

from command_line import lava


def done(*words: object) -> str:
    """What a command that goes well prints."""
    status, out, err = lava(*words)
    assert status == 0, err
    return out


def refused(*words: object) -> str:
    """What a command says of input that cannot be used, which is all that it says."""
    status, out, err = lava(*words)
    assert (status, out) == (2, ''), out + err
    return err
