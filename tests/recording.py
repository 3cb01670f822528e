# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of a synthetic flow, recorded as the node records."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from mcap.reader import make_reader
from mcap.writer import Writer
import numpy as np
from rclpy.serialization import deserialize_message
import yaml

from lava_ros.bag import BagReader, BagWriter, LATCHED
from lava_ros.files.resources import share_path
from lava_ros.layers.layer import ZERO_CELSIUS
from lava_ros.layers.layer_files import layers_from_dict, load_layers
from lava_ros.layers.messages import vent_rows
from lava_ros.ros import codec, outputs
from lava_ros.scene import Lava, Scene, scene_to_dict, Terrain, Vent
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.snapshot import Snapshot, StepReport

SECOND = 1_000_000_000

#: Nanoseconds since 1970, too many for a float64.
START = 1_790_000_000 * SECOND + 123

#: A slope in UTM zone 33, one corner without data.
TERRAIN = Terrain(
    elevation=np.where(
        np.add.outer(np.arange(30.0), np.arange(40.0)) < 3.0, np.nan,
        np.add.outer(np.arange(30.0), 2.0 * np.arange(40.0)),
    ),
    resolution=5.0,
    origin=(-50.0, 20.0),
    epsg=32633,
    offset=(500_000.0, 4_180_000.0),
)

VENT = Vent((-47.5, 95.0), 10.0, 1423.0, name='open')

#: Occupancy grids, which are rounded and end at 10 m.
GRIDS = """
layers:
  height: {source: thickness, message: nav_msgs/OccupancyGrid, range: [0.0, 10.0]}
  temperature: {source: temperature, message: nav_msgs/OccupancyGrid, range: [0.0, 1200.0]}
  hazard: {source: hazard, message: nav_msgs/OccupancyGrid, threshold: 0.01}
"""

#: Thickness and temperature as floats, and a hazard grid.
RAW_CONFIG = """
layers:
  height: {source: thickness, message: sensor_msgs/Image, threshold: 0.0}
  temperature: {source: temperature, message: sensor_msgs/Image, threshold: 0.0}
  hazard: {source: hazard, message: nav_msgs/OccupancyGrid, threshold: 0.01}
"""


def growing(time: float, terrain: Terrain = TERRAIN) -> np.ndarray:
    """Return a flow along rows 10 to 19 that covers one more column of cells every 100 s.

    The first column is 3.26 m thick, and each further column is 5 cm thinner.
    """
    thickness = np.zeros(terrain.shape, dtype=np.float32)
    columns = int(time / 100.0)
    thickness[10:20, :columns] = 3.26 - 0.05 * np.arange(columns, dtype=np.float32)
    return thickness


