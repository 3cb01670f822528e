# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Recording of the scene in a bag, in addition to the layers."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
import json
from typing import Any

import lava_ros
from lava_ros.bag.description import is_on
from lava_ros.bag.recorded_node import RecordedNode
from lava_ros.files.yaml import dump_yaml
from lava_ros.live.session import Origin, SessionView
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.georeference import StaticTransform
from lava_ros.ros.node_graph import NodeGraph
from lava_ros.ros.parameters import Settings, start_values
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.scene.onset import Onset
from lava_ros.simulation.output.snapshot import Snapshot

#: Log time after which terrain and vents are written again [ns], because a player that starts in
#: the middle of a bag skips earlier latched messages.
REPEAT_PERIOD_NS = 60 * 10**9

#: Parameters that take effect at a start: a description has the values at the start of its run.
_OF_START = frozenset(start_values(Settings()))


@dataclass(eq=False)
class SceneRecording:
    """Opens an armed bag, describes it, and writes terrain and vents when they have changed.

    Terrain and vents are also repeated (``REPEAT_PERIOD_NS``), but take at most half of the bag.
    The description is updated when the scene changes. It names the node, the version, and in JSON
    the topics by their names before remapping. It lists the effects at the start and each later
    switch, and the checkpoint from which the simulation was resumed, if any.

    ``configs`` contains the texts of the layer files by the names of their parameters;
    ``parameters`` returns all parameters of the node by name. ``transform`` makes the static
    transforms to the map frame, None without them.
    """

    graph: NodeGraph
    configs: Mapping[str, str]
    parameters: Callable[[], Mapping[str, Any]]
    transform: StaticTransform | None = None

    def __post_init__(self) -> None:
        """Initialize without a bag."""
        self._scene: Scene | None = None
        self._origin: Origin | None = None
        self._messages = outputs.SceneMessages(self.transform)
        self._written_ns = self._written_size = 0
        self.note_start()
        self._effects: dict[str, str] = {}
        self._history: list[dict[str, Any]] = []

    def note_start(self) -> None:
        """Store the parameters of a simulation that has just been made, in any thread."""
        values = self.parameters()
        self._at_start = {name: values[name] for name in _OF_START if name in values}

    def write(self, view: SessionView, snapshot: Snapshot, stamp_ns: int) -> None:
        """Record what has changed since the last call; ``stamp_ns`` is the ROS time [ns]."""
        scene, recorder = view.scene, self.graph.recorder
        is_new = recorder.is_armed
        if scene is None or not (is_new or recorder.is_recording):
            return
        if is_new:
            self._effects, self._history, self._origin = {}, [], view.origin
        has_changed = self._note_effects(view.effects, snapshot, stamp_ns)
        if is_new or has_changed or scene is not self._scene:
            recorder.describe(self._description(scene, view))
            self._scene = scene
        if is_new or self._is_to_repeat(snapshot.terrain):
            self._messages.forget()
        header = self.graph.header(stamp_ns)
        messages = self._messages.update(scene, snapshot.time, header, ground=snapshot.terrain)
        for topic, message in messages.items():
            name, kind = self.graph.node.resolve_topic_name(topic), codec.type_name(type(message))
            recorder.write(name, kind, codec.serialise(message), stamp_ns, qos=qos.LATCHED)
        if 'terrain' in messages:
            # log times do not go back with the clock
            self._written_ns, self._written_size = recorder.log_time_ns, recorder.size

    def _is_to_repeat(self, terrain: Terrain) -> bool:
        recorder = self.graph.recorder
        growth = recorder.size - self._written_size
        is_late = recorder.log_time_ns - self._written_ns >= REPEAT_PERIOD_NS
        # the growth includes the terrain that was written last
        return is_late and growth >= 2 * terrain.elevation.nbytes

    def _note_effects(
        self, effects: Mapping[str, str], snapshot: Snapshot, stamp_ns: int
    ) -> bool:
        """Append newly switched effects to the history; return True if there are any."""
        changed = {
            name: text
            for name, text in effects.items()
            if name not in self._effects or is_on(text) != is_on(self._effects[name])
        }
        self._effects.update(changed)
        if changed:
            entry = {'stamp_ns': stamp_ns, 'time': snapshot.time, 'effects': changed}
            self._history.append(entry)
        return bool(changed)

    def _description(self, scene: Scene, view: SessionView) -> dict[str, str]:
        resumed = {'resumed_from': json.dumps(self._origin._asdict())} if self._origin else {}
        whole = scene_to_dict(replace(scene, vents=view.schedule))
        parameters, node = {**self.parameters(), **self._at_start}, self.graph.node
        onset, token = map(parameters.get, ('onset', 'restart_token'))
        recorded = RecordedNode(
            node.get_fully_qualified_name(), node.get_namespace(), self.graph.topics
        )
        return {
            'scene': dump_yaml(whole),
            'parameters': dump_yaml(parameters),
            'effects': json.dumps(self._history),
            **resumed,
            **self.configs,
            **({'restart_token': token} if token else {}),
            **({'onset': Onset.from_text(onset).text} if onset else {}),
            **recorded.description,
            'version': lava_ros.__version__,
            'device': view.device,
        }
