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

"""The policy for a secured graph: what it allows is what the node does."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from lava_ros.maps.layer_files import load_layers
from lava_ros.ros import grid_map

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent


@pytest.fixture(scope='module')
def profile():
    """The profile of the node."""
    policy = ElementTree.parse(ROOT / 'sros2' / 'lava_ros.policy.xml').getroot()
    (found,) = policy.findall('enclaves/enclave/profiles/profile')
    return found


def full_name(profile, name):
    """A name as the graph has it, by the rules of policies: they are those of ROS."""
    space, node = profile.get('ns').rstrip('/'), profile.get('node')
    if name.startswith('~'):
        return f'{space}/{node}{name[1:]}'
    return name if name.startswith('/') else f'{space}/{name}'


def allowed(profile, group, verb):
    """Full names of what a profile allows to do."""
    return sorted(
        full_name(profile, item.text)
        for part in profile.findall(group)
        if part.get(verb) == 'ALLOW'
        for item in part
    )


def test_the_policy_has_the_form_of_sros2():
    """Version, elements and attributes are those of the policy format 0.2.0."""
    policy = ElementTree.parse(ROOT / 'sros2' / 'lava_ros.policy.xml').getroot()
    assert (policy.tag, policy.attrib) == ('policy', {'version': '0.2.0'})
    (enclaves,) = policy
    (enclave,) = enclaves
    assert (enclaves.tag, enclave.tag) == ('enclaves', 'enclave')
    assert enclave.attrib == {'path': '/lava'}
    (profiles,) = enclave
    (profile,) = profiles
    assert (profiles.tag, profile.tag) == ('profiles', 'profile')
    assert profile.attrib == {'ns': '/', 'node': 'lava'}
    for group in profile:
        verbs = {'topics': ('publish', 'subscribe'), 'services': ('reply', 'request')}[group.tag]
        ((verb, qualifier),) = group.attrib.items()
        assert verb in verbs
        assert qualifier == 'ALLOW'
        assert {item.tag for item in group} == {group.tag.removesuffix('s')}
        names = [item.text for item in group]
        assert len(names) == len(set(names))


def test_the_policy_allows_what_the_node_does(graph, profile):
    """With every layer published and time from /clock, the node's names are the policy's."""
    absent = set() if grid_map.installed_classes() else {'/terrain_grid', '/lava_grid_map'}
    layers = load_layers(ROOT / 'msg_configs' / 'default.yaml')
    optional = [layer.name for layer in layers if f'/{layer.topic}' not in absent]
    ahead = {'forecast_horizon': 1.0, 'ensemble_members': 4}
    graph.node(device='cpu', layers_on=optional, use_sim_time=True, **ahead)
    names = json.loads(graph.process(str(HERE / 'graph_names.py'), 'lava').line(60.0))
    for kind, group, verb in (
        ('publisher', 'topics', 'publish'),
        ('subscriber', 'topics', 'subscribe'),
        ('service', 'services', 'reply'),
        ('client', 'services', 'request'),
    ):
        expected = [name for name in allowed(profile, group, verb) if name not in absent]
        assert names[kind] == expected
