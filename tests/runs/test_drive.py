# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The loop of runs, and its observers."""

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.runs.drive import drive, driving, Sink
from lava_ros.runs.sinks import PeakSink, ProgressSink, SnapshotSink
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy

SLOPE = Terrain(np.tile(np.linspace(40.0, 0.0, 30), (20, 1)), 10.0)
SCENE = Scene(SLOPE, (Vent((50.0, 100.0), 5.0),), Lava.paper())
END = 300.0


def started(**options):
    return Simulation(SCENE, accuracy=Accuracy(spacing=8.0), device='cpu', **options)


@pytest.fixture(scope='module')
def undisturbed():
    simulation = started()
    drive(simulation, END)
    return simulation.snapshot()


class Impatient(Sink):
    """Observes as often as possible."""

    wall_due = 0.0

    def __init__(self):
        self.times = []

    def observe(self, simulation, time):
        self.times.append(time)
        simulation.checkpoint()
        return ()


@pytest.mark.parametrize('kind', ['snapshots', 'peaks', 'impatient', 'slices'])
def test_observations_do_not_change_the_flow(undisturbed, kind, monkeypatch):
    monkeypatch.setattr('lava_ros.runs.drive.MIN_PART', 5e-4)
    simulation, seen, calls = started(), [], 1
    times = [37.0, 38.0, 150.0, END]
    if kind == 'snapshots':
        sink = SnapshotSink(times, lambda _, snapshot: seen.append(snapshot.time))
    elif kind == 'peaks':
        threshold = simulation.accuracy.inundation_threshold
        sink = PeakSink(simulation, times, threshold=threshold)
    else:
        sink = Impatient() if kind == 'impatient' else Sink()
    drive(simulation, END, [sink], wall_limit=0.0 if kind == 'slices' else np.inf)
    while simulation.time < END:
        calls += 1
        drive(simulation, END, [sink], wall_limit=0.0)
    snapshot = simulation.snapshot()
    assert snapshot.time == END
    np.testing.assert_array_equal(snapshot.thickness, undisturbed.thickness)
    np.testing.assert_array_equal(snapshot.arrived, undisturbed.arrived)
    if kind == 'snapshots':
        assert seen == sorted(set(seen))
        # a step may be longer than the second between two times
        assert len(seen) in (3, 4)
        assert seen[0] >= times[0]
        assert seen[-1] == END
        assert sink.latest is not None and sink.latest.time == END
        assert sink.is_done
    elif kind == 'peaks':
        assert sink.is_done
        assert sink.progress == 1.0
        peaks = sink.seen(simulation)
        assert (peaks.thickness >= snapshot.thickness)[SLOPE.has_data].all()
    elif kind == 'impatient':
        assert len(sink.times) > 1
    else:
        assert calls > 1


def test_run_stops_early_at_the_end_of_a_step():
    simulation = started()
    parts = iter([False, False, True])
    for _ in driving(simulation, END, is_over=lambda: next(parts)):
        pass
    assert 0.0 < simulation.time < END


def test_run_with_too_many_particles_raises():
    simulation = started()
    threshold = simulation.accuracy.inundation_threshold
    peaks = PeakSink(
        simulation, [END], threshold=threshold, max_particles=5, of=' of member 3'
    )
    with pytest.raises(LavaError, match=r'particles of member 3 is \d+, expected at most 5'):
        drive(simulation, END, [peaks])


def test_flow_that_is_no_map_raises(monkeypatch):
    monkeypatch.setattr(
        'lava_ros.simulation.output.snapshot.Snapshot.flaw', lambda _: 'thickness is not a number'
    )
    with pytest.raises(LavaError, match='thickness is not a number'):
        drive(started(), END, [SnapshotSink([END])])


def test_progress_is_shown_when_it_is_due():
    shown, due = [], iter([True, False] * 1000)
    drive(started(), END, [ProgressSink(shown.append, END, lambda: next(due))])
    assert len(shown) > 2
    assert shown == sorted(shown)
    assert shown[-1] <= END
