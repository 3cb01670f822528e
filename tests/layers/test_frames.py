# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Frames of a bag, and arrival times of their lava."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path

from nav_msgs.msg import MapMetaData, OccupancyGrid
import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image, PointCloud2

from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.errors import LavaError
from lava_ros.layers.arrival import Arrival
from lava_ros.layers.recording import Recording
from lava_ros.products.run_page import read_run
from lava_ros.ros import codec
from lava_ros.scene import Vent
from recording import growing, RAW_CONFIG, record, TERRAIN, VENT

SECOND = 1_000_000_000


def test_last_frame_is_in_physical_units(grids):
    frame = Recording(grids).frame_at()
    assert frame.time == 800.0
    assert set(frame.layers) == {'thickness', 'temperature', 'hazard'}
    thickness = growing(800.0)
    wet = thickness > 0.0
    # half a step of the grids: 10 m and 1200 C in 100 steps
    for source, expected, tolerance in (
        ('thickness', thickness[wet], 0.05),
        ('temperature', 820.0, 6.0),
        ('hazard', 100.0, 0.0),
    ):
        values = frame.layers[source].values
        np.testing.assert_array_equal(np.isfinite(values), wet)
        np.testing.assert_allclose(values[wet], expected, atol=tolerance + 1e-4)
    assert frame.layers['hazard'].is_saturated
    assert not frame.layers['thickness'].is_saturated


def test_frame_has_ground_vents_and_scene(tmp_path):
    closed = Vent((10.0, 60.0), 0.0, 1423.0, name='closed')
    fissure = replace(VENT, end=(5.0, 25.0), discharge=0.5)
    frame = Recording(record(tmp_path / 'bag', vents=(fissure, closed))).frame_at()
    np.testing.assert_array_equal(frame.elevation, TERRAIN.elevation)
    assert (frame.resolution, frame.origin) == (5.0, (-50.0, 20.0))
    np.testing.assert_allclose(frame.vents, [VENT.position, fissure.end])
    assert frame.scene['terrain']['epsg'] == 32633


def test_reads_the_newest_frame_up_to_a_time(bag, tmp_path):
    for asked, shown in ((200.0, 200.0), (599.0, 400.0), (800.0, 800.0)):
        frame = Recording(bag).frame_at(asked)
        assert frame.time == shown
        assert np.isfinite(frame.layers['thickness'].values).any(axis=0).sum() == shown / 100.0
    for asked in (100.0, 999999.0):
        with pytest.raises(LavaError, match=rf'time is {asked}, expected 200 to 800 s'):
            Recording(bag).frame_at(asked)
    timeless = Recording(record(tmp_path / 'timeless', clock=False))
    assert timeless.frame_at().time is None
    with pytest.raises(LavaError, match='does not contain simulated times'):
        timeless.frame_at(300.0)


def test_decodes_grids_with_the_recorded_ranges(tmp_path):
    config = """
        layers:
          depth: {source: thickness, message: nav_msgs/OccupancyGrid, range: [0.0, 50.0]}
          heat: {source: temperature, message: sensor_msgs/Image}
    """
    frame = Recording(record(tmp_path / 'bag', config=config, prefix='/etna')).frame_at()
    thickness, temperature = (frame.layers[name].values for name in ('thickness', 'temperature'))
    np.testing.assert_allclose(thickness[np.isfinite(thickness)], 3.0, atol=0.51)
    np.testing.assert_allclose(temperature[np.isfinite(temperature)], 820.0, rtol=1e-6)
    assert np.isfinite(temperature).sum() == 80
    assert 'hazard' not in frame.layers


def test_yields_all_frames_in_order(bag):
    recording = Recording(bag)
    frames = list(recording.frames())
    assert [frame.time for frame in frames] == [200.0, 400.0, 600.0, 800.0]
    for frame in frames:
        assert frame.time is not None
        wet = np.isfinite(frame.layers['thickness'].values)
        np.testing.assert_array_equal(wet, growing(frame.time) > 0.0)
        np.testing.assert_allclose(frame.vents, [[-47.5, 95.0]])
    progress = [recording.progress_at(frame) for frame in frames]
    assert progress == pytest.approx([0, 1 / 3, 2 / 3, 1])


def test_frames_are_those_of_the_last_run(tmp_path):
    """Repeated messages, frames before a reset and frames without a time are left out."""
    bag = record(tmp_path / 'bag', max_duration=2.5)
    assert len(BagReader(bag).files) > 1
    frames = list(Recording(bag).frames())
    assert [frame.time for frame in frames] == [200.0, 400.0, 600.0, 800.0]
    assert Recording(bag).frame_at(450.0).time == 400.0
    recording = Recording(record(tmp_path / 'reset', [200.0, 400.0, 0.0, 100.0, 300.0]))
    assert [frame.time for frame in recording.frames()] == [0.0, 100.0, 300.0]
    assert recording.frame_at(250.0).time == 100.0
    with pytest.raises(LavaError, match='time is 350.0, expected 0 to 300 s'):
        recording.frame_at(350.0)
    recording = Recording(record(tmp_path / 'cut', close=False))
    assert recording.bag.recovered
    assert [frame.time for frame in recording.frames()] == [200.0, 400.0, 600.0, 800.0]


