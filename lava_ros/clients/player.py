# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Replay of a bag in a ROS graph: the recorded bytes with the recorded QoS, and /clock.

Only the diagnostics change, if the topics move to another namespace: they name their node.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
import signal
import time

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock

from lava_ros import validation
from lava_ros.bag import replay
from lava_ros.bag.decoding import DIAGNOSTICS, node_of
from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.bag.recorded_node import select_node, Selection
from lava_ros.errors import LavaError, RefusalError
from lava_ros.ros.codec import message_class, time_message
from lava_ros.ros.executor import start_ros
from lava_ros.ros.qos import ros_profile

CLOCK_TOPIC = '/clock'

#: Topics that all namespaces of a graph share.
SHARED_TOPICS = frozenset(
    (CLOCK_TOPIC, DIAGNOSTICS, '/parameter_events', '/rosout', '/tf', '/tf_static')
)

#: Maximum time between steps when no clock is published [s], short enough for a progress bar.
QUIET_TICK = 0.1

#: Maximum wait at the end until reliable subscribers have received everything [s].
ACKNOWLEDGE_TIMEOUT = 2.0


def play(
    bag: BagReader,
    *,
    node: str | None = None,
    clock: bool = True,
    wait_for_subscribers: float = 0.0,
    rate: float = 1.0,
    loop: bool = False,
    start_offset: float = 0.0,
    on_step: Callable[[replay.Step], None] = lambda step: None,
    ros_arguments: Sequence[str] = (),
) -> int:
    """Replay a bag in this process until it ends or SIGINT or SIGTERM arrives.

    Call it in the main thread; it makes a ROS context of its own. Topics whose message type is not
    installed are left out with a warning.

    Args:
        bag: The bag.
        node: Full name or namespace of the node whose topics to replay, in addition to those that
            all nodes share, without the diagnostics of others; None for all topics.
        clock: Whether to publish /clock, in place of a recorded one.
        wait_for_subscribers: Maximum wait for a subscriber on every topic [s].
        rate: Bag time per wall time [s/s].
        loop: Whether to start again at the end, without limit.
        start_offset: Bag time of the start after the bag's first message [s].
        on_step: Called after every message and clock tick.
        ros_arguments: ROS arguments, beginning with ``--ros-args``: a namespace, remapped topics.

    Returns:
        The number of messages published.

    Raises:
        LavaError: If an argument is out of range or not valid in ROS, the bag lacks the node, no
            topic is left, or the bag is empty or damaged.
    """
    patience = validation.number(
        'wait_for_subscribers', wait_for_subscribers, at_least=0.0, unit='s'
    )
    selection = None if node is None else select_node(bag, node, SHARED_TOPICS)
    topics = None if selection is None else selection.topics
    tick = replay.TICK if clock else QUIET_TICK
    with _stopped_by_signals() as wait:
        context = Context()
        start_ros(ros_arguments, context=context)
        ros_node = Node('lava_player', context=context, start_parameter_services=False)
        try:
            player = _Player(ros_node, bag, selection, clock=clock)
            player.wait_for_subscribers(patience, wait)
            dues = replay.schedule(
                bag, rate=rate, loop=loop, start_offset=start_offset, topics=topics
            )
            steps = replay.pace(dues, rate=rate, now=time.monotonic, wait=wait, tick=tick)
            for step in steps:
                player.publish(step)
                on_step(step)
            if not wait(0.0):
                player.wait_until_acknowledged()
        finally:
            ros_node.destroy_node()
            context.try_shutdown()
        return player.published


