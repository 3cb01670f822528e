# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A run of a scene in its folder, from its start or from the last stored state."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from datetime import datetime, timezone
import json
from pathlib import Path
import time as wall_clock
from typing import Any

from lava_ros.bag.description import effect_table, is_on
from lava_ros.bag.status_values import numerical_error_values, resolution_values
from lava_ros.runs.drive import drive, Sink
from lava_ros.runs.map_bag import stamp_at
from lava_ros.runs.provenance import identity_of, program
from lava_ros.runs.run_folder import RunFolder
from lava_ros.runs.sinks import SnapshotSink, valid_snapshot
from lava_ros.runs.store import KeepSink, unused_folder
from lava_ros.scene import date_text, Scene, scene_to_dict
from lava_ros.scene.erupting_lava import EruptingLava
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import NOT_MEASURED, NumericalError
from lava_ros.simulation.output.measurement import current_resolution
from lava_ros.simulation.output.snapshot import Snapshot
from lava_ros.simulation.selection import warnings_of

#: Parent folder of runs without ``--output``.
RUNS = Path('runs')


@dataclass(frozen=True)
class Request:
    """A run that a user asks for.

    Attributes:
        scene: The scene.
        name: Name of the folder unless ``output`` is given.
        until: Simulated time at which the run ends [s].
        times: Simulated times of the maps [s], increasing, the last one at the end.
        settings: Everything else that determines the result, as plain data.
        accuracy: Returns the name of the preset and the accuracy; called for a new run only.
        forced: Effects forced on or off, by name.
        device: Warp device; None for the first GPU, or the CPU without one.
        inputs: Path, size and digest of each input file (``SourcedScene.digests``).
        remarks: Warnings about the inputs.
        output: The folder; None for an unused one in ``RUNS``.
    """

    scene: Scene
    name: str
    until: float
    times: Sequence[float]
    settings: Mapping[str, Any]
    accuracy: Callable[[], tuple[str, Accuracy]]
    forced: Mapping[str, bool] = field(default_factory=dict)
    device: str | None = None
    inputs: Sequence[Mapping[str, Any]] = ()
    remarks: Sequence[str] = ()
    output: Path | None = None


