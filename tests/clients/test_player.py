# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Replay of a bag into a graph."""

from collections.abc import Iterator
from itertools import pairwise
import os
from pathlib import Path
import signal
import threading
from types import SimpleNamespace

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
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
from lava_ros.bag.recorded_node import select_node
from lava_ros.bag.replay import Step
from lava_ros.bag.schemas import MessageSchema
from lava_ros.clients import player
from lava_ros.clients.player import play
from lava_ros.errors import LavaError
from lava_ros.ros.codec import message_class
from lava_ros.ros.executor import start_ros
from lava_ros.ros.qos import ros_profile
from ros_domain import own_domain
from waiting import PATIENCE, wait_until

SECOND = 1_000_000_000
TEXT = 'std_msgs/msg/String'

Written = dict[str, list[bytes]]


@pytest.fixture
def bag(tmp_path: Path) -> tuple[BagReader, Written]:
    """A bag of two seconds: /map latched at 0 s and 1 s, /text ten times a second."""
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
    """Stores the bytes of received messages by topic, in a separate thread."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.raw: Written = {'/map': [], '/text': []}
        self.clock: list[int] = []
        latched = QoSProfile(
            depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL,
            reliability=ReliabilityPolicy.RELIABLE,
        )
        node.create_subscription(String, '/map', self.raw['/map'].append, latched, raw=True)
        node.create_subscription(String, '/text', self.raw['/text'].append, 100, raw=True)
        node.create_subscription(Clock, '/clock', self._on_clock, 1000)

    def _on_clock(self, message: Clock) -> None:
        self.clock.append(message.clock.sec * SECOND + message.clock.nanosec)

    def counts(self) -> dict[str, int]:
        return {name: len(each) for name, each in self.raw.items()}

    def back(self) -> list[int]:
        """Return the times of the clock that are earlier than the previous one."""
        return [b for a, b in pairwise(self.clock) if b < a]


@pytest.fixture
def listener() -> Iterator[Listener]:
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
    """Return True if messages are equal except for DDS's zero padding to four bytes."""
    return len(received) == len(written) and all(
        got == sent + bytes(-len(sent) % 4) or got == sent
        for got, sent in zip(received, written, strict=True)
    )