class _Player:
    """Publishers for the topics of a bag; ``published`` counts messages."""

    def __init__(
        self, node: Node, bag: BagReader, selection: Selection | None = None, *, clock: bool
    ) -> None:
        self.published = 0
        self._selection = selection
        described = bag.custom_data.get('namespace', '/')
        self._recorded = described if selection is None else selection.node.namespace
        self._namespace = node.get_namespace()
        self._logger = node.get_logger()
        self._clock = node.create_publisher(Clock, CLOCK_TOPIC, 1) if clock else None
        self._publishers: dict[str, Publisher] = {}
        self._renamed = ''
        for topic in bag.topics.values():
            if selection is not None and topic.name not in selection.topics:
                continue
            if topic.name == CLOCK_TOPIC and clock:
                self._logger.warning('the recorded /clock is left out')
                continue
            try:
                kind = message_class(topic.message_type)
            except LavaError as error:
                self._logger.warning(f'{topic.name} is left out: {error}')
                continue
            is_moved = self._namespace not in ('/', self._recorded)
            if is_moved and topic.name == DIAGNOSTICS and kind is DiagnosticArray:
                self._renamed = DIAGNOSTICS
            name = _name_from(topic.name, self._recorded, self._namespace)
            self._publishers[topic.name] = node.create_publisher(
                kind, name, ros_profile(topic.qos)
            )
        if not self._publishers:
            problem = f'No message type of the topics of {bag.path} is installed'
            raise RefusalError('bag', problem, 'Install their packages or source their workspace')

    def wait_for_subscribers(self, timeout: float, wait: Callable[[float], bool]) -> None:
        """Wait up to ``timeout`` [s] for a subscriber on every topic, as ``replay.pace`` does."""
        deadline = time.monotonic() + timeout
        while timeout > 0.0 and not wait(0.02):
            publishers = self._publishers.items()
            missing = [name for name, item in publishers if item.get_subscription_count() == 0]
            if not missing:
                return
            if time.monotonic() >= deadline:
                self._logger.warning(f'no subscriber on {", ".join(missing)}')
                return

    def publish(self, step: replay.Step) -> None:
        """Publish the clock and the message of a step."""
        if self._clock is not None:
            self._clock.publish(Clock(clock=time_message(step.clock_ns)))
        message = step.message
        if message is None or message.topic not in self._publishers:
            return
        if self._selection is None or self._selection.has(message):
            self._publishers[message.topic].publish(self._data(message))
            self.published += 1

    def _data(self, message: BagMessage) -> bytes:
        """Return the bytes of a message; diagnostics name the node in its new namespace."""
        if message.topic != self._renamed:
            return message.data
        array = deserialize_message(message.data, DiagnosticArray)
        for status in array.status:
            if node := node_of(status):
                moved = _name_from(node, self._recorded, self._namespace)
                full = moved if moved.startswith('/') else f'{self._namespace}/{moved}'
                task = status.name.partition(':')[2]
                status.name = f'{full.strip("/")}:{task}'
        return bytes(serialize_message(array))

    def wait_until_acknowledged(self) -> None:
        """Wait up to ``ACKNOWLEDGE_TIMEOUT`` until reliable subscribers have everything."""
        deadline = time.monotonic() + ACKNOWLEDGE_TIMEOUT
        for name, publisher in self._publishers.items():
            seconds = max(deadline - time.monotonic(), 0.0)
            if not publisher.wait_for_all_acked(Duration(nanoseconds=round(seconds * 1e9))):
                self._logger.warning(f'a subscriber of {name} has not received every message')


def _name_from(topic: str, recorded: str, namespace: str) -> str:
    """Return the name of a bag's topic in a namespace, relative if it is in the recorded one."""
    # topics outside of the namespace of the recorded node keep their names
    if namespace == '/' or topic in SHARED_TOPICS:
        return topic
    return topic.removeprefix(f'{recorded.rstrip("/")}/')


@contextmanager
def _stopped_by_signals() -> Iterator[Callable[[float], bool]]:
    """Yield a function that sleeps for a time [s], and returns True after SIGINT or SIGTERM.

    ``threading.Event`` would deadlock: a handler runs in the main thread, also during ``wait``,
    and ``set`` needs the lock that ``wait`` holds.
    """
    came: list[int] = []

    def wait(seconds: float) -> bool:
        if not came:
            time.sleep(seconds)
        return bool(came)

    previous = {
        number: signal.signal(number, lambda number, _: came.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield wait
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
