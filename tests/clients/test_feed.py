# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A node that feeds a node, and callbacks that fail or are interrupted."""

from collections.abc import Callable, Iterator
from dataclasses import replace
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
from lava_ros.clients.feed import SceneFeed
from lava_ros.clients.watcher import Watcher
from lava_ros.ros import inputs, qos
from lava_ros.ros.executor import spin
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from ros_domain import own_domain
from waiting import wait_until


def test_spin_reports_errors_and_continues():
    first, second, errors = ValueError('clock'), RuntimeError('message'), []
    turn = Mock(side_effect=[None, first, None, second, None])
    executor = Mock(spin_once=turn)
    spin(executor, until=lambda: turn.call_count == 5, on_error=errors.append)
    assert errors == [first, second]
    assert turn.call_args.kwargs['timeout_sec'] > 0.0


class Echo(Watcher):
    """Receives its own messages."""

    def __init__(self) -> None:
        super().__init__('lava_echo', own_domain())
        profile = qos.ros_profile(qos.LATCHED)
        self.received: list[DiagnosticArray] = []
        self._node.create_subscription(DiagnosticArray, 'echo', self.received.append, profile)
        self._publisher = self._node.create_publisher(DiagnosticArray, 'echo', profile)

    def send(self) -> None:
        """Send a message with something in it."""
        self._publisher.publish(DiagnosticArray(status=[DiagnosticStatus(message='here')]))

    def wait(self) -> None:
        wait_until(lambda: self.listen(0.1) or self.received)


@pytest.fixture
def echo() -> Iterator[Echo]:
    echo = Echo()
    yield echo
    echo.close()


def test_ctrl_c_during_a_message_raises_keyboard_interrupt(
    echo: Echo, monkeypatch: pytest.MonkeyPatch
) -> None:
    make, interrupted = DiagnosticStatus.__init__, []

    def make_interrupted(self: DiagnosticStatus, **fields: object) -> None:
        make(self, **fields)
        if not interrupted:
            interrupted.append(True)
            signal.raise_signal(signal.SIGINT)

    echo.send()
    monkeypatch.setattr(DiagnosticStatus, '__init__', make_interrupted)
    with pytest.raises(KeyboardInterrupt):
        echo.wait()
    assert interrupted
    echo.wait()
    assert [item.status[0].message for item in echo.received] == ['here']
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


TERRAIN = Terrain(np.arange(12.0).reshape(3, 4), resolution=2.5, origin=(1.0, 2.0))
VENTS = (
    Vent((2.0, 3.0), [(0.0, 10.0), (3600.0, 4.0)], 1423.0, name='falling'),
    Vent((3.0, 4.0), 5.0, 1423.0, end=(8.0, 4.0), name='fissure'),
)

#: Diagnostics of a simulation that has passed a time of the series.
LATE = DiagnosticStatus(
    name='lava: simulation', values=[KeyValue(key='simulated_time_s', value='3700.0')]
)


class Graph:
    """A feed, and a listener that joined before or after it."""

    def __init__(self) -> None:
        self._executor = SingleThreadedExecutor()
        self.received: dict[str, list[Any]] = {'terrain': [], 'terrain_info': [], 'vents': []}

    def add_feed(self, *events: TerrainEvent, has_vents: bool = True) -> None:
        scene = Scene(TERRAIN, VENTS, lava=Lava(), events=events)
        self._executor.add_node(SceneFeed(scene, has_vents=has_vents))

    def add_listener(self) -> Any:
        """Start a node that listens with the QoS of the lava node; return its diagnostics."""
        node = rclpy.create_node('listener')
        for name, kind, profile in (
            ('terrain', Image, qos.LATCHED),
            ('terrain_info', MapMetaData, qos.LATCHED),
            ('vents', PointCloud2, qos.COMMANDS),
        ):
            node.create_subscription(
                kind, name, self.received[name].append, qos.ros_profile(profile)
            )
        self._executor.add_node(node)
        return node.create_publisher(
            DiagnosticArray, '/diagnostics', qos.ros_profile(qos.DIAGNOSTICS)
        )

    def close(self) -> None:
        nodes = self._executor.get_nodes()
        self._executor.shutdown()
        for node in nodes:
            node.destroy_node()

    def discharge(self) -> float:
        """Return the last received discharge of the first vent, NaN if there is none."""
        if not self.received['vents']:
            return np.nan
        columns = cloud_columns(self.received['vents'][-1], 'vents', ('discharge',))
        return float(columns['discharge'][0])

    def spin_until(self, condition: Callable[[], bool]) -> None:
        wait_until(lambda: self._executor.spin_once(timeout_sec=0.1) or condition())


