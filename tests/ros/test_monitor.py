# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes around a node: one that feeds it, and callbacks that fail or are interrupted."""

from collections.abc import Callable, Iterator
import signal
from typing import Any
from unittest.mock import Mock

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from nav_msgs.msg import MapMetaData
import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.bag.decoding import cloud_columns
from lava_ros.ros import inputs, qos, spinning
from lava_ros.ros.monitor import SceneFeed
from lava_ros.ros.parameters import Settings
from lava_ros.ros.spinning import Watcher
from lava_ros.scene import Lava, Scene, Terrain, Vent
from ros.graph_publisher import wait_until
from ros_domain import own_domain


def test_errors_are_told_and_the_rest_goes_on():
    """Each error is told once, and the callbacks after it run."""
    first, second, told = ValueError('clock'), RuntimeError('message'), []
    turn = Mock(side_effect=[None, first, None, second, None])
    executor = Mock(spin_once=turn)
    spinning.spin(executor, until=lambda: turn.call_count == 5, on_error=told.append)
    assert told == [first, second]
    assert turn.call_args.kwargs['timeout_sec'] > 0.0


class Echo(Watcher):
    """Hears what it says."""

    def __init__(self) -> None:
        super().__init__('lava_echo', own_domain())
        profile = qos.ros_profile(qos.LATCHED)
        self.heard: list[DiagnosticArray] = []
        self._node.create_subscription(DiagnosticArray, 'echo', self.heard.append, profile)
        self._publisher = self._node.create_publisher(DiagnosticArray, 'echo', profile)

    def say(self) -> None:
        """Send a message with something in it."""
        self._publisher.publish(DiagnosticArray(status=[DiagnosticStatus(message='here')]))

    def wait(self) -> None:
        """Listen until a message was heard."""
        wait_until(lambda: self.listen(0.1) or self.heard)


@pytest.fixture
def echo() -> Iterator[Echo]:
    """A watcher that hears what it says, in a domain of this test run."""
    echo = Echo()
    yield echo
    echo.close()


