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

from typing import Any

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)

from lava_ros.bag.qos import INFINITE_NS, QosProfile
from lava_ros.bag.qos import LATCHED as LATCHED

#: Messages from people and viewers: none may be lost, none waits for latecomers.
COMMANDS = QosProfile()

DIAGNOSTICS = QosProfile()


def ros_profile(profile: QosProfile) -> QoSProfile:
    """The profile as rclpy has it; what a bag does not know becomes rmw's default."""
    durations = {
        name: Duration(nanoseconds=value)
        for name in ('deadline', 'lifespan', 'liveliness_lease_duration')
        if 0 < (value := getattr(profile, name)) < INFINITE_NS
    }
    return QoSProfile(
        history=HistoryPolicy.get_from_short_key(profile.history),
        depth=profile.depth,
        reliability=_policy(ReliabilityPolicy, profile.reliability, 'reliable'),
        durability=_policy(DurabilityPolicy, profile.durability, 'volatile'),
        liveliness=_policy(LivelinessPolicy, profile.liveliness, 'automatic'),
        avoid_ros_namespace_conventions=profile.avoid_ros_namespace_conventions,
        **durations,
    )


def _policy(kind: Any, word: str, default: str) -> Any:
    usable = word in kind.short_keys() and word not in ('unknown', 'best_available')
    return kind.get_from_short_key(word if usable else default)
