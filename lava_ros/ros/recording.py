# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Recording of scenes and checkpoints in a bag, in addition to the layers."""

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from dataclasses import dataclass, replace
import json
import time
from typing import Any

from rclpy.node import Node
import yaml

import lava_ros
from lava_ros.bag.checkpoints import NAME
from lava_ros.live.session import is_on, Origin, SimulationSession
from lava_ros.ros import codec, outputs, qos
from lava_ros.ros.recorder import Recorder
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.simulation.output.checkpoint import MEDIA_TYPE, summary_of
from lava_ros.simulation.output.snapshot import Snapshot

#: ROS time after which terrain and vents are written again [ns], because a player that starts in
#: the middle of a bag skips earlier latched messages.
REPEAT_PERIOD_NS = 60 * 10**9


@dataclass(eq=False)
class SceneRecording:
    """Opens an armed bag, describes it, and writes terrain and vents when they have changed.

    Terrain and vents are also repeated (``REPEAT_PERIOD_NS``), but take at most half of the bag.
    The description is updated when the scene changes. It lists in JSON the effects at the start
    and each later switch, and the checkpoint from which the simulation was resumed, if any.

    ``configs`` contains the texts of the layer files by the names of their parameters;
    ``parameters`` returns all parameters of the node by name.
    """

    node: Node
    recorder: Recorder
    frame_id: str
    configs: Mapping[str, str]
    parameters: Callable[[], Mapping[str, Any]]

    def __post_init__(self) -> None:
        """Initialize without a bag."""
        self._scene: Scene | None = None
        self._origin: Origin | None = None
        self._messages = outputs.SceneMessages(self.frame_id)
        self._written_ns = self._written_size = 0
        self._effects: dict[str, str] = {}
        self._history: list[dict[str, Any]] = []

    def write(self, session: SimulationSession, snapshot: Snapshot, stamp_ns: int) -> None:
        """Record what has changed since the last call; ``stamp_ns`` is the ROS time [ns]."""
        scene, recorder, is_new = session.scene, self.recorder, self.recorder.is_armed
        if scene is None or not (is_new or recorder.is_recording):
            return
        if is_new:
            self._effects, self._history, self._origin = {}, [], session.origin
        has_changed = self._note_effects(session.effects, snapshot, stamp_ns)
        if is_new or has_changed or scene is not self._scene:
            put = recorder.begin if is_new else recorder.describe
            put(self._description(scene, session))
            self._scene = scene
        if is_new or self._is_to_repeat(snapshot.terrain, stamp_ns):
            self._messages.forget()
        messages = self._messages.update(
            scene, snapshot.time, stamp_ns, ground=snapshot.terrain
        )
        for topic, message in messages.items():
            self._write(topic, message, stamp_ns)
        if 'terrain' in messages:
            self._written_ns, self._written_size = stamp_ns, self.recorder.size

    def _is_to_repeat(self, terrain: Terrain, stamp_ns: int) -> bool:
        growth = self.recorder.size - self._written_size
        is_late = stamp_ns - self._written_ns >= REPEAT_PERIOD_NS
        # the growth includes the terrain that was written last
        return is_late and growth >= 2 * terrain.elevation.nbytes

    def _note_effects(
        self, effects: Mapping[str, str], snapshot: Snapshot, stamp_ns: int
    ) -> bool:
        """Append the effects that were switched to the history; return True if there are any."""
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

    def _write(self, topic: str, message: Any, stamp_ns: int) -> None:
        name, kind = self.node.resolve_topic_name(topic), codec.type_name(type(message))
        self.recorder.write(name, kind, codec.serialise(message), stamp_ns, qos=qos.LATCHED)

    def _description(self, scene: Scene, session: SimulationSession) -> dict[str, str]:
        resumed = {'resumed_from': json.dumps(self._origin._asdict())} if self._origin else {}
        whole = scene_to_dict(replace(scene, vents=session.schedule))
        parameters = dict(self.parameters())
        return {
            'scene': yaml.safe_dump(whole, sort_keys=False),
            'parameters': yaml.safe_dump(parameters, sort_keys=False),
            'effects': json.dumps(self._history),
            **resumed,
            **self.configs,
            **({'onset': onset} if (onset := parameters.get('onset')) else {}),
            'namespace': self.node.get_namespace(),
            'version': lava_ros.__version__,
            'device': session.device,
        }


