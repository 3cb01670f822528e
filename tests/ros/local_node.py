# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A node in the process of a test, which calls its callbacks and sets its clock.

Messages bypass the middleware, so there is no discovery and no loss.
"""

from collections import deque
import gc
import inspect
from pathlib import Path
import time

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock

from lava_ros.effects import EFFECTS
from lava_ros.live import clock
from lava_ros.live.worker_status import WorkerState
from lava_ros.ros import codec, runtime
from lava_ros.ros.node import LavaNode
from ros.graph_listener import line_of
from ros.graph_publisher import Asking, CASES, publication
from ros.hearing import Hearing
from ros_domain import own_domain
from waiting import PATIENCE

# modules live on; without them a collection, of which each node has three, takes no time
gc.collect()
gc.freeze()

#: Period of diagnostics [s].
HEARTBEAT = 0.02

#: Maximum step of the clock [s], which a simulation can follow.
STEP = 0.5

#: Parameters with lava after 2 s of the clock and steps of a few milliseconds.
COARSE = {'device': 'cpu', 'preset': 'draft', 'spacing': 4.0, 'time_scale': 20.0}


#: Effects to switch off for lava of one temperature, for which cells need few kernels.
PLAIN = [name for name, item in EFFECTS.items() if name != 'steep' and not item.needs_particles]


class _Log:
    """Stores log lines of a node in the format of stderr, and forwards them."""

    def __init__(self):
        self.lines = []
        self._passed_on = get_logger('lava')

    def __getattr__(self, name):
        log = getattr(self._passed_on, name)
        if name not in ('debug', 'info', 'warning', 'warn', 'error', 'fatal'):
            return log

        def keep(text, **options):
            level = {'warning': 'WARN'}.get(name, name.upper())
            self.lines.append(f'[{level}] [0.0] [lava]: {text}')

        return keep


class _Node(LavaNode):
    """A node whose log and messages are stored."""

    def __init__(self, log, sent, **options):
        self._kept_log, self._sent = log, sent
        super().__init__(**options)

    def get_logger(self):
        return self._kept_log

    def create_publisher(self, kind, topic, *arguments, **options):
        publisher = super().create_publisher(kind, topic, *arguments, **options)
        name, publish = publisher.topic_name.removeprefix('/'), publisher.publish

        def keep(message):
            data = message if isinstance(message, bytes) else serialize_message(message)
            if hasattr(kind, 'header') or hasattr(kind, 'markers'):
                self._sent.append((name, kind, data))
            publish(message)

        publisher.publish = keep
        return publisher


class LocalNode(Asking, Hearing):
    """A node with the interfaces of ``Publisher`` and ``Listener``; ``change`` starts it.

    Attributes:
        directory: Folder for files of the node.
        now: The time of its clock [s].
    """

    def __init__(self, directory, patch, *, domain='local', remap=(), **parameters):
        patch.setattr(runtime, 'HEARTBEAT', HEARTBEAT)
        # An earlier node stays in the graph, under the same name, as long as a logged traceback of
        # its thread refers to it: pytest keeps log records until the end of a test.
        gc.collect()
        # a busy machine may take long to end the simulation
        patch.setattr(runtime, 'STOP_TIMEOUT', PATIENCE)
        # no warning about a clock that stands still
        patch.setattr(clock, 'PATIENCE', float('inf'))
        patch.chdir(directory)
        self.directory, self.seen, self.now = Path(directory), [], 0.0
        self._log, self._sent, self._sequence = _Log(), deque(), 0
        values = {**COARSE, 'use_sim_time': True, 'autostart': False, **parameters}
        context = Context()
        context.init(args=[], domain_id=own_domain(domain))
        self.node = _Node(
            self._log,
            self._sent,
            context=context,
            use_global_arguments=False,
            cli_args=['--ros-args', *(word for rule in remap for word in ('-r', rule))],
            parameter_overrides=[
                Parameter(name.replace('__', '.'), value=value) for name, value in values.items()
            ],
        )
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._context = context
        self.jump(10_000.0)

    @property
    def log(self):
        return '\n'.join(self._log.lines)

    @property
    def worker(self):
        return self.node.runtime.worker

    @property
    def simulated(self):
        """Simulated time up to which the simulation follows the clock [s]."""
        return self.worker.pace.followed

    def close(self):
        self.node.close()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.shutdown()
        # the node's state machine keeps the participant in the graph, and is in cycles
        del self.node, self._executor, self._context
        gc.collect()

    def jump(self, to):
        self.now = to
        self.deliver('/clock', Clock(clock=codec.time_message(round(to * 1e9))))

    def run(self, seconds):
        """Advance the clock [s], and wait until the simulation has followed and published it."""
        end, worker = self.now + seconds, self.worker
        # a scene is visible before its simulation follows the clock
        self.wait_until(lambda: worker.status.state is not WorkerState.STARTING)
        reached = self.simulated
        while self.now < end:
            step = min(STEP, end - self.now)
            reached += step * worker.pace.time_scale
            self.jump(self.now + step)
            self.wait_until(
                lambda: (
                    self.simulated > reached - 1e-6  # noqa: B023
                    or worker.status.state is WorkerState.FINISHED
                )
            )
        self.wait_until(self._has_shown_now)

    def _has_shown_now(self):
        """Return True if the newest snapshot is of the current time; otherwise request one."""
        worker = self.worker
        if worker.latest.time < worker.session.time:
            worker.request_snapshot()
        return worker.latest.time >= worker.session.time

    def run_commands(self):
        """Wait until the simulation's thread has run all commands so far."""
        self.worker.checkpoint().result(PATIENCE)

    def spin(self):
        """Run one callback that is due, or briefly wait for one."""
        self._executor.spin_once(timeout_sec=0.01)

    def wait_until(self, condition, timeout=PATIENCE):
        """Run callbacks until a condition holds, and return its value."""
        end = time.monotonic() + timeout
        while not (value := condition()):
            assert time.monotonic() < end, self.log
            self.spin()
        return value

    def wait_for_log(self, text, timeout=PATIENCE, *, after=0):
        """Run callbacks until a text is in the log after position ``after``."""
        self.wait_until(lambda: text in self.log[after:], timeout)

    def deliver(self, topic, message):
        """Pass a message to each subscription of the node to a topic (full name), as ROS does."""
        self._sequence += 1
        info = publication(self._sequence)
        for taker in [item for item in self.node.subscriptions if item.topic_name == topic]:
            if taker.raw:
                data = message if isinstance(message, bytes) else serialize_message(message)
                taker.callback(data, info)
            else:
                taker.callback(message)

    def publish(self, *cases):
        """Pass messages to the node by their names in ``CASES``, stamped with its clock."""
        for case in cases:
            topic, make = CASES[case]
            message, since_ns = make(), round(self.now * 1e9) - time.time_ns()
            stamp_ns = codec.nanoseconds(message.header.stamp) if hasattr(message, 'header') else 0
            if stamp_ns:
                message.header.stamp = codec.time_message(max(0, stamp_ns + since_ns))
            self.deliver(self.node.resolve_topic_name(topic), message)

    def request(self, kind, name, timeout, **fields):
        (service,) = [item for item in self.node.services if item.service_name == name]
        answer = service.callback(kind.Request(**fields), kind.Response())
        if not inspect.iscoroutine(answer):
            return answer
        task = self._executor.create_task(answer)
        self.wait_until(task.done)
        return task.result()

    def names(self):
        """Return its topics and services in the graph, once the graph is up to date."""
        made = {item.topic_name for item in (*self.node.publishers, *self.node.subscriptions)}
        made |= {item.service_name for item in self.node.services}
        name, space = self.node.get_name(), self.node.get_namespace()
        ways = (
            self.node.get_publisher_names_and_types_by_node,
            self.node.get_subscriber_names_and_types_by_node,
            self.node.get_service_names_and_types_by_node,
        )

        def found():
            names = {item for way in ways for item, _ in way(name, space)}
            # except internal topics of rclpy
            return names - {'/rosout', f'{space.rstrip("/")}/{name}/transition_event'}

        # the middleware updates the graph asynchronously
        self.wait_until(lambda: found() == made)
        return made

    def next(self, timeout):
        end = time.monotonic() + timeout
        while not self._sent:
            assert time.monotonic() < end, f'nothing in {timeout} s; log:\n{self.log}'
            self.spin()
        return line_of(*self._sent.popleft())

    def hear(self):
        while self._sent:
            self.seen.append(self.next(0.0))
        return len(self.seen)

    def status_now(self, task, condition=lambda _: True, node='lava'):
        """Return the next diagnostic status of a task that fulfils a condition."""
        self.hear()
        return self.wait_for_status(task, condition, node=node)
