# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Quality of service as rosbag2 writes it into a bag."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import yaml

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.yaml import parse_yaml

#: What rosbag2 writes for a duration without limit [ns].
INFINITE_NS = 2**63 - 1

#: Depth of a history whose depth was not recorded: that of rmw's default profile.
DEFAULT_DEPTH = 10

# The words of each policy, in the order of the numbers that metadata before version 9 has.
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
    """What a publisher offers: policies in the words of rmw, and durations [ns].

    Names and meanings are those of rmw_qos_profile_t.
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
        """Raise LavaError where a policy is none that rmw knows."""
        for name, words in _WORDS.items():
            validation.choice(f'qos.{name}', getattr(self, name), words)

    @property
    def is_latched(self) -> bool:
        """Whether a late subscriber gets what was published before it came."""
        return self.durability == 'transient_local'

    def to_dict(self) -> dict[str, Any]:
        """The profile as rosbag2's metadata holds it, keys in rosbag2's order."""
        result = asdict(self)
        for name in _DURATIONS:
            seconds, nanoseconds = divmod(result[name], 10**9)
            result[name] = {'sec': seconds, 'nsec': nanoseconds}
        return result


#: What the package's maps are published with: the newest one waits for whoever comes late.
LATCHED = QosProfile(depth=1, durability='transient_local')


def profiles_to_yaml(profiles: Iterable[QosProfile]) -> str:
    """The YAML list that a channel's ``offered_qos_profiles`` holds."""
    text: str = yaml.safe_dump([item.to_dict() for item in profiles], sort_keys=False)
    return text.strip()


def profiles_from_yaml(text: str) -> tuple[QosProfile, ...]:
    """Read the ``offered_qos_profiles`` of a channel, from bag metadata of any version.

    An empty text gives no profiles; LavaError where it is not a YAML list of QoS profiles.
    """
    expected = 'a YAML list of QoS profiles as rosbag2 writes it'
    items = parse_yaml('offered_qos_profiles', text, expected) or []
    if not isinstance(items, list):
        raise LavaError('offered_qos_profiles', text, expected)
    try:
        return tuple(_from_dict(item) for item in items)
    except LavaError:
        raise
    except (ArithmeticError, LookupError, TypeError, ValueError) as error:
        raise LavaError('offered_qos_profiles', text, f'{expected} ({error})') from error


def merge(profiles: Iterable[QosProfile]) -> QosProfile:
    """One offer that stands for those of several publishers.

    It is the first one's, as reliable and as durable as the strongest: such an offer matches
    every subscriber that one of them matched. No profile gives the default one.
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
    # Discovery does not carry the history, so rosbag2 records it as unknown with depth 0.
    if values['history'] in ('unknown', 'system_default') or values['depth'] < 1:
        values.update(history='keep_last', depth=DEFAULT_DEPTH)
    return QosProfile(**values)
