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

"""Whether ROS 2 is there, for the commands that need it."""

from importlib.util import find_spec

from lava_ros.errors import LavaError


def require_ros() -> None:
    """Do nothing where ROS 2 can be imported.

    Raises:
        LavaError: It cannot; the message says how to get it.
    """
    for name in ('rclpy', 'nav_msgs'):
        if find_spec(name) is None:
            raise LavaError(
                f'Python package {name}',
                None,
                "a sourced ROS 2 Jazzy installation, or: pip install 'lava_ros[ros]'",
            )