@pytest.fixture
def graph() -> Iterator[Graph]:
    rclpy.init(args=[], domain_id=own_domain(), signal_handler_options=SignalHandlerOptions.NO)
    graph = Graph()
    yield graph
    graph.close()
    rclpy.shutdown()


def test_late_subscriber_gets_terrain_and_vents(graph: Graph) -> None:
    graph.add_feed()
    graph.add_listener()
    graph.spin_until(lambda: all(graph.received.values()))
    rules = Settings()
    terrain = inputs.terrain_from_image(
        graph.received['terrain'][0], graph.received['terrain_info'][0], rules
    )
    np.testing.assert_array_equal(terrain.elevation, TERRAIN.elevation)
    assert (terrain.resolution, terrain.origin) == (2.5, (1.0, 2.0))
    vents = inputs.vents_from_cloud(graph.received['vents'][0], rules)
    # a fissure is its two ends, with half the discharge each
    assert [vent.position for vent in vents] == [(2.0, 3.0), (3.0, 4.0), (8.0, 4.0)]
    assert [vent.discharge for vent in vents] == [10.0, 2.5, 2.5]
    assert vents[0].temperature == pytest.approx(VENTS[0].temperature, abs=1e-3)


def test_discharge_follows_simulated_time(graph: Graph) -> None:
    publisher = graph.add_listener()
    graph.add_feed()
    graph.spin_until(lambda: graph.discharge() == 10.0)
    graph.spin_until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(DiagnosticArray(status=[LATE]))
    graph.spin_until(lambda: graph.discharge() == 4.0)
    assert len(graph.received['vents']) == 2


def test_terrain_event_follows_simulated_time(graph: Graph) -> None:
    new = replace(TERRAIN, elevation=TERRAIN.elevation + 3.0)
    publisher = graph.add_listener()
    graph.add_feed(
        TerrainEvent(3600.0, 'new ground', new), TerrainEvent(9000.0, 'old ground', TERRAIN),
        has_vents=False,
    )
    graph.spin_until(lambda: len(graph.received['terrain']) == 1)
    graph.spin_until(lambda: publisher.get_subscription_count() > 0)
    publisher.publish(DiagnosticArray(status=[LATE]))
    graph.spin_until(
        lambda: len(graph.received['terrain']) == 2 and len(graph.received['terrain_info']) == 2
    )
    terrain = inputs.terrain_from_image(
        graph.received['terrain'][1], graph.received['terrain_info'][1], Settings()
    )
    np.testing.assert_array_equal(terrain.elevation, new.elevation)
    assert not graph.received['vents']


def test_feed_reports_each_rejection_of_the_node_once(
    graph: Graph, capfd: pytest.CaptureFixture[str]
) -> None:
    publisher = graph.add_listener()
    graph.add_feed()
    graph.spin_until(lambda: publisher.get_subscription_count() > 0)
    refusal = "refused terrain: terrain.data is '5 of 12 cells without data (NaN)'"
    good = DiagnosticStatus(name='lava: inputs', level=DiagnosticStatus.OK, message='all taken')
    bad = DiagnosticStatus(name='lava: inputs', level=DiagnosticStatus.ERROR, message=refusal)
    other = DiagnosticStatus(name='etna/lava: inputs', level=DiagnosticStatus.ERROR, message='no')
    for statuses in ([good], [bad], [bad, other], [good], [bad], [LATE]):
        publisher.publish(DiagnosticArray(status=statuses))
    # by the vents of the new time, all earlier messages have been received
    graph.spin_until(lambda: graph.discharge() == 4.0)
    errors = capfd.readouterr().err
    assert errors.count(f'lava: inputs: {refusal}') == 2
    assert '[ERROR]' in errors
    assert 'etna' not in errors