def record(
    directory: Path, times: Sequence[float] = (200.0, 400.0, 600.0, 800.0), *,
    flow: Callable[[float], np.ndarray] = growing,
    arrived: Callable[[float], np.ndarray] | None = None, terrain: Terrain = TERRAIN,
    vents: Sequence[Vent] = (VENT,), config: str | None = None,
    custom_data: Mapping[str, str] | None = None, prefix: str = '', clock: bool = True,
    max_duration: float = 0.0, close: bool = True,
) -> Path:
    """Record frames of a flow at simulated times [s], two seconds of ROS time apart.

    Args:
        directory: New folder of the bag.
        times: Simulated times of the frames [s].
        flow: Thickness at a time [m].
        arrived: First arrival times at a time [s], not recorded if None.
        terrain: Ground of the flow.
        vents: Vents of the scene.
        config: Text of a message configuration, the default one if None.
        custom_data: Descriptions of the recording in addition to its scene.
        prefix: Namespace of all topics.
        clock: True to record diagnostics.
        max_duration: Duration of each file [s], 0 for one file.
        close: True to finish the bag.
    """
    scene = Scene(terrain, tuple(vents), lava=Lava.paper())
    data = {'scene': yaml.safe_dump(scene_to_dict(scene)), **(custom_data or {})}
    layers = load_layers(share_path('msg_configs/default.yaml'))
    if config is not None:
        data['msg_config'] = config
        layers = layers_from_dict(yaml.safe_load(config))
    writer = BagWriter(directory, custom_data=data, max_duration=max_duration)

    def write(topic: str, message_type: str, message: Any, stamp_ns: int) -> None:
        writer.write(
            f'{prefix}/{topic}', message_type, codec.serialise(message), stamp_ns, qos=LATCHED
        )

    image, info = outputs.terrain_messages(terrain, codec.header('map', START)).values()
    write('terrain', 'sensor_msgs/msg/Image', image, START)
    write('terrain_info', 'nav_msgs/msg/MapMetaData', info, START)
    rows = vent_rows(scene.vents, 0.0)
    cloud = outputs.vents_message(rows, terrain, codec.header('map', START))
    write('vents', 'sensor_msgs/msg/PointCloud2', cloud, START)
    for index, time in enumerate(times):
        stamp = START + 2 * index * SECOND
        snapshot = snapshot_at(time, flow(time), terrain)
        if arrived is not None:
            times_there = arrived(time).astype(np.float32)
            inundated = np.isfinite(times_there).astype(np.float32)
            snapshot = replace(snapshot, arrived=times_there, inundated=inundated)
        for layer in layers:
            if layer.enabled:
                message = outputs.layer_message(layer, snapshot, codec.header('map', stamp))
                write(layer.topic, layer.message, message, stamp)
        if clock:
            kind, report = 'diagnostic_msgs/msg/DiagnosticArray', diagnostics_of(snapshot, stamp)
            write('diagnostics', kind, report, stamp + SECOND // 2)
        writer.flush()
    if close:
        writer.close()
    return directory


def snapshot_at(time: float, thickness: np.ndarray, terrain: Terrain) -> Snapshot:
    """Return a snapshot of a cooling flow of a thickness [m] at a time [s]."""
    hot = np.float32(900.0 + ZERO_CELSIUS - 0.1 * time)
    temperature = np.where(thickness > 0.0, hot, np.nan)
    volume = float(np.nansum(thickness)) * terrain.resolution**2
    return Snapshot(
        time=time, terrain=terrain,
        thickness=np.where(terrain.has_data, thickness, np.nan).astype(np.float32),
        temperature=temperature.astype(np.float32), budget=VolumeBudget(volume, volume),
        particle_count=1, steps=StepReport(1, 1, 1, 1.0, 'diffusion'),
    )


def diagnostics_of(snapshot: Snapshot, stamp_ns: int) -> DiagnosticArray:
    """Return the diagnostics of the newest frame."""
    budget = snapshot.budget
    values = {
        'simulated_time_s': repr(snapshot.time), 'frame_stamp_ns': str(stamp_ns),
        'epsg': str(snapshot.terrain.epsg),
        'offset_easting': repr(snapshot.terrain.offset[0]),
        'offset_northing': repr(snapshot.terrain.offset[1]),
        **budget.texts(), 'mean_speed': '50', 'spacing_m': '2.5', 'flow_width_m': '40',
        'particles_across': '16', 'numerical_error': '15 % of the inundated area',
        'numerical_error_inundated': '0.15', 'numerical_error_standing': '0.12',
        'particles': '1', 'steps': '1',
        'highest_temperature_c': repr(
            float(np.fmax.reduce(snapshot.temperature, axis=None)) - ZERO_CELSIUS
        ),
    }
    status = DiagnosticStatus(
        name='lava: simulation', values=[KeyValue(key=k, value=v) for k, v in values.items()]
    )
    return DiagnosticArray(header=codec.header('', stamp_ns), status=[status])


def silenced(bag: Path, path: Path, topic: str, *, late: bool = False) -> Path:
    """Copy a bag of one file to an .mcap file without a topic, or with its messages late."""
    (source,) = bag.glob('*.mcap')
    with source.open('rb') as read, path.open('wb') as write:
        reader, writer = make_reader(read), Writer(write)
        writer.start('ros2')
        summary = reader.get_summary()
        assert summary is not None
        schemas = {
            key: writer.register_schema(item.name, item.encoding, item.data)
            for key, item in summary.schemas.items()
        }
        channels = {
            key: writer.register_channel(
                item.topic, item.message_encoding, schemas[item.schema_id], item.metadata
            )
            for key, item in summary.channels.items()
        }
        for _, channel, message in reader.iter_messages():
            is_it = channel.topic == topic
            if late or not is_it:
                stamp = message.log_time + is_it * 10**6 * SECOND
                writer.add_message(channels[channel.id], stamp, message.data, stamp)
        writer.finish()
    return path


def merged(directory: Path, bags: Mapping[str, Path]) -> Path:
    """Write the bags of nodes, by their full names, as rosbag2 records a graph with all of them.

    The topics are in the namespaces of the nodes, except for the diagnostics. The bag has no
    description.
    """
    rows = []
    for name, bag in bags.items():
        reader, space = BagReader(bag), name.rpartition('/')[0]
        for item in reader.messages():
            topic, data = f'{space}{item.topic}', item.data
            if item.topic == '/diagnostics':
                topic, message = item.topic, deserialize_message(data, DiagnosticArray)
                for status in message.status:
                    status.name = status.name.replace('lava', name.strip('/'), 1)
                data = codec.serialise(message)
            rows.append((item.stamp_ns, topic, reader.topics[item.topic], data))
    with closing(BagWriter(directory, custom_data={})) as writer:
        for stamp, topic, kind, data in sorted(rows, key=lambda row: row[0]):
            writer.write(topic, kind.message_type, data, stamp, qos=kind.qos, schema=kind.schema)
    return directory


def changed(
    bag: Path, directory: Path, change: Callable[[str, Any], Any],
    custom_data: Mapping[str, str] | None = None,
) -> Path:
    """Copy a bag with each message replaced by ``change(topic, message)``."""
    reader = BagReader(bag)
    data = reader.custom_data if custom_data is None else custom_data
    with closing(BagWriter(directory, custom_data=data)) as writer:
        for item in reader.messages():
            kind = reader.topics[item.topic].message_type
            message = deserialize_message(item.data, codec.message_class(kind))
            message = change(item.topic, message)
            writer.write(
                item.topic, codec.type_name(type(message)), codec.serialise(message),
                item.stamp_ns, qos=LATCHED,
            )
    return directory
