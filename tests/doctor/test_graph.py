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

"""Findings about the graph, in environments with one thing wrong."""

import subprocess
import sys
from typing import Any

import pytest

from lava_ros.doctor import FAIL, Finding, graph, OK, WARN
from lava_ros.files.resources import share_path
from lava_ros.maps.layer_files import layers_from_dict, load_layers


def one(findings: Any) -> Finding:
    """The only finding; a finding that is not OK has a way out."""
    (found,) = findings
    assert found.text
    assert found.way_out or found.level == OK
    return found


def test_ros(monkeypatch):
    """Jazzy from wheels or an installation is right, another distribution is not."""
    assert 'jazzy from wheels' in one(graph.check_ros({})).text
    sourced = {'AMENT_PREFIX_PATH': '/opt/ros/jazzy', 'ROS_DISTRO': 'jazzy'}
    assert 'jazzy from an installation' in one(graph.check_ros(sourced)).text
    found = one(graph.check_ros({'ROS_DISTRO': 'humble'}))
    assert (found.level, found.text) == (WARN, 'ROS_DISTRO is humble')
    monkeypatch.setattr(graph, 'find_spec', lambda name: None)
    found = one(graph.check_ros({}))
    assert found.level == FAIL
    assert "pip install 'lava_ros[ros]'" in found.way_out


@pytest.mark.parametrize(
    ('environment', 'level', 'words'),
    [
        ({}, OK, 'domain 0, range SUBNET: every machine of the subnet'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}, OK, 'this machine alone'),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}, FAIL, 'nobody'),
        (
            {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF', 'ROS_STATIC_PEERS': '10.0.0.7'},
            OK,
            'nobody, and 10.0.0.7',
        ),
        ({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'localhost'}, FAIL, 'no such range'),
        ({'ROS_DOMAIN_ID': '300'}, FAIL, "ROS_DOMAIN_ID is '300'"),
        ({'ROS_DOMAIN_ID': 'five'}, FAIL, "ROS_DOMAIN_ID is 'five'"),
    ],
)
def test_discovery(environment, level, words):
    """Who can hear the node, and whether anybody can."""
    found = one(graph.check_discovery(environment))
    assert found.level == level
    assert words in found.text


def test_discovery_warns_of_what_works_by_chance():
    """A domain whose ports others may take, and a variable that overrides the range."""
    environment = {'ROS_DOMAIN_ID': '150', 'ROS_LOCALHOST_ONLY': '1'}
    ports, deprecated, rest = graph.check_discovery(environment)
    assert (ports.level, deprecated.level, rest.level) == (WARN, WARN, OK)
    assert 'domain 150' in ports.text
    assert 'ROS_LOCALHOST_ONLY' in deprecated.text


def test_security(tmp_path):
    """Off is right; on needs an installation, a keystore and Enforce."""
    assert one(graph.check_security({})).level == OK
    on = {'ROS_SECURITY_ENABLE': 'true'}
    found = one(graph.check_security(on))
    assert (found.level, 'wheels' in found.text) == (FAIL, True)
    on['AMENT_PREFIX_PATH'] = '/opt/ros/jazzy'
    assert one(graph.check_security(on)).level == FAIL
    (tmp_path / 'enclaves').mkdir()
    on['ROS_SECURITY_KEYSTORE'] = str(tmp_path)
    found = one(graph.check_security(on))
    assert (found.level, found.way_out) == (WARN, 'set ROS_SECURITY_STRATEGY=Enforce')
    on['ROS_SECURITY_STRATEGY'] = 'Enforce'
    assert one(graph.check_security(on)).level == OK


@pytest.mark.parametrize(
    'name', ['default.yaml', 'monitoring.yaml', 'nav2_keepout.yaml', 'nav2_speed.yaml']
)
def test_layers_of_the_package_reach_robots(name):
    """What ships is delivered to RViz and Nav2."""
    found = one(graph.check_qos(load_layers(share_path(f'msg_configs/{name}'))))
    assert found.level == OK


def test_layers_that_do_not_reach_robots():
    """A policy that is too weak is named with who does not get it and what to set."""
    layer = {
        'source': 'hazard',
        'message': 'nav_msgs/OccupancyGrid',
        'qos': {'reliability': 'best_effort', 'durability': 'volatile'},
    }
    hidden = {**layer, 'enabled': False}
    image = {'source': 'thickness', 'message': 'sensor_msgs/Image', 'qos': layer['qos']}
    layers = layers_from_dict({'layers': {'mask': layer, 'hidden': hidden, 'raw': image}})
    findings = list(graph.check_qos(layers))
    assert len(findings) == 2 * len(graph.CONSUMERS)
    assert all(found.level == WARN and 'of mask' in found.text for found in findings)
    assert {found.way_out for found in findings} == {
        'set layers.mask.qos.reliability to reliable',
        'set layers.mask.qos.durability to transient_local',
    }


def test_a_round_trip(monkeypatch):
    """A latched message and twenty others go through the middleware, with their times."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    found = one(graph.check_round_trip())
    assert found.level in (OK, WARN), found.text
    assert found.text.startswith('rmw_fastrtps_cpp: found after ')
    assert ' ms, there in ' in found.text


def test_a_middleware_that_cannot_start(monkeypatch):
    """Its last words are told, and what to try."""
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'rmw_of_nobody')
    found = one(graph.check_round_trip())
    assert found.level == FAIL
    assert 'rmw_of_nobody' in found.text


@pytest.mark.parametrize(
    ('code', 'words'),
    [
        ('import time; time.sleep(60)', 'nothing came back within 0.5 s'),
        ('import os; os.abort()', 'ended with status -6'),
        ('print("""{"error": "a latched message did not arrive within 20 s"}""")', 'latched'),
    ],
)
def test_a_middleware_that_hangs_or_crashes(code, words, monkeypatch):
    """It does not take the doctor along."""
    run = subprocess.run

    def other(command, **options):
        return run([sys.executable, '-c', code], **options)

    monkeypatch.setattr(graph.subprocess, 'run', other)
    found = one(graph.check_round_trip(timeout=0.5 if 'sleep' in code else 20.0))
    assert found.level == FAIL
    assert words in found.text


def test_no_round_trip_without_ros(monkeypatch):
    """It says so."""
    monkeypatch.setattr(graph, 'find_spec', lambda name: None)
    assert one(graph.check_round_trip()).text == 'not tried: no rclpy'