#: Maximum number of periods for which a checkpoint is postponed until the bag has grown.
PATIENCE = 10.0

#: Number of periods between checkpoints after a change of scene or effects, which a restarted
#: process can only read from a checkpoint.
AFTER_CHANGE = 0.1


@dataclass(frozen=True)
class LastCheckpoint:
    """Newest checkpoint in a bag: simulated time [s] and size [bytes]; number of checkpoints."""

    time: float
    size: int
    count: int


@dataclass(eq=False)
class CheckpointRecording:
    """Writes a checkpoint at the start of a recording, at intervals, and at its end.

    After a change of scene or effects the interval is ``AFTER_CHANGE`` times as long. If
    checkpoints would take up more than half of the bag, the next one is postponed, by at most
    ``PATIENCE`` periods. A checkpoint equal to the last one, ``last``, is not written. ``take``
    requests a checkpoint, ``clock`` returns wall time [s].
    """

    recorder: Recorder
    take: Callable[[], 'Future[bytes]']
    clock: Callable[[], float] = time.monotonic
    last: LastCheckpoint | None = None

    def __post_init__(self) -> None:
        """Initialize without a checkpoint."""
        self._directory = ''
        self._pending: Future[bytes] | None = None
        self._asked: float | None = None
        self._data, self._written = b'', 0
        self._changes = 0

    def poll(self, period: float, stamp_ns: int, *, changes: int = 0) -> str:
        """Write the requested checkpoint if it is ready, and request the next when it is due.

        Args:
            period: Wall time between checkpoints [s], 0 for none.
            stamp_ns: ROS time [ns].
            changes: Number of changes of scene and effects so far.

        Returns:
            The reason why a checkpoint could not be taken, empty without an error.
        """
        if not self._is_recording() or not period:
            return ''
        if self._pending is not None:
            return self._write(stamp_ns) if self._pending.done() else ''
        if self._is_due(period, is_changed=changes != self._changes):
            self._asked, self._changes = self.clock(), changes
            self._pending = self.take()
        return ''

    def finish(self, period: float, stamp_ns: int, *, timeout: float) -> str:
        """Write a last checkpoint before the bag closes, waiting at most ``timeout`` [s] for it.

        ``stamp_ns`` is the ROS time [ns]; ``period`` and the result are as in ``poll``.
        """
        if not self._is_recording() or not period:
            return ''
        self._pending = self.take()
        return self._write(stamp_ns, timeout)

    def _is_recording(self) -> bool:
        directory = self.recorder.status.directory
        if not self.recorder.is_recording or directory != self._directory:
            self._pending = self._asked = self.last = None
            self._data, self._written = b'', 0
        self._directory = directory
        return self.recorder.is_recording

    def _is_due(self, period: float, *, is_changed: bool) -> bool:
        if self._asked is None:
            return True
        waited = self.clock() - self._asked
        size = len(self._data)
        fits = 2 * (self._written + size) <= self.recorder.size + size
        wanted = AFTER_CHANGE * period if is_changed else period
        return waited >= wanted and (fits or waited >= PATIENCE * period)

    def _write(self, stamp_ns: int, timeout: float = 0.0) -> str:
        pending, self._pending = self._pending, None
        assert pending is not None
        try:
            data = pending.result(timeout)
        except FutureTimeoutError:
            return f'no checkpoint within {timeout:g} s'
        except Exception as error:
            return str(error)
        if data != self._data:
            self.recorder.attach(NAME, MEDIA_TYPE, data, stamp_ns)
            self._data = data
            self._written += len(data)
            count = 1 if self.last is None else self.last.count + 1
            self.last = LastCheckpoint(summary_of(data).time, len(data), count)
        return ''