class SceneRun:
    """A run of a scene; ``run.json`` and the bag describe it in the same words.

    Attributes:
        request: The requested run.
        simulation: The simulation.
        folder: Its folder.
        snapshot: The newest map; None before the first.
    """

    def __init__(self, request: Request) -> None:
        """Create the folder and the simulation, or resume the interrupted run in the folder.

        Raises:
            LavaError: If the folder contains anything else, or the scene cannot be simulated.
        """
        scene, self.request = request.scene, request
        plan = {
            'until_s': request.until, 'map_times_s': list(request.times),
            'forced': dict(request.forced), **request.settings,
        }
        identity = identity_of(scene, plan)
        path = request.output or unused_folder(RUNS, request.name, identity)
        begun = datetime.now(timezone.utc).replace(microsecond=0)
        onset = None if scene.onset is None else date_text(scene.onset)
        record: dict[str, Any] = {
            'program': program(), 'identity': identity,
            'begun': date_text(begun), 'wall_time_s': 0.0, 'onset': onset, 'settings': plan,
            'inputs': list(request.inputs), 'scene': scene_to_dict(scene),
            'erupting_lava': EruptingLava.of(scene).as_dict(), 'effects': [],
        }
        self.folder = RunFolder(path, scene, record, {'begun': record['begun']})
        self._earlier, self._begun = self.folder.record['wall_time_s'], wall_clock.monotonic()
        self._effects: dict[str, str] = {}
        for change in self.folder.record['effects']:
            self._effects |= change['effects']
        self.snapshot: Snapshot | None = None
        try:
            self.simulation = self._started()
        except BaseException:
            self.folder.discard()
            raise

    def __enter__(self) -> 'SceneRun':
        """Return the run."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the folder, even after an interruption."""
        self.folder.close()

    @property
    def is_resumed(self) -> bool:
        """True if the run continues an interrupted one."""
        return self.folder.checkpoint is not None

    @property
    def wall_time(self) -> float:
        """Wall time of the run, including its earlier parts [s]."""
        return float(self._earlier) + wall_clock.monotonic() - self._begun

    def keep(self) -> None:
        """Store the state from which the run can be resumed.

        Raises:
            LavaError: If it cannot be written.
        """
        self.folder.keep(self.simulation.checkpoint(), wall_time_s=self.wall_time)

    def _started(self) -> Simulation:
        request, checkpoint = self.request, self.folder.checkpoint
        if checkpoint is not None:
            return Simulation.resume(checkpoint, device=request.device)
        preset, accuracy = request.accuracy()
        simulation = Simulation(
            request.scene, effects=request.forced, accuracy=accuracy, device=request.device,
            horizon=request.until,
        )
        self.folder.put({
            'preset': preset, 'accuracy': asdict(simulation.accuracy), 'device': simulation.device,
        })
        return simulation

    def run(self, *sinks: Sink) -> Snapshot:
        """Run to the end while further sinks observe the flow; return the last snapshot.

        Raises:
            LavaError: If the flow cannot be shown as a map, or a file cannot be written.
        """
        simulation = self.simulation
        self._note_effects(simulation, simulation.time)
        maps = SnapshotSink(self.request.times, self._put, after=simulation.time)
        drive(simulation, self.request.until, [maps, KeepSink(self.keep), *sinks])
        if self.snapshot is None:
            # resumed after the last map
            self.snapshot = valid_snapshot(simulation)
        return self.snapshot

    def finish(self, error: NumericalError | None) -> dict[str, Any]:
        """Write the numerical error, None if it was not measured, and ``run.json``.

        Returns:
            The contents of ``run.json``.

        Raises:
            LavaError: If a file cannot be written.
        """
        snapshot, simulation = self.snapshot, self.simulation
        assert snapshot is not None
        text = NOT_MEASURED if error is None else error.text()
        if error is not None:
            self.folder.bag.put_error(
                {'numerical_error': text, **numerical_error_values(error)}
            )
        resolution = current_resolution(snapshot, simulation.accuracy, simulation.resolution)
        budget = snapshot.budget
        self.folder.finish({
            'resolution': {
                'spacing_m': resolution.spacing, 'flow_width_m': resolution.width,
                'particles_across': resolution.across,
            },
            'flow_kind': None if resolution.kind is None else resolution.kind.text(),
            'numerical_error': None if error is None else error.as_dict(),
            'numerical_error_text': text,
            'simulated_time_s': snapshot.time,
            'inundation_threshold_m': snapshot.threshold,
            'inundated_area_m2': snapshot.area(snapshot.inundated),  # type: ignore[arg-type]
            'standing_area_m2': snapshot.standing_area,
            **{name: float(value) for name, value in budget.texts().items()},
            'particles': snapshot.particle_count,
            'steps': snapshot.steps.count,
            'wall_time_s': round(self.wall_time, 3),
            'warnings': [
                *self.request.remarks, *budget.warnings(), *resolution.warnings(),
                *warnings_of(self.simulation.decisions()),
            ],
        })
        return self.folder.record

    def _put(self, simulation: Simulation, snapshot: Snapshot) -> None:
        """Write a frame, and the effects that have been switched."""
        self.snapshot = snapshot
        self._note_effects(simulation, snapshot.time)
        values = resolution_values(
            current_resolution(snapshot, simulation.accuracy, simulation.resolution)
        )
        self.folder.bag.put_snapshot(simulation.scene, snapshot, values)

    def _note_effects(self, simulation: Simulation, time: float) -> None:
        """Add the effects that have been switched to ``run.json`` and to the bag."""
        table = effect_table(simulation.effects, simulation.decisions())
        changed = {
            name: text for name, text in table.items()
            if name not in self._effects or is_on(text) != is_on(self._effects[name])
        }
        if not changed and self.snapshot is not None:
            return
        self._effects |= changed
        history = list(self.folder.record['effects'])
        if changed:
            history.append({'stamp_ns': stamp_at(time), 'time': time, 'effects': changed})
        self.folder.bag.describe({
            'effects': json.dumps(history),
            'parameters': json.dumps({
                'preset': self.folder.record['preset'],
                'method': self.request.settings.get('method', 'particles'),
            }),
            'device': simulation.device,
        })
        self.folder.put({'effects': history})
