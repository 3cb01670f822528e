# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

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

#: QoS of messages from people and viewers: reliable and volatile.
COMMANDS = QosProfile()

DIAGNOSTICS = QosProfile()


def state_inputs(depth: int) -> tuple[QosProfile, ...]:
    """Return the profiles of the two subscriptions to an input that is a state, not an event.

    A transient_local subscription does not receive from volatile publishers, and a volatile one
    does not receive what a latched publisher sent before.
    """
    return QosProfile(depth=depth, durability='transient_local'), QosProfile(depth=depth)


#: QoS of messages of which only the newest counts.
NEWEST = QosProfile(depth=1)


def ros_profile(profile: QosProfile) -> QoSProfile:
    """Convert a profile to rclpy's class; policies that a bag lacks become rmw's default."""
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