def test_ctrl_c_in_the_middle_of_a_message_is_still_ctrl_c(
    echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It comes out as KeyboardInterrupt once the message is whole, and not as rclpy's error."""
    make, interrupted = DiagnosticStatus.__init__, []

    def make_interrupted(self: DiagnosticStatus, **fields: object) -> None:
        make(self, **fields)
        if not interrupted:
            interrupted.append(True)
            signal.raise_signal(signal.SIGINT)

    echo.say()
    monkeypatch.setattr(DiagnosticStatus, '__init__', make_interrupted)
    with pytest.raises(KeyboardInterrupt):
        echo.wait()
    assert interrupted
    echo.wait()
    assert [item.status[0].message for item in echo.heard] == ['here']
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


TERRAIN = Terrain(np.arange(12.0).reshape(3, 4), resolution=2.5, origin=(1.0, 2.0))
VENTS = (
    Vent((2.0, 3.0), [(0.0, 10.0), (3600.0, 4.0)], 1423.0, name='falling'),
    Vent((3.0, 4.0), 5.0, 1423.0, end=(8.0, 4.0), name='fissure'),
)

#: The simulation has passed a time of the series.
LATE = DiagnosticStatus(
    name='lava: simulation', values=[KeyValue(key='simulated_time_s', value='3700.0')]
)


class Graph:
    """A feed and a listener that joined before or after it."""

    def __init__(self) -> None:
        """Make an empty graph."""
        self._executor = SingleThreadedExecutor()
        self.heard: dict[str, list[Any]] = {'terrain': [], 'terrain_info': [], 'vents': []}

    def add_feed(self) -> None:
        """Start the feed."""
        self._executor.add_node(SceneFeed(Scene(TERRAIN, VENTS, lava=Lava())))

    def add_listener(self) -> Any:
        """Start a node that listens with the QoS the lava node has, and may tell diagnostics."""
        node = rclpy.create_node('listener')
        for name, kind, profile in (
            ('terrain', Image, qos.LATCHED),
            ('terrain_info', MapMetaData, qos.LATCHED),
            ('vents', PointCloud2, qos.COMMANDS),
        ):
            node.create_subscription(
                kind, name, self.heard[name].append, qos.ros_profile(profile)
            )
        self._executor.add_node(node)
        return node.create_publisher(
            DiagnosticArray, '/diagnostics', qos.ros_profile(qos.DIAGNOSTICS)
        )

    def close(self) -> None:
        """Take every node out of the graph."""
        nodes = self._executor.get_nodes()
        self._executor.shutdown()
        for node in nodes:
            node.destroy_node()

    def discharge(self) -> float:
        """Discharge of the first vent as it was heard last, NaN before that."""
        if not self.heard['vents']:
            return np.nan
        columns = cloud_columns(self.heard['vents'][-1], 'vents', ('discharge',))
        return float(columns['discharge'][0])

    def spin_until(self, condition: Callable[[], bool]) -> None:
        """Run the graph until something holds, for at most a minute."""
        wait_until(lambda: self._executor.spin_once(timeout_sec=0.1) or condition())


@pytest.fixture
def graph() -> Iterator[Graph]:
    """A graph in a domain of this test run."""
    rclpy.init(
        args=[], domain_id=own_domain(), signal_handler_options=SignalHandlerOptions.NO
    )
    graph = Graph()
    yield graph
    graph.close()
    rclpy.shutdown()


def test_a_latecomer_gets_terrain_and_vents(graph: Graph) -> None:
    """Who joins after the feed has published still hears all of it, as the node reads it."""
    graph.add_feed()
    graph.add_listener()
    graph.spin_until(lambda: all(graph.heard.values()))
    rules = Settings()
    terrain = inputs.terrain_from_image(
        graph.heard['terrain'][0], graph.heard['terrain_info'][0], rules
    )
    np.testing.assert_array_equal(terrain.elevation, TERRAIN.elevation)
    assert (terrain.resolution, terrain.origin) == (2.5, (1.0, 2.0))
    vents = inputs.vents_from_cloud(graph.heard['vents'][0], rules)
    # A fissure is its two ends, with half the discharge each.
    assert [vent.position for vent in vents] == [(2.0, 3.0), (3.0, 4.0), (8.0, 4.0)]
    assert [vent.discharge for vent in vents] == [10.0, 2.5, 2.5]
    assert vents[0].temperature == pytest.approx(VENTS[0].temperature, abs=1e-3)


def test_discharge_follows_simulated_time(graph: Graph) -> None:
    """When the simulation passes a time of the series the vents are published again, once."""
    publisher = graph.add_listener()
    graph.add_feed()
    graph.spin_until(lambda: graph.discharge() == 10.0)
    graph.spin_until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(DiagnosticArray(status=[LATE]))
    graph.spin_until(lambda: graph.discharge() == 4.0)
    assert len(graph.heard['vents']) == 2


def test_what_the_node_refuses_is_told(
    graph: Graph, capfd: pytest.CaptureFixture[str]
) -> None:
    """Whoever runs the feed does not see the node's log: once for each refusal."""
    publisher = graph.add_listener()
    graph.add_feed()
    graph.spin_until(lambda: publisher.get_subscription_count() > 0)
    said = "refused terrain: terrain.data is '5 of 12 cells without data (NaN)'"
    good = DiagnosticStatus(name='lava: inputs', level=DiagnosticStatus.OK, message='all taken')
    bad = DiagnosticStatus(name='lava: inputs', level=DiagnosticStatus.ERROR, message=said)
    other = DiagnosticStatus(name='etna/lava: inputs', level=DiagnosticStatus.ERROR, message='no')
    for statuses in ([good], [bad], [bad, other], [good], [bad], [LATE]):
        publisher.publish(DiagnosticArray(status=statuses))
    # all that came before the vents of a new time has been heard by then
    graph.spin_until(lambda: graph.discharge() == 4.0)
    errors = capfd.readouterr().err
    assert errors.count(f'lava: inputs: {said}') == 2
    assert '[ERROR]' in errors
    assert 'etna' not in errors
