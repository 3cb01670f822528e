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

"""Publishes a bag into the graph: the recorded bytes with the recorded QoS, and /clock."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
import signal
import threading
import time
from types import FrameType
from typing import Any

from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from lava_ros import validation
from lava_ros.bag import replay
from lava_ros.bag.reader import BagReader
from lava_ros.bag.replay import Transport
from lava_ros.errors import LavaError
from lava_ros.ros.codec import message_class, time_message
from lava_ros.ros.qos import ros_profile

CLOCK_TOPIC = '/clock'

#: Time between steps when no clock is published [s]: often enough for a progress bar.
QUIET_TICK = 0.1

#: Longest time to wait at the end until reliable subscribers have everything [s].
ACKNOWLEDGE_TIMEOUT = 2.0

OnStep = Callable[[replay.Step], None]


class Player:
    """Publishers for the topics of a bag.

    Attributes:
        published: Messages published so far.
    """

    def __init__(self, node: Node, bag: BagReader, *, clock: bool = True) -> None:
        """Create a publisher for every topic whose message type is installed.

        Other topics are left out with a warning. So is a recorded /clock if ``clock`` is set, for
        the player then publishes its own.

        Raises:
            LavaError: No topic is left.
        """
        self._node = node
        self._bag = bag
        self._clock = node.create_publisher(Clock, CLOCK_TOPIC, 1) if clock else None
        self._publishers: dict[str, Publisher] = {}
        for topic in bag.topics.values():
            if topic.name == CLOCK_TOPIC and clock:
                node.get_logger().warning('the recorded /clock is left out')
                continue
            try:
                kind = message_class(topic.message_type)
            except LavaError as error:
                node.get_logger().warning(f'{topic.name} is left out: {error}')
                continue
            self._publishers[topic.name] = node.create_publisher(
                kind, topic.name, ros_profile(topic.qos)
            )
        if not self._publishers:
            raise LavaError('bag', str(bag.path), 'a topic whose message type is installed')
        self.published = 0

    def wait_for_subscribers(self, timeout: float, stop: threading.Event) -> bool:
        """Wait up to ``timeout`` [s] for a subscriber on every topic; return whether all came."""
        deadline = time.monotonic() + timeout
        while not stop.is_set():
            missing = [
                name
                for name, publisher in self._publishers.items()
                if publisher.get_subscription_count() == 0
            ]
            if not missing:
                return True
            if time.monotonic() >= deadline:
                self._node.get_logger().warning(f'no subscriber on {", ".join(missing)}')
                return False
            stop.wait(0.02)
        return False

    def run(
        self,
        stop: threading.Event,
        *,
        rate: float = 1.0,
        loop: bool = False,
        start_offset: float = 0.0,
        on_step: OnStep | None = None,
        transport: Transport | None = None,
    ) -> None:
        """Publish the bag from start to end, or until stopped.

        Args:
            stop: Ends the replay when set.
            rate: Bag time that passes in a second of wall time [s/s].
            loop: Whether to start over at the end, for ever.
            start_offset: Where to start, from the bag's first message [s of bag time].
            on_step: Called after every message and clock tick.
            transport: Holds, quickens and moves the replay; None lets it run.

        Raises:
            LavaError: An argument is out of range, or the bag is empty or damaged.
        """
        tick = QUIET_TICK if self._clock is None else replay.TICK
        now, wait = time.monotonic, stop.wait
        if transport is not None:
            now, wait = transport.now, partial(transport.wait, stop=stop)
        first_ns: int | None = None
        while True:
            dues = replay.schedule(
                self._bag, rate=rate, loop=loop, start_offset=start_offset, first_ns=first_ns
            )
            for step in replay.pace(dues, rate=rate, now=now, wait=wait, tick=tick):
                self._publish(step)
                first_ns = step.clock_ns
                if on_step is not None:
                    on_step(step)
            jump = 0.0 if transport is None else transport.take_jump()
            if jump == 0.0:
                break
            first_ns = self._place(first_ns, jump * rate)
        if not stop.is_set():
            self._wait_until_acknowledged()

    def _publish(self, step: replay.Step) -> None:
        if self._clock is not None:
            self._clock.publish(Clock(clock=time_message(step.clock_ns)))
        if step.message is not None and step.message.topic in self._publishers:
            self._publishers[step.message.topic].publish(step.message.data)
            self.published += 1

    def _place(self, from_ns: int | None, jump: float) -> int:
        """Bag time at a distance [s] from a bag time, inside the bag [ns]."""
        start, end = self._bag.start_ns or 0, self._bag.end_ns or 0
        here = start if from_ns is None else from_ns
        return min(max(here + round(jump * 1e9), start), end)

    def _wait_until_acknowledged(self) -> None:
        deadline = time.monotonic() + ACKNOWLEDGE_TIMEOUT
        for name, publisher in self._publishers.items():
            seconds = max(deadline - time.monotonic(), 0.0)
            if not publisher.wait_for_all_acked(Duration(nanoseconds=round(seconds * 1e9))):
                self._node.get_logger().warning(f'a subscriber of {name} has not got everything')


def play(
    bag: BagReader, *, clock: bool = True, wait_for_subscribers: float = 0.0, **how: Any
) -> int:
    """Replay a bag in this process until it ends or SIGINT or SIGTERM arrives.

    For the main thread, in a ROS context of its own. ``clock`` publishes /clock; ``how`` are
    further arguments of ``Player.run``.

    Returns:
        The number of messages published.

    Raises:
        LavaError: An argument is out of range, or the bag is empty or damaged.
    """
    wait = validation.number('wait_for_subscribers', wait_for_subscribers, at_least=0.0, unit='s')
    stop = threading.Event()
    with _set_on_signals(stop), Context() as context:
        node = Node('lava_player', context=context, start_parameter_services=False)
        try:
            player = Player(node, bag, clock=clock)
            if wait > 0.0:
                player.wait_for_subscribers(wait, stop)
            player.run(stop, **how)
        finally:
            node.destroy_node()
        return player.published


@contextmanager
def _set_on_signals(stop: threading.Event) -> Iterator[None]:
    """Set an event on SIGINT and SIGTERM, and put back the handlers afterwards."""

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()

    previous = {item: signal.signal(item, handle) for item in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for item, handler in previous.items():
            signal.signal(item, handler)
