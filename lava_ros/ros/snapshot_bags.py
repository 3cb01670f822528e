# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags of ensemble maps and of snapshots, written without a node."""

from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import replace
from pathlib import Path
import shutil
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

import lava_ros
from lava_ros.bag import BagWriter, LATCHED, QosProfile
from lava_ros.bag.recorded_node import RecordedNode
from lava_ros.errors import refusing
from lava_ros.files.resources import share_path
from lava_ros.files.yaml import dump_yaml
from lava_ros.forecast.members import Plan
from lava_ros.live.recorder import DEFAULT_NODE
from lava_ros.maps.forecast import EnsembleForecast, HazardMaps
from lava_ros.maps.layer_files import load_layers
from lava_ros.maps.layers import ARRIVED, INUNDATED, Layer
from lava_ros.maps.onset import Onset
from lava_ros.ros import codec, diagnostics, outputs
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.simulation.output.snapshot import Snapshot

#: Namespace of the topics of an ensemble's bag.
NAMESPACE = '/lava'

#: ROS time of simulated time 0 [ns]: 2001-09-09T01:46:40Z, a round number of seconds.
START_NS = 1_000_000_000 * 10**9

_FRAME = 'map'


class _Bag(BagWriter):
    """A bag as a node with the default name in ``namespace`` would record it."""

    def __init__(self, path: Path, namespace: str, scene: Scene, data: Mapping[str, str]) -> None:
        onset = Onset.of(scene)
        self._data = {
            'scene': dump_yaml(scene_to_dict(scene)), 'version': lava_ros.__version__,
            **({} if onset is None else {'onset': onset.text}), **data,
        }
        self.node = RecordedNode(f'{namespace}{DEFAULT_NODE}', namespace or '/', {})
        super().__init__(path, custom_data=self._described())
        self._messages = outputs.SceneMessages()

    def _described(self) -> dict[str, str]:
        return {**self._data, **self.node.description}

    def put(self, topic: str, message: Any, stamp_ns: int, qos: QosProfile = LATCHED) -> None:
        name, data = self.node.topic(topic), codec.serialise(message)
        if topic not in self.node.topics:
            self.node = replace(self.node, topics={**self.node.topics, topic: name})
            self.set_custom_data(self._described())
        self.write(name, codec.type_name(type(message)), data, stamp_ns, qos=qos)

    def put_scene(self, scene: Scene, time: float, stamp_ns: int) -> None:
        header = codec.header(_FRAME, stamp_ns)
        for topic, message in self._messages.update(scene, time, header).items():
            self.put(topic, message, stamp_ns)

    def put_layer(self, layer: Layer, shown: Snapshot | EnsembleForecast, stamp_ns: int) -> None:
        message = outputs.layer_message(layer, shown, codec.header(_FRAME, stamp_ns))
        self.put(layer.topic, message, stamp_ns, layer.qos)


def write_atlas_bag(
    directory: Path,
    maps: HazardMaps,
    plan: Plan,
    *,
    stamp_ns: int,
    custom_data: Mapping[str, str],
) -> None:
    """Write terrain, vents and the layers of an ensemble to a bag; replace an old bag.

    ``stamp_ns`` is the stamp of all messages [ns], the time at which the forecast starts;
    ``custom_data`` describes the bag in addition to its scene.

    Raises:
        LavaError: If the bag cannot be written.
    """
    terrain = plan.scene.terrain
    shown = EnsembleForecast(
        time=0.0,
        horizon=plan.horizon,
        threshold=plan.threshold,
        terrain=terrain,
        maps=maps,
        asked=maps.members,
        is_done=True,
        outlines=0,
        duration=0.0,
    )
    with refusing('bag', str(directory), 'a bag that can be written', OSError):
        if directory.exists():
            shutil.rmtree(directory)
        with closing(_Bag(directory, NAMESPACE, plan.scene, custom_data)) as bag:
            bag.put_scene(plan.scene, 0.0, stamp_ns)
            for layer in load_layers(share_path('msg_configs/forecast.yaml')):
                if layer.is_ensemble:
                    bag.put_layer(layer, shown, stamp_ns)


def write_snapshots(
    directory: Path,
    scene: Scene,
    snapshots: Iterable[Snapshot],
    *,
    custom_data: Mapping[str, str],
    terrains: Iterable[tuple[float, Terrain]] = (),
) -> None:
    """Write snapshots in order of time to a new bag with simulated time as its ROS time.

    ``custom_data`` describes the bag in addition to its scene; ``terrains`` are later terrains,
    each with the simulated time at which it starts [s].

    Raises:
        LavaError: If the bag exists or cannot be created.
        OSError: If the bag cannot be written.
    """
    config = share_path('msg_configs/default.yaml')
    layers = [layer for layer in load_layers(config) if layer.enabled]
    data = {'msg_config': config.read_text(encoding='utf-8'), 'frame_id': _FRAME, **custom_data}
    with closing(_Bag(directory, '', scene, data)) as bag:
        bag.put_scene(scene, 0.0, START_NS)
        later = list(terrains)
        for snapshot in snapshots:
            stamp = START_NS + round(snapshot.time * 1e9)
            while later and later[0][0] <= snapshot.time:
                time, terrain = later.pop(0)
                scene = replace(scene, terrain=terrain)
                bag.put_scene(scene, time, START_NS + round(time * 1e9))
            bag.put_scene(scene, snapshot.time, stamp)
            for layer in layers:
                if layer.source not in (ARRIVED, INUNDATED) or snapshot.arrived is not None:
                    bag.put_layer(layer, snapshot, stamp)
            values = diagnostics.snapshot_values(snapshot, stamp)
            task = f'{bag.node.name.strip("/")}: simulation'
            state = diagnostics.status(task, DiagnosticStatus.OK, 'finished', values)
            message = DiagnosticArray(header=codec.header('', stamp), status=[state])
            bag.put('diagnostics', message, stamp)
