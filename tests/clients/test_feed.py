# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A node that feeds a node, and callbacks that fail or are interrupted."""

from collections.abc import Iterator
from dataclasses import replace
import signal
from unittest.mock import Mock

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions

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

#: Diagnostics of a simulation before and after a time of the series.
EARLY, LATE = (
    DiagnosticStatus(
        name='lava: simulation', values=[KeyValue(key='simulated_time_s', value=time)]
    )
    for time in ('5.0', '3700.0')
)


class Feed(SceneFeed):
    """A feed whose messages are kept."""

    def __init__(self, *events, has_vents=True):
        self.sent = {'terrain': [], 'terrain_info': [], 'vents': []}
        scene = Scene(TERRAIN, VENTS, lava=Lava.paper(), events=events)
        super().__init__(scene, has_vents=has_vents)

    def create_publisher(self, kind, topic, *arguments, **options):
        publisher = super().create_publisher(kind, topic, *arguments, **options)
        if topic in self.sent:
            publisher.publish = self.sent[topic].append
        return publisher

    def receive(self, *statuses):
        self._on_diagnostics(DiagnosticArray(status=statuses))

    def run(self):
        """Run the callbacks of all timers."""
        for timer in self.timers:
            timer.callback()

    def terrain(self, index):
        pair = self.sent['terrain'][index], self.sent['terrain_info'][index]
        return inputs.terrain_from_image(*pair, Settings())


@pytest.fixture
def make_feed():
    """Return a function that makes a feed."""
    rclpy.init(args=[], domain_id=own_domain(), signal_handler_options=SignalHandlerOptions.NO)
    made = []

    def make(*events, **options):
        made.append(Feed(*events, **options))
        return made[-1]

    yield make
    for feed in made:
        feed.destroy_node()
    rclpy.shutdown()


def test_vents_follow_simulated_time(make_feed):
    feed = make_feed()
    terrain = feed.terrain(0)
    np.testing.assert_array_equal(terrain.elevation, TERRAIN.elevation)
    assert (terrain.resolution, terrain.origin) == (2.5, (1.0, 2.0))
    feed.run()
    feed.run()
    (cloud,) = feed.sent['vents']
    vents = inputs.vents_from_cloud(cloud, Settings())
    assert [vent.position for vent in vents] == [(2.0, 3.0), (3.0, 4.0)]
    assert [vent.end for vent in vents] == [None, (8.0, 4.0)]
    assert [vent.discharge for vent in vents] == [10.0, 5.0]
    assert vents[0].temperature == pytest.approx(VENTS[0].temperature, abs=1e-3)
    feed.receive(LATE)
    feed.run()
    _, cloud = feed.sent['vents']
    assert inputs.vents_from_cloud(cloud, Settings())[0].discharge == 4.0


def test_terrain_events_follow_simulated_time(make_feed):
    new = replace(TERRAIN, elevation=TERRAIN.elevation + 3.0)
    feed = make_feed(
        TerrainEvent(3600.0, 'new ground', new), TerrainEvent(9000.0, 'old ground', TERRAIN),
        has_vents=False,
    )
    feed.run()
    assert len(feed.sent['terrain']) == 1
    feed.receive(LATE)
    feed.run()
    assert len(feed.sent['terrain']) == 2
    np.testing.assert_array_equal(feed.terrain(1).elevation, new.elevation)
    assert not feed.sent['vents']


@pytest.mark.parametrize(('shown', 'age', 'max_age', 'is_due'), [
    # a step that begins before the event and ends after it
    (3000.0, 590.0, 900.0, False), (3000.0, 610.0, 900.0, True),
    # a simulation that has fallen behind its clock
    (3000.0, 610.0, 30.0, False),
])
def test_changes_take_place_at_the_time_of_the_clock(make_feed, shown, age, max_age, is_due):
    feed = make_feed(TerrainEvent(3600.0, 'new ground', TERRAIN))
    feed.run()
    values = {'simulated_time_s': shown, 'age_s': age, 'max_age_s': max_age}
    status = DiagnosticStatus(
        name='lava: simulation',
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    feed.receive(status)
    feed.run()
    assert (len(feed.sent['terrain']), len(feed.sent['vents'])) == ((2, 2) if is_due else (1, 1))
    # the next step has begun, and its maps are not published yet
    status.values[1].value = '1.0'
    feed.receive(status)
    feed.run()
    assert (len(feed.sent['terrain']), len(feed.sent['vents'])) == ((2, 2) if is_due else (1, 1))


def test_terrain_events_follow_a_reset(make_feed):
    new = replace(TERRAIN, elevation=TERRAIN.elevation + 3.0)
    feed = make_feed(TerrainEvent(3600.0, 'new ground', new), has_vents=False)
    for status, ground in ((LATE, new), (EARLY, TERRAIN), (EARLY, TERRAIN), (LATE, new)):
        feed.receive(status)
        feed.run()
        np.testing.assert_array_equal(feed.terrain(-1).elevation, ground.elevation)
    assert len(feed.sent['terrain']) == 4


def test_feed_reports_each_rejection_of_the_node_once(make_feed, capfd):
    feed = make_feed()
    refusal = "refused terrain: terrain.data is '5 of 12 cells without data (NaN)'"
    good = DiagnosticStatus(name='lava: inputs', level=DiagnosticStatus.OK, message='all taken')
    bad = DiagnosticStatus(name='lava: inputs', level=DiagnosticStatus.ERROR, message=refusal)
    other = DiagnosticStatus(name='etna/lava: inputs', level=DiagnosticStatus.ERROR, message='no')
    for statuses in ([good], [bad], [bad, other], [good], [bad]):
        feed.receive(*statuses)
    errors = capfd.readouterr().err
    assert errors.count(f'lava: inputs: {refusal}') == 2
    assert '[ERROR]' in errors
    assert 'etna' not in errors
