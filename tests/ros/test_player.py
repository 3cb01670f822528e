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

"""Replay into a real graph, from another process."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from lava_ros.bag import BagWriter, LATCHED, QosProfile
from lava_ros.bag.qos import INFINITE_NS
from lava_ros.bag.schemas import MessageSchema
from lava_ros.errors import LavaError
from lava_ros.ros.codec import message_class
from lava_ros.ros.qos import ros_profile
from ros_domain import own_domain

SECOND = 1_000_000_000
TEXT = 'std_msgs/msg/String'
ROOT = Path(__file__).parents[2]

PLAY = """
import json, sys
from lava_ros.bag import BagReader
from lava_ros.ros.player import play
print(play(BagReader(sys.argv[1]), **json.loads(sys.argv[2])))
"""

#: How long to wait for what has to come, on a busy machine too [s].
PATIENCE = 60.0

Written = dict[str, list[bytes]]


@pytest.fixture
def bag(tmp_path: Path) -> tuple[Path, Written]:
    """Two seconds: /map latched at 0 s and 1 s, /text ten times a second, one of unknown type."""
    written: Written = {'/map': [], '/text': []}
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        for tenth in range(21):
            stamp = 50 * SECOND + tenth * SECOND // 10
            text = serialize_message(String(data=f'{tenth} ' + 'lava ' * 1000))
            if tenth % 10 == 0 and tenth < 20:
                written['/map'].append(text)
                writer.write('/map', TEXT, text, stamp, qos=LATCHED)
            written['/text'].append(text)
            writer.write('/text', TEXT, text, stamp, qos=QosProfile(depth=100))
    return tmp_path / 'bag', written


@pytest.fixture
def domain() -> int:
    """A domain of this test process's own."""
    return own_domain('player')


@pytest.fixture
def node(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Node]:
    """A node in the domain of the test."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    node = Node('listener', context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


class Listener:
    """Keeps the bytes of what arrives, topic by topic."""

    def __init__(self, node: Node) -> None:
        """Subscribe to the bag's topics and the clock."""
        self.node = node
        self.raw: Written = {'/map': [], '/text': []}
        self.clock: list[int] = []
        self.executor = SingleThreadedExecutor(context=node.context)
        self.executor.add_node(node)
        latched = QoSProfile(
            depth=10,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
            reliability=ReliabilityPolicy.RELIABLE,
        )
        node.create_subscription(String, '/map', self.raw['/map'].append, latched, raw=True)
        node.create_subscription(String, '/text', self.raw['/text'].append, 100, raw=True)
        node.create_subscription(Clock, '/clock', self._on_clock, 1000)

    def _on_clock(self, message: Clock) -> None:
        self.clock.append(message.clock.sec * SECOND + message.clock.nanosec)

    def spin_until(self, process: 'subprocess.Popen[str]') -> str:
        """Take what arrives until the process has ended and all is there; returns its output."""
        deadline, heard = time.monotonic() + PATIENCE, -1
        while process.poll() is None or heard < self.heard:
            assert time.monotonic() < deadline
            heard = self.heard
            for _ in range(20):
                self.executor.spin_once(timeout_sec=0.02)
        output, errors = process.communicate(timeout=PATIENCE)
        assert process.returncode == 0, errors
        return output

    def back(self) -> list[int]:
        """Times of the clock that are earlier than the one before."""
        return [b for a, b in pairwise(self.clock) if b < a]

    @property
    def heard(self) -> int:
        """How many messages have come."""
        return sum(map(len, (*self.raw.values(), self.clock)))


def same_bytes(received: list[bytes], written: list[bytes]) -> bool:
    """Whether messages are the same but for the zeros that DDS pads to four bytes with."""
    return len(received) == len(written) and all(
        got == sent + bytes(-len(sent) % 4) or got == sent
        for got, sent in zip(received, written, strict=True)
    )


