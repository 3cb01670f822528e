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

"""What a bag's messages say comes back in metres, Celsius and simulated seconds."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
import pytest
import yaml

from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.errors import LavaError
from lava_ros.frames import read_frame, Recording
from lava_ros.layer_files import layers_from_dict, load_layers
from lava_ros.layers import ZERO_CELSIUS
from lava_ros.ros import codec, outputs
from lava_ros.scene import Scene, scene_to_dict, Terrain, Vent
from lava_ros.share import share_path
from lava_ros.simulation.snapshot import Snapshot, StepReport, VolumeBudget
from recording import growing, RAW_CONFIG, record

SECOND = 1_000_000_000

#: Stamps are seconds since 1970, far more than a float64 keeps to the nanosecond.
START = 1_790_000_000 * SECOND + 123

TERRAIN = Terrain(
    elevation=np.add.outer(np.arange(30.0), 2.0 * np.arange(40.0)),
    resolution=5.0,
    origin=(-50.0, 20.0),
    epsg=32633,
    offset=(500_000.0, 4_180_000.0),
)

VENTS = (Vent((0.0, 50.0), 10.0, name='open'), Vent((10.0, 60.0), 0.0, name='closed'))

BagMaker = Callable[..., Path]


def snapshot(time: float) -> Snapshot:
    """A flow that covers one more column of cells every 100 s."""
    thickness = np.zeros(TERRAIN.shape, dtype=np.float32)
    columns = int(time / 100.0)
    thickness[10:20, :columns] = 3.26
    temperature = np.where(thickness > 0.0, np.float32(900.0 + ZERO_CELSIUS), np.nan)
    return Snapshot(
        time=time,
        terrain=TERRAIN,
        thickness=thickness,
        temperature=temperature.astype(np.float32),
        budget=VolumeBudget(1.0, 1.0, 0.0, 0.0),
        particle_count=1,
        steps=StepReport(1, 1, 1, 1.0, 'diffusion'),
    )


def diagnostics(time: float, stamp_ns: int) -> DiagnosticArray:
    """What the node says about its newest frame."""
    values = {'simulated_time_s': repr(time), 'frame_stamp_ns': str(stamp_ns)}
    status = DiagnosticStatus(
        name='lava: simulation', values=[KeyValue(key=k, value=v) for k, v in values.items()]
    )
    return DiagnosticArray(header=codec.header('', stamp_ns), status=[status])


@pytest.fixture
def make_bag(tmp_path: Path) -> BagMaker:
    """Records frames at 200, 400, 600 and 800 simulated seconds, two seconds apart."""

    def make(
        *, config: str | None = None, prefix: str = '', terrain: bool = True, clock: bool = True
    ) -> Path:
        scene = Scene(TERRAIN, VENTS)
        data = {'scene': yaml.safe_dump(scene_to_dict(scene))}
        layers = load_layers(share_path('msg_configs/default.yaml'))
        if config is not None:
            data['msg_config'] = config
            layers = layers_from_dict(yaml.safe_load(config))
        with BagWriter(tmp_path / 'bag', custom_data=data) as writer:

            def write(topic: str, message_type: str, message: Any, stamp_ns: int) -> None:
                writer.write(
                    topic, message_type, codec.serialise(message), stamp_ns, qos=LATCHED
                )

            if terrain:
                image, info = outputs.terrain_messages(TERRAIN, frame_id='map', stamp_ns=START)
                write(f'{prefix}/terrain', 'sensor_msgs/msg/Image', image, START)
                write(f'{prefix}/terrain_info', 'nav_msgs/msg/MapMetaData', info, START)
                rows = outputs.vent_rows(VENTS, 0.0)
                cloud = outputs.vents_message(rows, TERRAIN, frame_id='map', stamp_ns=START)
                write(f'{prefix}/vents', 'sensor_msgs/msg/PointCloud2', cloud, START)
            for index in range(1, 5):
                shown, stamp = snapshot(200.0 * index), START + 2 * index * SECOND
                for layer in layers:
                    if layer.enabled:
                        message = outputs.layer_message(
                            layer, shown, frame_id='map', stamp_ns=stamp
                        )
                        write(f'{prefix}/{layer.topic}', layer.message, message, stamp)
                if clock:
                    said = diagnostics(shown.time, stamp)
                    later = stamp + SECOND // 2
                    write('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', said, later)
        return tmp_path / 'bag'

    return make


def test_last_frame_in_physical_units(make_bag: BagMaker) -> None:
    """Without a time the last frame is read: metres, Celsius and 0..100, NaN where it is dry."""
    frame = read_frame(make_bag())
    assert frame.time == 800.0
    assert set(frame.layers) == {'thickness', 'temperature', 'hazard'}
    wet = np.zeros(TERRAIN.shape, dtype=bool)
    wet[10:20, :8] = True
    # Half a step of the grids: 10 m and 1200 C in 100 steps.
    for source, value, tolerance in (
        ('thickness', 3.26, 0.05),
        ('temperature', 900.0, 6.0),
        ('hazard', 100.0, 0.0),
    ):
        values = frame.layers[source].values
        np.testing.assert_array_equal(np.isfinite(values), wet)
        np.testing.assert_allclose(values[wet], value, atol=tolerance + 1e-4)
    assert frame.layers['hazard'].is_saturated
    assert not frame.layers['thickness'].is_saturated


def test_ground_vents_and_scene(make_bag: BagMaker) -> None:
    """Elevation, cells, the vents that emit and the scene come back as they were."""
    frame = read_frame(make_bag())
    np.testing.assert_array_equal(frame.elevation, TERRAIN.elevation)
    assert (frame.resolution, frame.origin) == (5.0, (-50.0, 20.0))
    np.testing.assert_allclose(frame.vents, [[0.0, 50.0]])
    assert frame.scene['terrain']['epsg'] == 32633


@pytest.mark.parametrize(('asked', 'shown'), [(200.0, 200.0), (599.0, 400.0), (1e6, 800.0)])
def test_time(make_bag: BagMaker, asked: float, shown: float) -> None:
    """The newest frame up to the simulated time is read."""
    frame = read_frame(make_bag(), asked)
    assert frame.time == shown
    assert np.isfinite(frame.layers['thickness'].values).any(axis=0).sum() == shown / 100.0


def test_a_time_before_the_first_frame(make_bag: BagMaker) -> None:
    """The error names the times there are."""
    with pytest.raises(LavaError, match=r'time is 100\.0, expected 200 to 800 s'):
        read_frame(make_bag(), 100.0)


def test_without_diagnostics(make_bag: BagMaker) -> None:
    """The last frame has no simulated time then, and none can be asked for."""
    bag = make_bag(clock=False)
    assert read_frame(bag).time is None
    with pytest.raises(LavaError, match='does not say its simulated time'):
        read_frame(bag, 300.0)


def test_the_bags_own_message_configuration(make_bag: BagMaker) -> None:
    """Grids are decoded with the ranges they were recorded with; images need none."""
    frame = read_frame(
        make_bag(
            config="""
            layers:
              depth: {source: thickness, message: nav_msgs/OccupancyGrid, range: [0.0, 50.0]}
              heat: {source: temperature, message: sensor_msgs/Image}
            """
        )
    )
    thickness, temperature = (frame.layers[name].values for name in ('thickness', 'temperature'))
    np.testing.assert_allclose(thickness[np.isfinite(thickness)], 3.5)
    np.testing.assert_allclose(temperature[np.isfinite(temperature)], 900.0, rtol=1e-6)
    assert np.isfinite(temperature).sum() == 80
    assert 'hazard' not in frame.layers


def test_namespace(make_bag: BagMaker) -> None:
    """A node that ran in a namespace is read like any other."""
    assert set(read_frame(make_bag(prefix='/etna')).layers) == {
        'thickness',
        'temperature',
        'hazard',
    }


def test_a_bag_without_terrain(make_bag: BagMaker) -> None:
    """What is missing is named."""
    with pytest.raises(LavaError, match='a bag with the topic terrain'):
        read_frame(make_bag(terrain=False))


def test_a_bag_of_something_else(tmp_path: Path) -> None:
    """A bag without any layer is refused."""
    with BagWriter(tmp_path / 'bag', custom_data={}) as writer:
        writer.write('/chatter', 'std_msgs/msg/Empty', bytes(5), START, qos=LATCHED)
    with pytest.raises(LavaError, match='the layers of a simulation'):
        read_frame(tmp_path / 'bag')


def test_every_frame_in_order(tmp_path: Path) -> None:
    """Each frame has its own time and its own maps."""
    recording = Recording(record(tmp_path / 'bag'))
    frames = list(recording.frames())
    assert [frame.time for frame in frames] == [200.0, 400.0, 600.0, 800.0]
    for frame in frames:
        assert frame.time is not None
        wet = np.isfinite(frame.layers['thickness'].values)
        np.testing.assert_array_equal(wet, growing(frame.time) > 0.0)
        np.testing.assert_allclose(frame.vents, [[-47.5, 95.0]])
    assert [recording.share_at(frame) for frame in frames] == pytest.approx([0, 1 / 3, 2 / 3, 1])


def test_what_a_new_file_repeats_is_no_frame(tmp_path: Path) -> None:
    """A bag of several files has the frames of one that was not split."""
    bag = record(tmp_path / 'bag', max_duration=2.5)
    assert len(BagReader(bag).files) > 1
    frames = list(Recording(bag).frames())
    assert [frame.time for frame in frames] == [200.0, 400.0, 600.0, 800.0]
    assert read_frame(bag, 450.0).time == 400.0


def test_only_the_last_run_has_frames(tmp_path: Path) -> None:
    """After a reset the flow begins again, and what was before is not mixed with it."""
    recording = Recording(record(tmp_path / 'bag', [200.0, 400.0, 0.0, 100.0, 300.0]))
    assert [frame.time for frame in recording.frames()] == [0.0, 100.0, 300.0]


def test_a_recording_that_was_cut_off(tmp_path: Path) -> None:
    """Frames whose time was never said are left out."""
    recording = Recording(record(tmp_path / 'bag', close=False))
    assert recording.bag.recovered
    assert [frame.time for frame in recording.frames()] == [200.0, 400.0, 600.0, 800.0]


def test_what_is_not_rounded_is_preferred(tmp_path: Path) -> None:
    """Beside a grid of the same time, the image is what is read."""
    config = RAW_CONFIG + """
  grid: {source: thickness, message: nav_msgs/OccupancyGrid, range: [0.0, 10.0]}
