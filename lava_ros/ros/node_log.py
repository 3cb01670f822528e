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

"""What the node says in its log, each thing once until it is another."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lava_ros.ros.recorder import Recorder
from lava_ros.ros.session import is_on
from lava_ros.ros.worker_status import WorkerState, WorkerStatus
from lava_ros.scene import Scene, temperature_doubts, Terrain
from lava_ros.simulation.resolution import Resolution
from lava_ros.simulation.snapshot import Snapshot


class NodeLog:
    """Logs scene, simulation and recorder when they have changed."""

    def __init__(self, logger: Any) -> None:
        """Start with nothing logged."""
        self._logger = logger
        self._told: dict[str, object] = {'state': WorkerState.WAITING}

    def scene(
        self, scene: Scene, snapshot: Snapshot | None, effects: Mapping[str, str]
    ) -> None:
        """Log changes of terrain, vents and effects, as of the newest snapshot."""
        terrain, vents = scene.terrain, scene.vents
        self._tell('terrain', terrain, lambda: _terrain_text(terrain))
        # not the discharge: that of a feed changes all the time
        now = snapshot.time if snapshot is not None else 0.0
        discharge = sum(vent.discharge_at(now) for vent in vents)
        places = [(vent.position, vent.end, vent.radius) for vent in vents]
        self._tell('vents', places, lambda: f'vents: {len(vents)}, {discharge:g} m3/s')
        # the topics take Celsius
        doubts = temperature_doubts(scene, is_celsius=True)[:3]
        self._tell('doubts', doubts, lambda: '; '.join(doubts), 'warning')
        names = [name for name, text in effects.items() if is_on(text)]
        self._tell('effects', names, lambda: f'effects: {", ".join(names) or "none"}')

    def worker(
        self, worker: WorkerStatus, resolution: Resolution | None, clock: str, *, is_paused: bool
    ) -> None:
        """Log changes of the simulation's state, and what is wrong with its clock, if anything."""
        state = worker.state
        text = f'simulation {state.value}'
        if state is WorkerState.FAILED:
            text = f'simulation failed: {worker.error}; ~/reset starts it again'
        elif state is WorkerState.PAUSED and not is_paused:
            # an inactive node holds time too, and says that it is inactive
            text = ''
        self._tell(
            'state', state, lambda: text, 'error' if state is WorkerState.FAILED else 'info'
        )
        if resolution is not None:
            severity = 'warning' if resolution.is_coarse else 'info'
            self._tell('resolution', resolution, resolution.text, severity)
        # how long it has been so is part of the text
        self._tell('clock', bool(clock), lambda: clock, 'warning')
        self._tell('hold-up', bool(worker.hold_up), lambda: worker.hold_up, 'warning')

    def volumes(self, snapshot: Snapshot) -> None:
        """Say how much lava has come out, and where it is."""
        budget = snapshot.budget
        self._logger.info(f'volume at {snapshot.time:g} s: {budget.text()}')
        for text in budget.warnings():
            self._logger.warning(text)

    def recorder(self, recorder: Recorder) -> None:
        """Say where the bag is, and what is wrong with it."""
        status = recorder.status
        if recorder.is_recording:
            place = Path(status.directory).absolute()
            self._tell('recorder', place, lambda: f'recording to {place}')
        self._tell('recorder error', status.error, lambda: status.error, 'error')

    def _tell(
        self, about: str, thing: object, text: Callable[[], str], severity: str = 'info'
    ) -> None:
        """Log what there is, once until it is another; an empty text is not logged."""
        if about in self._told and self._told[about] == thing:
            return
        self._told[about] = thing
        words = text()
        # rclpy wants each line that logs to keep its severity
        if words and severity == 'error':
            self._logger.error(words)
        elif words and severity == 'warning':
            self._logger.warning(words)
        elif words:
            self._logger.info(words)


def _terrain_text(terrain: Terrain) -> str:
    rows, columns = terrain.shape
    empty = int(np.isnan(terrain.elevation).sum())
    holes = f', {empty} of them without data' * bool(empty)
    return f'terrain: {columns} x {rows} cells of {terrain.resolution:g} m{holes}'
