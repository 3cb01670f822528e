# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The entities of the node in the ROS graph; the recorder gets the same bytes as a topic."""

from collections import Counter
from concurrent.futures import Future
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
import rclpy.task
from rclpy.timer import Timer
from std_msgs.msg import Header

from lava_ros.bag import QosProfile
from lava_ros.errors import LavaError
from lava_ros.live.recorder import Recorder
from lava_ros.ros import codec
from lava_ros.ros.georeference import TF_STATIC

#: Time for which a service remains after an answer, which a thread of the middleware sends [s].
ANSWER_TIME = 0.5

_STEADY = Clock(clock_type=ClockType.STEADY_TIME)


class NodeGraph:
    """The entities of a configured node in the ROS graph, and the recorder of its messages.

    ``frame_id`` is the frame of the messages. Cleanup destroys the entities.
    """

    def __init__(self, node: Node, frame_id: str) -> None:
        """Initialize without entities."""
        self.node = node
        self.frame_id = frame_id
        self.recorder = Recorder()
        self._made: dict[Any, str] = {}
        # services of the calls whose answers may not have been sent
        self._calls: dict[rclpy.task.Future, Any] = {}
        self._is_destroyed = False
        self._topics: dict[str, str] = {}
        # source of the name of each topic that only one entity may use, by the full name of the
        # topic
        self._fields: dict[str, str] = {}

    def header(self, stamp_ns: int) -> Header:
        """Make the header of a message."""
        return codec.header(self.frame_id, stamp_ns)

    @property
    def published(self) -> Counter[str]:
        """Number of publishers of this node by topic, without those that nodes share."""
        made = (item.topic_name for item, kind in self._made.items() if kind == 'publisher')
        shared = [self.node.resolve_topic_name(name) for name in ('/diagnostics', TF_STATIC)]
        return Counter(topic for topic in made if topic not in shared)

    @property
    def topics(self) -> dict[str, str]:
        """Full names of the topics that were published or subscribed to, by the given names."""
        return dict(self._topics)

    def other_publishers(self, topic: str) -> list[str]:
        """Return the full name of the node of each publisher of a topic that is not made here.

        A killed node remains visible for about 20 s, the lease duration of Fast DDS. A publisher
        whose node is not known yet is left out.
        """
        name = self.node.resolve_topic_name(topic)
        ends = self.node.get_publishers_info_by_topic(name)
        names = (f'{end.node_namespace.rstrip("/")}/{end.node_name}' for end in ends)
        found = Counter(name for name in names if name.startswith('/'))
        found.subtract({self.node.get_fully_qualified_name(): self.published[name]})
        return list(found.elements())

    def create(self, kind: str, *args: Any, field: str = '', **options: Any) -> Any:
        """Call ``Node.create_<kind>``, for example for a publisher, subscription or timer.

        ``field`` is the field of the user's input that determines the topic of a publisher. No
        other publisher or subscription may have this topic.

        Raises:
            LavaError: If the topic belongs to a ``field``, or to another name after remapping.
        """
        if kind not in ('publisher', 'subscription'):
            made = getattr(self.node, f'create_{kind}')(*args, **options)
        else:
            name, topic = args[1].lstrip('/'), self.node.resolve_topic_name(args[1])
            self._check_topic(name, topic, field)
            try:
                made = getattr(self.node, f'create_{kind}')(*args, **options)
            except RuntimeError as error:
                # of Fast DDS, for example on /rosout
                if 'incompatible type' not in str(error):
                    raise
                expected = 'a topic that this process does not use for messages of another type'
                raise LavaError(field or name, topic, expected) from error
            self._topics[name] = topic
            if field:
                self._fields[topic] = field
        self._made[made] = kind
        return made

    def _check_topic(self, name: str, topic: str, field: str) -> None:
        users = {full: given for given, full in self._topics.items()}
        # rclpy's own entities, for parameters and the clock
        users |= {
            item.topic_name: item.topic_name
            for item in (*self.node.publishers, *self.node.subscriptions)
            if item not in self._made
        }
        user, owner = users.get(topic), self._fields.get(topic)
        if user is not None and (field or owner or user != name):
            other = user if field or not owner else name
            expected = f'a different topic; {other} has the same one after remapping'
            raise LavaError(field or owner or name, topic, expected)

    def drop(self, made: Any) -> None:
        """Destroy one entity."""
        getattr(self.node, f'destroy_{self._made.pop(made)}')(made)

    @property
    def is_answering(self) -> bool:
        """True if the answer to a call may not have been sent."""
        return bool(self._calls)

    async def wait(self, service: Any, future: 'Future[Any]') -> None:
        """Wait in a call of a service until a future is done, or the graph is destroyed."""
        done = rclpy.task.Future()
        self._calls[done] = service
        future.add_done_callback(done.set_result)
        await done
        timer: Timer = self.node.create_timer(
            ANSWER_TIME, lambda: self._end_call(done, timer), clock=_STEADY
        )

    def _end_call(self, done: rclpy.task.Future, timer: Timer) -> None:
        self.node.destroy_timer(timer)
        service = self._calls.pop(done)
        if self._is_destroyed and service in self._made and service not in self._calls.values():
            self.drop(service)

    def destroy(self, *, is_answered: bool = False) -> None:
        """Destroy all entities, newest first.

        Calls of services no longer wait. Their services remain for ``ANSWER_TIME`` unless
        ``is_answered``: their answers have been received.
        """
        self._is_destroyed = True
        for made in reversed(list(self._made)):
            if is_answered or made not in self._calls.values():
                self.drop(made)
        self._topics.clear()
        self._fields.clear()
        for done in self._calls:
            if not done.done():
                done.set_result(None)

    def send(
        self, publisher: Publisher, message: Any, recorded_ns: int | None, profile: QosProfile
    ) -> None:
        """Publish a message, and record the same bytes at a ROS time [ns] unless that is None."""
        data = codec.serialise(message)
        publisher.publish(data)
        if recorded_ns is not None:
            kind = codec.type_name(type(message))
            self.recorder.write(publisher.topic_name, kind, data, recorded_ns, qos=profile)