"""
    for name, text in (('after', config), ('before', _last_layer_first(config))):
        frame = read_frame(record(tmp_path / name, config=text))
        assert frame.layers['thickness'].layer.name == 'height'
        np.testing.assert_allclose(frame.layers['thickness'].values[12, 1], 3.21)


@pytest.mark.parametrize('name', ['scene', 'msg_config'])
def test_custom_data_that_is_no_yaml(tmp_path: Path, name: str) -> None:
    """The error names which text it is."""
    bag = record(tmp_path / 'bag', custom_data={name: '{not: [yaml'})
    with pytest.raises(LavaError, match=f'custom_data {name} of '):
        Recording(bag)


def test_a_terrain_that_is_cut_off(tmp_path: Path) -> None:
    """An image with too few bytes for its size is refused."""
    bag = record(tmp_path / 'bag')
    with BagWriter(tmp_path / 'broken', custom_data={}) as writer:
        for item in BagReader(bag).messages():
            data = item.data[:-9] if item.topic == '/terrain' else item.data
            kind = BagReader(bag).topics[item.topic].message_type
            writer.write(item.topic, kind, data, item.stamp_ns, qos=LATCHED)
    with pytest.raises(LavaError, match='image is .* for 30 rows and 40 columns'):
        read_frame(tmp_path / 'broken')


def _last_layer_first(config: str) -> str:
    head, *lines = config.strip().splitlines()
    return '\n'.join([head, lines[-1], *lines[:-1]])


def test_masks_and_margins_are_no_maps(tmp_path: Path) -> None:
    """A keepout mask says nothing of thickness; a layer with a margin shows lava where none is."""
    config = """
layers:
  keepout: {source: hazard, message: nav_msgs/OccupancyGrid, step: 20.0}
  wide: {source: thickness, message: nav_msgs/OccupancyGrid, range: [0.0, 10.0], margin: 20.0}
  turned: {source: temperature, message: nav_msgs/OccupancyGrid, range: [0.0, 1200.0],
    scale: [100, 40]}
"""
    frame = read_frame(record(tmp_path / 'bag', config=config))
    assert set(frame.layers) == {'temperature'}
    # 60 steps of 20 C downwards from 100.
    values = frame.layers['temperature'].values
    np.testing.assert_allclose(values[12, 0], 820.0, atol=10.01)
