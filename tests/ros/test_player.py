# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Replay into a real graph."""

from collections.abc import Iterator
from itertools import pairwise
import os
from pathlib import Path
import signal
import threading
import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from lava_ros.bag import BagReader, BagWriter, LATCHED, QosProfile
from lava_ros.bag.qos import INFINITE_NS
from lava_ros.bag.schemas import MessageSchema
from lava_ros.errors import LavaError
from lava_ros.ros.codec import message_class
from lava_ros.ros.player import play
from lava_ros.ros.qos import ros_profile
from ros.graph_publisher import PATIENCE, wait_until
from ros_domain import own_domain

SECOND = 1_000_000_000
TEXT = 'std_msgs/msg/String'

Written = dict[str, list[bytes]]


@pytest.fixture
def bag(tmp_path: Path) -> tuple[BagReader, Written]:
    """Two seconds: /map latched at 0 s and 1 s, /text ten times a second."""
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
    return BagReader(tmp_path / 'bag'), written


class Listener:
    """Keeps the bytes of what arrives, topic by topic, in a thread of its own."""

    def __init__(self, node: Node) -> None:
        """Subscribe to the bag's topics and the clock."""
        self.node = node
        self.raw: Written = {'/map': [], '/text': []}
        self.clock: list[int] = []
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

    def back(self) -> list[int]:
        """Times of the clock that are earlier than the one before."""
        return [b for a, b in pairwise(self.clock) if b < a]


