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

"""Quality of service of the node's topics, for rclpy and for bags."""

import os

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from lava_ros.bag.qos import LATCHED as LATCHED
from lava_ros.bag.qos import QosProfile

#: Messages from people and viewers: none may be lost, none waits for latecomers.
COMMANDS = QosProfile()

DIAGNOSTICS = QosProfile()


def ros_profile(qos: QosProfile) -> QoSProfile:
    """Return the profile for publishers and subscriptions."""
    return QoSProfile(
        depth=qos.depth,
        reliability=ReliabilityPolicy.get_from_short_key(qos.reliability),
        durability=DurabilityPolicy.get_from_short_key(qos.durability),
    )


def terrain_profile(*, transient_local: bool) -> QoSProfile:
    """Return the profile for terrain: latched, or not to hear a volatile publisher."""
    return ros_profile(LATCHED if transient_local else QosProfile(depth=1))


def publish_without_waiting() -> None:
    """Let Fast DDS send from a thread of its own, unless the user says otherwise.

    Its default sends from the thread that publishes, which then waits where sending again to a
    subscriber that has stopped reading is under way: seconds in which nobody is served. Has to be
    called before ``rclpy.init``; other middleware ignores it.
    """
    os.environ.setdefault('RMW_FASTRTPS_PUBLICATION_MODE', 'ASYNCHRONOUS')
