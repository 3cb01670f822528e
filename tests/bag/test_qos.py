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

"""QoS profiles of bags."""

import pytest
import yaml

from lava_ros.bag.qos import (
    INFINITE_NS,
    LATCHED,
    merge,
    profiles_from_yaml,
    profiles_to_yaml,
    QosProfile,
)
from lava_ros.errors import LavaError


def test_a_profile_is_a_yaml_list_of_words() -> None:
    """The text has the keys, order, words and infinite durations that rosbag2 of Jazzy writes."""
    infinite = {'sec': 9223372036, 'nsec': 854775807}
    items = yaml.safe_load(profiles_to_yaml([LATCHED]))
    assert items == [
        {
            'history': 'keep_last',
            'depth': 1,
            'reliability': 'reliable',
            'durability': 'transient_local',
            'deadline': infinite,
            'lifespan': infinite,
            'liveliness': 'automatic',
            'liveliness_lease_duration': infinite,
            'avoid_ros_namespace_conventions': False,
        }
    ]
    assert list(items[0])[:4] == ['history', 'depth', 'reliability', 'durability']


def test_a_profile_survives_a_round_trip() -> None:
    """What is written is read back, finite durations included."""
    profile = QosProfile(depth=3, reliability='best_effort', deadline=1_500_000_000)
    assert profiles_from_yaml(profiles_to_yaml([profile, LATCHED])) == (profile, LATCHED)


def test_profiles_of_old_bags_have_numbers() -> None:
    """Before metadata version 9 the policies are numbers."""
    time = '{sec: 0, nsec: 0}'
    text = (
        f'- {{history: 3, depth: 0, reliability: 2, durability: 1, deadline: {time}, '
        f'lifespan: {time}, liveliness: 1, liveliness_lease_duration: {time}, '
        'avoid_ros_namespace_conventions: false}'
    )
    (profile,) = profiles_from_yaml(text)
    assert (profile.reliability, profile.durability) == ('best_effort', 'transient_local')
    assert (profile.history, profile.depth) == ('keep_last', 10)
    assert profile.deadline == 0


NOT_PROFILES = ['a: 1', '- 1', '- {history: keep_last}', '[', '- {history: 9}', '- 2001-99-99']
NOT_PROFILES += [profiles_to_yaml([LATCHED]).replace('sec: 9223372036', 'sec: x')]


@pytest.mark.parametrize('text', NOT_PROFILES)
def test_text_that_is_no_profile_list_is_refused(text: str) -> None:
    """Anything but a list of complete profiles raises."""
    with pytest.raises(LavaError, match='offered_qos_profiles'):
        profiles_from_yaml(text)


def test_an_unknown_word_is_refused() -> None:
    """A policy that rmw does not know raises and says which there are."""
    with pytest.raises(LavaError, match=r'qos\.durability is .latched., expected one of'):
        QosProfile(durability='latched')


def test_merged_offers_match_every_subscriber() -> None:
    """The offer that stands for several is as strong as the strongest."""
    weak = QosProfile(reliability='best_effort')
    assert merge([weak, LATCHED]) == QosProfile(durability='transient_local')
    assert merge([weak, weak]) == weak
    assert merge([]) == QosProfile(deadline=INFINITE_NS)