def test_image_replaces_a_grid_of_the_same_time(tmp_path):
    config = RAW_CONFIG + """
  grid: {source: thickness, message: nav_msgs/OccupancyGrid, range: [0.0, 10.0]}
"""
    head, *lines = config.strip().splitlines()
    turned = '\n'.join([head, lines[-1], *lines[:-1]])
    for name, text in (('after', config), ('before', turned)):
        frame = Recording(record(tmp_path / name, config=text)).frame_at()
        assert frame.layers['thickness'].layer.name == 'height'
        np.testing.assert_allclose(frame.layers['thickness'].values[12, 1], 3.21)


@pytest.mark.parametrize(('custom_data', 'words'), [
    ({'scene': '{}'}, 'run has no map. The command of a run that was interrupted before'),
    ({'scene': '{}', 'ensemble': '{}'}, 'run has the probabilities of an ensemble, not the maps'),
    ({}, 'expected a bag with the layers of a simulation'),
])
def test_error_tells_a_run_before_its_first_map_from_other_bags(custom_data, words, tmp_path):
    with BagWriter(tmp_path / 'run', custom_data=custom_data) as writer:
        writer.write('/noise', 'std_msgs/msg/Empty', bytes(5), 0, qos=LATCHED)
    with pytest.raises(LavaError) as caught:
        Recording(tmp_path / 'run')
    assert words in str(caught.value)


@pytest.mark.parametrize('end', [800.0, 900.0])
def test_pages_warn_of_a_run_that_has_not_reached_its_end(end, tmp_path, caplog):
    times = {'map_times_s': f'[200.0, 500.0, {end}]'}
    page = read_run(record(tmp_path / 'run', custom_data=times))
    said = 'he run has not reached its end, 15 min: '
    shown = [said in text for text in (' '.join(page.warnings), caplog.text)]
    assert shown == [end > 800.0] * 2
    # the map for a time that a run was asked for is at the first step after it
    found = [Recording(tmp_path / 'run').frame_at(time).time for time in (499.0, 500.0)]
    assert found == [400.0, 600.0]


def test_rejects_bags_with_invalid_yaml(tmp_path):
    for name in ('scene', 'msg_config'):
        with pytest.raises(LavaError, match=f'custom_data {name} of '):
            Recording(record(tmp_path / name, custom_data={name: '{not: [yaml'}))


@pytest.mark.parametrize(('topic', 'fields', 'words'), [
    ('/terrain', {'height': 2**31, 'width': 1, 'step': 0}, 'terrain.step'),
    ('/terrain', {'encoding': 'rgb8'}, 'terrain.encoding'),
    ('/terrain', {'data': [0] * 4791}, '^/terrain.data is .*step x height = 4800 bytes'),
    ('/terrain_info', {'resolution': float('nan')}, 'terrain.resolution'),
    ('/vents', {'point_step': 0}, 'vents.fields.x.offset'),
    ('/vents', {'fields': []}, 'vents.fields'),
    ('/vents', {'data': [0, 0, 0xC0, 0x7F] * 11}, 'vents.data'),
    ('/vents', {'data': list(np.float32([2e9] + [1.0] * 10).tobytes())}, 'vents.data is 2000000'),
    ('/height', {'info': MapMetaData(height=2**31, width=2)}, 'message on /height'),
])
def test_rejects_inconsistent_messages(grids, tmp_path, topic, fields, words):
    kinds = {'terrain': Image, 'terrain_info': MapMetaData, 'vents': PointCloud2}
    bag = BagReader(grids)
    with BagWriter(tmp_path / 'lies', custom_data=bag.custom_data) as writer:
        for item in bag.messages():
            data = item.data
            if item.topic == topic:
                kind = kinds.get(topic[1:], OccupancyGrid)
                message = deserialize_message(data, kind)
                for name, value in fields.items():
                    setattr(message, name, value)
                data = codec.serialise(message)
            kind = bag.topics[item.topic].message_type
            writer.write(item.topic, kind, data, item.stamp_ns, qos=LATCHED)
    with pytest.raises(LavaError, match=words):
        Recording(tmp_path / 'lies').frame_at()


