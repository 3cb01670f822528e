# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Quality of service in the format that rosbag2 writes to a bag."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError, refusing
from lava_ros.files.yaml import dump_yaml, parse_yaml

#: rosbag2's value for a duration without limit [ns].
INFINITE_NS = 2**63 - 1

#: Depth of a history if none was recorded: the depth in rmw's default profile.
DEFAULT_DEPTH = 10

# Names of each policy, in the order of their numbers in metadata before version 9.
_WORDS = {
    'history': ('system_default', 'keep_last', 'keep_all', 'unknown'),
    'reliability': ('system_default', 'reliable', 'best_effort', 'unknown', 'best_available'),
    'durability': ('system_default', 'transient_local', 'volatile', 'unknown', 'best_available'),
    'liveliness': (
        'system_default', 'automatic', 'manual_by_node', 'manual_by_topic', 'unknown',
        'best_available',
    ),
}

_DURATIONS = ('deadline', 'lifespan', 'liveliness_lease_duration')


@dataclass(frozen=True)
class QosProfile:
    """The QoS that a publisher offers: names of policies, and durations [ns].

    Fields have the names and meanings of rmw_qos_profile_t.
    """

    history: str = 'keep_last'
    depth: int = DEFAULT_DEPTH
    reliability: str = 'reliable'
    durability: str = 'volatile'
    deadline: int = INFINITE_NS
    lifespan: int = INFINITE_NS
    liveliness: str = 'automatic'
    liveliness_lease_duration: int = INFINITE_NS
    avoid_ros_namespace_conventions: bool = False

    def __post_init__(self) -> None:
        """Validate the policies.

        Raises:
            LavaError: If rmw does not define a policy.
        """
        for name, words in _WORDS.items():
            validation.choice(f'qos.{name}', getattr(self, name), words)

    @property
    def is_latched(self) -> bool:
        """True if a late subscriber receives messages that were published before it joined."""
        return self.durability == 'transient_local'

    def to_dict(self) -> dict[str, Any]:
        """Convert the profile to the form in rosbag2's metadata, keys in rosbag2's order."""
        result = asdict(self)
        for name in _DURATIONS:
            seconds, nanoseconds = divmod(result[name], 10**9)
            result[name] = {'sec': seconds, 'nsec': nanoseconds}
        return result


#: Profile of the package's maps: a late subscriber receives the newest map.
LATCHED = QosProfile(depth=1, durability='transient_local')


def profiles_to_yaml(profiles: Iterable[QosProfile]) -> str:
    """Convert profiles to the YAML list of a channel's ``offered_qos_profiles``."""
    return dump_yaml([item.to_dict() for item in profiles]).strip()


def profiles_from_yaml(text: str) -> tuple[QosProfile, ...]:
    """Read the ``offered_qos_profiles`` of a channel, from bag metadata of any version.

    An empty text gives no profiles.

    Raises:
        LavaError: If the text is not a YAML list of QoS profiles.
    """
    expected = 'a YAML list of QoS profiles as rosbag2 writes it'
    items = parse_yaml('offered_qos_profiles', text, expected) or []
    if not isinstance(items, list):
        raise LavaError('offered_qos_profiles', text, expected)
    with refusing('offered_qos_profiles', text, expected):
        return tuple(_from_dict(item) for item in items)


def merge(profiles: Iterable[QosProfile]) -> QosProfile:
    """Combine the profiles of several publishers.

    The result is the first profile with the strongest reliability and durability: it matches
    every subscriber that matched one of them. Without profiles it is the default one.
    """
    items = tuple(profiles) or (QosProfile(),)
    strongest = {}
    if any(item.reliability == 'reliable' for item in items):
        strongest['reliability'] = 'reliable'
    if any(item.is_latched for item in items):
        strongest['durability'] = LATCHED.durability
    return replace(items[0], **strongest)  # type: ignore[arg-type]


def _from_dict(data: Mapping[str, Any]) -> QosProfile:
    values: dict[str, Any] = {}
    for item in fields(QosProfile):
        value = data[item.name]
        if item.name in _WORDS and isinstance(value, int):
            value = _WORDS[item.name][value]
        elif isinstance(value, Mapping):
            value = min(int(value['sec']) * 10**9 + int(value['nsec']), INFINITE_NS)
        values[item.name] = value
    # Discovery does not transmit the history, so rosbag2 records it as unknown with depth 0.
    if values['history'] in ('unknown', 'system_default') or values['depth'] < 1:
        values.update(history='keep_last', depth=DEFAULT_DEPTH)
    return QosProfile(**values)