def test_subscribers_get_the_recorded_bytes(
    bag: tuple[BagReader, Written], listener: Listener
) -> None:
    reader, written = bag
    assert play(reader, rate=2, wait_for_subscribers=PATIENCE) == 23
    wait_until(lambda: listener.clock and listener.clock[-1] == 52 * SECOND)
    # topics are delivered independently of one another
    wait_until(lambda: listener.counts() == {name: len(each) for name, each in written.items()})
    assert same_bytes(listener.raw['/map'], written['/map'])
    assert same_bytes(listener.raw['/text'], written['/text'])
    assert deserialize_message(listener.raw['/text'][3], String).data.startswith('3 lava')
    assert listener.clock == sorted(listener.clock)
    assert listener.clock[0] >= 50 * SECOND
    # also between messages; the player does not wait for a subscriber of the clock
    assert {stamp for stamp in listener.clock if stamp % (SECOND // 10)}


def test_offset_delivers_the_latched_map_first(
    bag: tuple[BagReader, Written], listener: Listener
) -> None:
    reader, written = bag
    play(reader, start_offset=1.55, wait_for_subscribers=PATIENCE, clock=False)
    wait_until(lambda: listener.counts() == {'/map': 1, '/text': 5})
    assert same_bytes(listener.raw['/map'], written['/map'][-1:])
    assert same_bytes(listener.raw['/text'], written['/text'][16:])
    assert listener.clock == []


def test_signal_ends_a_loop(bag: tuple[BagReader, Written], listener: Listener) -> None:
    handler = signal.getsignal(signal.SIGTERM)

    def interrupt() -> None:
        wait_until(lambda: listener.back() and len(listener.raw['/text']) >= 50)
        os.kill(os.getpid(), signal.SIGTERM)

    thread = threading.Thread(target=interrupt)
    thread.start()
    assert play(bag[0], loop=True, rate=50, wait_for_subscribers=PATIENCE) >= 50
    thread.join(PATIENCE)
    # /clock keeps only the newest time: any number of times at the start of a loop may be lost
    assert listener.back()
    assert {50 * SECOND <= time_ns <= 52 * SECOND for time_ns in listener.clock} == {True}
    assert signal.getsignal(signal.SIGTERM) is handler


def test_topic_of_an_unknown_type_is_skipped(
    tmp_path: Path, listener: Listener, capfd: pytest.CaptureFixture[str]
) -> None:
    text = serialize_message(String(data='hot'))
    unknown = MessageSchema('gone_msgs/msg/Gone', 'uint8 x\n', 'RIHS01_0')
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write('/gone', unknown.name, text, 0, qos=LATCHED, schema=unknown)
        writer.write('/map', TEXT, text, 0, qos=LATCHED)
    assert play(BagReader(tmp_path / 'bag')) == 1
    assert '/gone is left out: message_type is' in capfd.readouterr().err


def test_qos_is_that_of_the_recording() -> None:
    profile = ros_profile(QosProfile('keep_last', 3, 'best_effort', 'transient_local', 5 * SECOND))
    assert profile.depth == 3
    assert profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert profile.deadline.nanoseconds == 5 * SECOND
    assert profile.lifespan == QoSProfile(depth=1).lifespan
    unknown = ros_profile(QosProfile(reliability='unknown', deadline=INFINITE_NS))
    assert unknown.reliability == ReliabilityPolicy.RELIABLE


@pytest.mark.parametrize('name', ['os/msg/path', 'std_msgs/msg/Gone', '../msg/x', 'String'])
def test_rejects_a_name_that_is_not_a_message_type(name: str) -> None:
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
def test_replay_resolves_names_like_the_node(
    tmp_path: Path, recorded: str | None, rules: list[str], names: dict[str, str]
) -> None:
    data = {} if recorded is None else {'namespace': recorded}
    with BagWriter(tmp_path / 'bag', custom_data=data) as writer:
        for topic in names:
            writer.write(topic, TEXT, serialize_message(String()), 0, qos=LATCHED)
    words = ['--ros-args', *(word for rule in rules for word in ('-r', rule))]
    context = Context()
    start_ros(words, context=context)
    node = Node('lava_player', context=context, start_parameter_services=False)
    made = player._Player(node, BagReader(tmp_path / 'bag'), clock=False)
    assert {topic: item.topic_name for topic, item in made._publishers.items()} == names
    node.destroy_node()
    context.shutdown()


@pytest.mark.parametrize(
    ('recorded', 'selected', 'name', 'moved'),
    [
        ('/', None, 'lava: simulation', 'x/lava: simulation'),
        ('/etna', None, 'etna/lava: simulation', 'x/lava: simulation'),
        ('/x', None, 'x/lava: simulation', 'x/lava: simulation'),
        # of ros2 bag record, all nodes or one of them
        (None, None, 'etna/lava: simulation', 'x/etna/lava: simulation'),
        (None, '/etna', 'etna/lava: simulation', 'x/lava: simulation'),
        # the status belongs to a node outside of the recorded namespace, or to no node
        ('/etna', None, 'hekla/lava: simulation', 'hekla/lava: simulation'),
        ('/etna', None, 'battery', 'battery'),
    ],
)
def test_diagnostics_of_a_replay_name_the_node_in_its_namespace(
    tmp_path: Path, recorded: str | None, selected: str | None, name: str, moved: str
) -> None:
    array = DiagnosticArray(status=[DiagnosticStatus(name=name, message='running')])
    array.status[0].values = [
        KeyValue(key='frame_stamp_ns', value='1'), KeyValue(key='simulated_time_s', value='2.0')
    ]
    kind, sent = 'diagnostic_msgs/msg/DiagnosticArray', serialize_message(array)
    data = {} if recorded is None else {'namespace': recorded}
    with BagWriter(tmp_path / 'bag', custom_data=data) as writer:
        writer.write('/diagnostics', kind, sent, 0, qos=QosProfile())
    bag = BagReader(tmp_path / 'bag')
    selection = None
    if selected is not None:
        selection = select_node(bag, selected, player.SHARED_TOPICS)
    context = Context()
    start_ros(['--ros-args', '-r', '__ns:=/x'], context=context)
    node = Node('lava_player', context=context, start_parameter_services=False)
    (message,) = bag.messages()
    made, got = player._Player(node, bag, selection, clock=False), []
    made._publishers = {'/diagnostics': SimpleNamespace(publish=got.append)}
    made.publish(Step(0.0, 0, message, 0))
    array.status[0].name = moved
    assert [deserialize_message(data, DiagnosticArray) for data in got] == [array]
    node.destroy_node()
    context.shutdown()


@pytest.mark.parametrize('words', [['-r', 'x'], ['--nope'], ['-r', '__ns:=no slash']])
def test_rejects_invalid_ros_arguments(bag: tuple[BagReader, Written], words: list[str]) -> None:
    with pytest.raises(LavaError) as raised:
        play(bag[0], ros_arguments=['--ros-args', *words])
    assert raised.value.field in ('--ros-args', '-r')
    assert raised.value.value == words[-1]