@pytest.fixture
def listener() -> Iterator[Listener]:
    """One in a domain of this test process, where the player plays too."""
    context = Context()
    context.init(domain_id=own_domain())
    node = Node('listener', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    result = Listener(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    yield result
    executor.shutdown()
    thread.join(PATIENCE)
    node.destroy_node()
    context.shutdown()


def same_bytes(received: list[bytes], written: list[bytes]) -> bool:
    """Whether messages are the same but for the zeros that DDS pads to four bytes with."""
    return len(received) == len(written) and all(
        got == sent + bytes(-len(sent) % 4) or got == sent
        for got, sent in zip(received, written, strict=True)
    )


def test_subscribers_get_the_recorded_bytes(
    bag: tuple[BagReader, Written], listener: Listener
) -> None:
    """Every message arrives in order, byte for byte, with the clock of the bag, at the rate."""
    reader, written = bag
    begin = time.monotonic()
    assert play(reader, rate=2, wait_for_subscribers=PATIENCE) == 23
    took = time.monotonic() - begin
    assert took > 1.0
    wait_until(lambda: listener.clock and listener.clock[-1] == 52 * SECOND)
    assert same_bytes(listener.raw['/map'], written['/map'])
    assert same_bytes(listener.raw['/text'], written['/text'])
    assert deserialize_message(listener.raw['/text'][3], String).data.startswith('3 lava')
    assert listener.clock == sorted(listener.clock)
    assert listener.clock[0] >= 50 * SECOND
    # Between messages too; nobody waits for the clock's subscriber to be matched.
    assert {stamp for stamp in listener.clock if stamp % (SECOND // 10)}
    # at 100 Hz, and with 23 messages
    assert len(listener.clock) < 150 * took


def test_an_offset_delivers_the_latched_map_first(
    bag: tuple[BagReader, Written], listener: Listener
) -> None:
    """The map from before the start arrives, the volatile text from before does not."""
    reader, written = bag
    play(reader, start_offset=1.55, wait_for_subscribers=PATIENCE, clock=False)
    wait_until(lambda: len(listener.raw['/text']) == 5)
    assert same_bytes(listener.raw['/map'], written['/map'][-1:])
    assert same_bytes(listener.raw['/text'], written['/text'][16:])
    assert listener.clock == []


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_loop_cleanly(
    bag: tuple[BagReader, Written], listener: Listener, number: signal.Signals
) -> None:
    """A player in an endless loop stops at once; then the handlers are those of before."""
    handler = signal.getsignal(number)

    def interrupt() -> None:
        wait_until(lambda: listener.back() and len(listener.raw['/text']) >= 50)
        os.kill(os.getpid(), number)

    thread = threading.Thread(target=interrupt)
    thread.start()
    assert play(bag[0], loop=True, rate=50, wait_for_subscribers=PATIENCE) >= 50
    thread.join(PATIENCE)
    # /clock keeps the newest time alone: any number of those that a turn begins with may be lost
    assert listener.back()
    assert {50 * SECOND <= time_ns <= 52 * SECOND for time_ns in listener.clock} == {True}
    assert signal.getsignal(number) is handler


def test_topics_of_unknown_types_are_left_out(
    tmp_path: Path, listener: Listener, capfd: pytest.CaptureFixture[str]
) -> None:
    """A topic whose type is not installed is named in a warning, the others are played."""
    text = serialize_message(String(data='hot'))
    unknown = MessageSchema('gone_msgs/msg/Gone', 'uint8 x\n', 'RIHS01_0')
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write('/gone', unknown.name, text, 0, qos=LATCHED, schema=unknown)
        writer.write('/map', TEXT, text, 0, qos=LATCHED)
    assert play(BagReader(tmp_path / 'bag')) == 1
    assert '/gone is left out: message_type is' in capfd.readouterr().err


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


#: Namespace of a recorded node and arguments of a replay: names of the replayed topics.
NAMES = [
    ('/', [], {'/hazard': '/hazard'}),
    ('/', ['__ns:=/etna'], {'/hazard': '/etna/hazard', '/lava/events': '/etna/lava/events'}),
    ('/', ['__ns:=/etna'], {'/diagnostics': '/diagnostics', '/tf_static': '/tf_static'}),
    ('/', ['__ns:=/etna', 'hazard:=/map'], {'/hazard': '/map', '/height': '/etna/height'}),
    ('/', ['/hazard:=/map'], {'/hazard': '/map'}),
    ('/etna', [], {'/etna/hazard': '/etna/hazard'}),
    ('/etna', ['__ns:=/hekla'], {'/etna/hazard': '/hekla/hazard', '/map': '/map'}),
    # of ros2 bag record
    (None, ['__ns:=/etna'], {'/hazard': '/etna/hazard', '/etna/hazard': '/etna/etna/hazard'}),
]


@pytest.mark.parametrize(('recorded', 'rules', 'names'), NAMES)
def test_names_are_resolved_as_a_node_resolves_them(
    tmp_path: Path,
    listener: Listener,
    recorded: str | None,
    rules: list[str],
    names: dict[str, str],
) -> None:
    """A replay takes the place of the node in its namespace; shared topics stay where they are."""
    data = {} if recorded is None else {'namespace': recorded}
    with BagWriter(tmp_path / 'bag', custom_data=data) as writer:
        for topic in names:
            text = serialize_message(String(data=topic))
            writer.write(topic, TEXT, text, 0, qos=LATCHED)
    heard: dict[str, list[str]] = {name: [] for name in names.values()}
    for name, texts in heard.items():
        listener.node.create_subscription(
            String, name, lambda message, texts=texts: texts.append(message.data), 10
        )
    words = ['--ros-args', *(word for rule in rules for word in ('-r', rule))]
    play(BagReader(tmp_path / 'bag'), wait_for_subscribers=PATIENCE, ros_arguments=words)
    expected = {name: [topic] for topic, name in names.items()}
    wait_until(lambda: heard == expected, lambda: f'{heard} is not {expected}')


@pytest.mark.parametrize('words', [['-r', 'x'], ['--nope'], ['-r', '__ns:=no slash']])
def test_what_ros_cannot_read_is_refused(bag: tuple[BagReader, Written], words: list[str]) -> None:
    """By the word, before anything is published."""
    with pytest.raises(LavaError) as raised:
        play(bag[0], ros_arguments=['--ros-args', *words])
    assert raised.value.field in ('--ros-args', '-r')
    assert raised.value.value == words[-1]