def start_player(bag: Path, options: str) -> 'subprocess.Popen[str]':
    """Start a player in a process of its own."""
    return subprocess.Popen(
        [sys.executable, '-c', PLAY, str(bag), options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )


def test_subscribers_get_the_recorded_bytes(bag: tuple[Path, Written], node: Node) -> None:
    """Every message arrives in order, byte for byte, with the clock of the bag, at the rate."""
    directory, written = bag
    listener = Listener(node)
    begin = time.monotonic()
    output = listener.spin_until(
        start_player(directory, '{"rate": 2, "wait_for_subscribers": 60}')
    )
    assert time.monotonic() - begin > 1.0
    assert same_bytes(listener.raw['/map'], written['/map'])
    assert same_bytes(listener.raw['/text'], written['/text'])
    assert deserialize_message(listener.raw['/text'][3], String).data.startswith('3 lava')
    assert output.strip() == '23'
    assert listener.clock == sorted(listener.clock)
    assert listener.clock[-1] == 52 * SECOND
    assert listener.clock[0] >= 50 * SECOND
    # Between messages too; nobody waits for the clock's subscriber to be matched.
    assert {stamp for stamp in listener.clock if stamp % (SECOND // 10)}
    # A second at 100 Hz and 23 messages, where nothing makes it longer.
    assert len(listener.clock) < 150


def test_an_offset_delivers_the_latched_map_first(bag: tuple[Path, Written], node: Node) -> None:
    """The map from before the start arrives, the volatile text from before does not."""
    directory, written = bag
    listener = Listener(node)
    options = '{"start_offset": 1.55, "wait_for_subscribers": 60, "clock": false}'
    listener.spin_until(start_player(directory, options))
    assert same_bytes(listener.raw['/map'], written['/map'][-1:])
    assert same_bytes(listener.raw['/text'], written['/text'][16:])
    assert listener.clock == []


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_loop_cleanly(
    bag: tuple[Path, Written], node: Node, number: signal.Signals
) -> None:
    """A player in an endless loop stops at once, with exit status 0 and without a traceback."""
    directory, _ = bag
    listener = Listener(node)
    process = start_player(directory, '{"loop": true, "rate": 50, "wait_for_subscribers": 60}')
    deadline = time.monotonic() + PATIENCE
    while not (back := listener.back()) or len(listener.raw['/text']) < 50:
        assert time.monotonic() < deadline
        listener.executor.spin_once(timeout_sec=0.05)
    process.send_signal(number)
    listener.spin_until(process)
    assert set(back) == {50 * SECOND}


def test_topics_of_unknown_types_are_left_out(tmp_path: Path, node: Node) -> None:
    """A topic whose type is not installed is named in a warning, the others are played."""
    text = serialize_message(String(data='hot'))
    unknown = MessageSchema('gone_msgs/msg/Gone', 'uint8 x\n', 'RIHS01_0')
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write('/gone', unknown.name, text, 0, qos=LATCHED, schema=unknown)
        writer.write('/map', TEXT, text, 0, qos=LATCHED)
    process = subprocess.run(
        [sys.executable, '-c', PLAY, str(tmp_path / 'bag'), '{}'],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=PATIENCE,
    )
    assert process.returncode == 0, process.stderr
    assert process.stdout.strip() == '1'
    assert '/gone is left out: message_type is' in process.stderr


def test_qos_is_the_recorded_one() -> None:
    """Each policy is carried over; without limit means rmw's default."""
    profile = ros_profile(QosProfile('keep_last', 3, 'best_effort', 'transient_local', 5 * SECOND))
    assert profile.depth == 3
    assert profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert profile.deadline.nanoseconds == 5 * SECOND
    assert profile.lifespan == QoSProfile(depth=1).lifespan
    unknown = ros_profile(QosProfile(reliability='unknown', deadline=INFINITE_NS))
    assert unknown.reliability == ReliabilityPolicy.RELIABLE


@pytest.mark.parametrize('name', ['os/msg/path', 'std_msgs/msg/Gone', '../msg/x', 'String'])
def test_only_message_types_are_imported(name: str) -> None:
    """A name from a bag that is no installed message type raises."""
    with pytest.raises(LavaError, match='message_type'):
        message_class(name)
