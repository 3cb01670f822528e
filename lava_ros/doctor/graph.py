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

"""The ROS graph: installation, environment, security, delivery of layers, a round trip."""

from collections.abc import Iterable, Iterator, Mapping
import importlib.metadata
from importlib.util import find_spec
import json
import os
from pathlib import Path
import subprocess
import sys

from lava_ros.bag.qos import LATCHED, QosProfile
from lava_ros.doctor import FAIL, OK, Said, WARN
from lava_ros.maps.layers import Layer, OCCUPANCY_GRID

#: The ROS distribution this package is made for.
DISTRO = 'jazzy'

#: Domains whose ports lie below those that Linux gives away by itself.
SAFE_DOMAINS = range(0, 102)

#: Domains there can be at all.
DOMAINS = range(0, 233)

#: What ROS_AUTOMATIC_DISCOVERY_RANGE may say, and what that means.
DISCOVERY_RANGES = {
    'SUBNET': 'every machine of the subnet',
    'LOCALHOST': 'this machine alone',
    'SYSTEM_DEFAULT': 'as the middleware is configured',
    'OFF': 'nobody',
}

#: Where a robot or a viewer takes layers from, and what it asks for.
CONSUMERS = (
    ("RViz's map display (rviz/lava.rviz)", (OCCUPANCY_GRID,), LATCHED),
    ("Nav2's keepout filter, speed filter and static layer", (OCCUPANCY_GRID,), LATCHED),
)

#: Longest time a round trip may take, discovery included [s].
PROBE_TIMEOUT = 30.0

#: Time from which a round trip on one machine is slow [ms].
SLOW = 50.0

_WAY_TO_ROS = "source a ROS 2 Jazzy installation, or: pip install 'lava_ros[ros]'"


def check_ros(environment: Mapping[str, str] = os.environ) -> Iterator[Said]:
    """Whether ROS 2 Jazzy can be imported, and which middleware it has."""
    missing = [name for name in ('rclpy', 'nav_msgs', 'diagnostic_msgs') if not find_spec(name)]
    if missing:
        yield FAIL, f'no Python package {", ".join(missing)}', _WAY_TO_ROS
        return
    distro = environment.get('ROS_DISTRO', '')
    source = 'an installation' if environment.get('AMENT_PREFIX_PATH') else 'wheels'
    if distro and distro != DISTRO:
        yield WARN, f'ROS_DISTRO is {distro}', f'source ROS 2 {DISTRO}'
        return
    version = _version('ros-rclpy') or _version('rclpy')
    middleware = environment.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp (default)')
    yield OK, f'{DISTRO} from {source}, rclpy {version}, {middleware}'


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ''


def check_discovery(environment: Mapping[str, str] = os.environ) -> Iterator[Said]:
    """Which graph the node joins, and who else can."""
    domain = environment.get('ROS_DOMAIN_ID', '') or '0'
    if not domain.isdigit() or int(domain) not in DOMAINS:
        yield FAIL, f'ROS_DOMAIN_ID is {domain!r}', 'set it to a number from 0 to 101'
        return
    if int(domain) not in SAFE_DOMAINS:
        yield (
            WARN, f'the ports of domain {domain} are among those Linux gives away by itself',
            'set ROS_DOMAIN_ID to a number from 0 to 101',
        )
    if environment.get('ROS_LOCALHOST_ONLY'):
        yield (
            WARN, 'ROS_LOCALHOST_ONLY is deprecated and overrides the discovery range',
            'unset it; ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST does the same',
        )
    reach = environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE', '') or 'SUBNET'
    text = f'domain {domain}, range {reach}: {DISCOVERY_RANGES.get(reach, "no such range")}'
    peers = environment.get('ROS_STATIC_PEERS', '')
    if peers:
        text += f', and {peers}'
    if reach not in DISCOVERY_RANGES:
        yield FAIL, text, f'set it to one of {", ".join(DISCOVERY_RANGES)}'
    elif reach == 'OFF' and not peers:
        yield FAIL, text, 'set ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET'
    elif reach == 'SUBNET':
        yield (
            OK, text,
            'who is in the subnet can command the node; LOCALHOST keeps it on this machine',
        )
    else:
        yield OK, text