def test_masks_and_margins_are_not_maps(tmp_path):
    """A mask does not contain quantities; a layer with a margin shows lava in dry cells."""
    config = """
layers:
  keepout: {source: hazard, message: nav_msgs/OccupancyGrid, step: 20.0}
  wide: {source: thickness, message: nav_msgs/OccupancyGrid, range: [0.0, 10.0], margin: 20.0}
  turned: {source: temperature, message: nav_msgs/OccupancyGrid, range: [0.0, 1200.0],
    scale: [100, 40]}
"""
    frame = Recording(record(tmp_path / 'bag', config=config)).frame_at()
    assert set(frame.layers) == {'temperature'}
    # 60 steps of 20 C downwards from 100
    values = frame.layers['temperature'].values
    np.testing.assert_allclose(values[12, 0], 820.0, atol=10.01)


def arrival_of(bag: Path, threshold: float) -> Arrival:
    """Return the arrival over all frames of a bag."""
    result = Arrival(threshold)
    for frame in Recording(bag).frames():
        result.add(frame)
    return result


def test_arrival_is_the_first_frame_with_lava(tmp_path):
    def flow(time: float) -> np.ndarray:
        thickness = growing(time)
        if time > 500.0:
            thickness[:, 0] = 0.0
        return thickness

    found = arrival_of(record(tmp_path / 'bag', flow=flow), 0.1)
    assert found.times is not None
    expected = [200, 200, 400, 400, 600, 600, 800, 800, np.nan]
    np.testing.assert_array_equal(found.times[12, :9], expected)
    assert np.isnan(found.times[:10]).all()
    assert (found.longest_gap, found.frame_count) == (200.0, 4)


def test_arrival_depends_on_the_threshold(grids, tmp_path):
    bag = record(tmp_path / 'bag', config=RAW_CONFIG)
    found = arrival_of(bag, 3.05)
    assert found.times is not None and found.peak is not None
    # 3.26 m minus 5 cm per column: columns 0 to 4 are above 3.05 m
    np.testing.assert_array_equal(np.isfinite(found.times[12]), np.arange(40) < 5)
    np.testing.assert_allclose(found.peak[12, :8], 3.26 - 0.05 * np.arange(8), rtol=1e-6)
    # a grid does not show lava below its threshold
    for threshold in (0.05, 0.0, -1.0):
        with pytest.raises(LavaError, match=r'threshold is .*at least 0\.1 m'):
            arrival_of(grids, threshold)
    bag = record(tmp_path / 'thin', flow=lambda time: np.full_like(growing(time), 0.3))
    found = arrival_of(bag, 0.3)
    assert found.times is not None
    assert np.isfinite(found.times).sum() == 30 * 40 - 6


def test_arrival_is_that_of_the_simulation(tmp_path):
    """Recorded arrival times are used for their threshold, also in drained cells."""

    def noted(time: float) -> np.ndarray:
        times = np.where(growing(time) > 0.0, 100.0 * np.arange(40) + 37.5, np.nan)
        times[25] = 12.0
        return times

    bag = record(tmp_path / 'bag', arrived=noted)
    found = arrival_of(bag, 0.1)
    assert found.times is not None and found.is_noted
    np.testing.assert_array_equal(found.times[12, :8], 100.0 * np.arange(8) + 37.5)
    assert (found.times[25] == 12.0).all()
    frame = Recording(bag).frame_at()
    assert frame.footprint is not None and frame.footprint[25].all()
    assert not frame.standing[25].any()
    other = arrival_of(bag, 0.5)
    assert other.times is not None and not other.is_noted
    assert other.times[12, 0] == 200.0


@pytest.mark.parametrize('delay', [0, 1, 7_000_000, -SECOND, 10**18])
def test_frames_have_the_stamps_of_maps_and_not_the_times_of_a_recorder(tmp_path, delay):
    """rosbag2 records with the clock of the machine; its messages have delays of their own."""
    own = BagReader(record(tmp_path / 'own', arrived=lambda time: growing(time) * time))
    with closing(BagWriter(tmp_path / 'other', custom_data=own.custom_data)) as writer:
        for index, item in enumerate(own.messages()):
            topic = own.topics[item.topic]
            writer.write(
                item.topic, topic.message_type, item.data,
                item.stamp_ns + delay + bool(delay) * 1_000_000 * (index % 7), qos=topic.qos,
            )
    other = Recording(tmp_path / 'other')
    for frame, expected in zip(other.frames(), Recording(own.path).frames(), strict=True):
        assert frame.time == expected.time
        assert frame.layers.keys() == expected.layers.keys()
    for time in (400.0, 500.0, None):
        frame = other.frame_at(time)
        assert frame.time == {400.0: 400.0, 500.0: 400.0, None: 800.0}[time]
        wanted = np.where(growing(frame.time) > 0.0, growing(frame.time), np.nan)
        np.testing.assert_array_equal(frame.layers['thickness'].values, wanted)