def check_security(environment: Mapping[str, str] = os.environ) -> Iterator[Said]:
    """Whether SROS2 is on, and can be."""
    if environment.get('ROS_SECURITY_ENABLE', 'false').lower() != 'true':
        yield OK, 'off: messages are neither signed nor encrypted'
        return
    if not environment.get('AMENT_PREFIX_PATH'):
        yield (
            FAIL, 'on, but the wheels are built without DDS security',
            'run the node from a ROS 2 Jazzy installation, or unset ROS_SECURITY_ENABLE',
        )
        return
    keystore = environment.get('ROS_SECURITY_KEYSTORE', '')
    if not (Path(keystore) / 'enclaves').is_dir() or not keystore:
        yield (
            FAIL, f'on, but ROS_SECURITY_KEYSTORE is {keystore!r}',
            'ros2 security create_keystore DIRECTORY, and set it to that',
        )
        return
    if environment.get('ROS_SECURITY_STRATEGY', 'Permissive') != 'Enforce':
        yield (
            WARN, f'on with {keystore}, but nodes without keys are let in',
            'set ROS_SECURITY_STRATEGY=Enforce',
        )
        return
    yield OK, f'enforced with {keystore}'


def check_qos(layers: Iterable[Layer]) -> Iterator[Said]:
    """Whether those who read the layers get what they ask for."""
    enabled = [layer for layer in layers if layer.enabled]
    problems = False
    for consumer, messages, asked in CONSUMERS:
        for layer in enabled:
            if layer.message not in messages:
                continue
            for policy in _short_of(layer.qos, asked):
                problems = True
                yield (
                    WARN, f'{consumer} gets nothing of {layer.topic}: it is '
                    f'{getattr(layer.qos, policy)}',
                    f'set layers.{layer.name}.qos.{policy} to {getattr(asked, policy)}',
                )
    if not problems:
        names = ', '.join(layer.topic for layer in enabled)
        yield OK, f'{names}: RViz and Nav2 get what they ask for'


def _short_of(offered: QosProfile, asked: QosProfile) -> list[str]:
    """The policies in which an offer does not meet a request."""
    short = []
    if asked.reliability == 'reliable' and offered.reliability != 'reliable':
        short.append('reliability')
    if asked.durability == 'transient_local' and offered.durability != 'transient_local':
        short.append('durability')
    return short


def check_round_trip(timeout: float = PROBE_TIMEOUT) -> Iterator[Said]:
    """Check whether a message returns through the middleware within ``timeout`` [s], and how fast.

    In a process of its own: middleware that hangs or crashes is a finding.
    """
    if find_spec('rclpy') is None:
        yield FAIL, 'not tried: no rclpy', _WAY_TO_ROS
        return
    way_out = (
        'let the firewall pass UDP 7400 to 7500 and multicast, see that /dev/shm can be written, '
        'and try ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST'
    )
    try:
        probe = subprocess.run(
            [sys.executable, '-m', 'lava_ros.ros.loopback'],
            capture_output=True,
            text=True,
            timeout=timeout,
            check=False,
        )
    except subprocess.TimeoutExpired:
        yield FAIL, f'nothing came back within {timeout:g} s', way_out
        return
    try:
        seen = json.loads(probe.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        last = (probe.stderr.strip().splitlines() or ['nothing'])[-1]
        text = f'the probe ended with status {probe.returncode}: {last}'
        yield FAIL, text, way_out
        return
    if 'error' in seen:
        yield FAIL, seen['error'], way_out
        return
    text = (
        f'{seen["middleware"]}: found after {seen["discovery_ms"]:.0f} ms, '
        f'there in {seen["trip_ms"]:.2f} ms, {seen["nodes"]} other nodes in the graph'
    )
    if seen['trip_ms'] > SLOW:
        yield WARN, text, 'it is slow: see whether the machine is busy'
    else:
        yield OK, text
