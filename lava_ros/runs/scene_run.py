# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A run of a scene in its folder, from its start or from the last stored state."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
import json
from pathlib import Path
import time as wall_clock
from typing import Any

from lava_ros.bag.description import effect_table, is_on, unused_velocities
from lava_ros.bag.status_values import numerical_error_values, resolution_values
from lava_ros.layers.recording import MAP_TIMES
from lava_ros.runs.drive import drive, Sink
from lava_ros.runs.map_bag import stamp_at
from lava_ros.runs.provenance import description, identity_of
from lava_ros.runs.run_folder import RunFolder
from lava_ros.runs.sinks import SnapshotSink, valid_snapshot
from lava_ros.runs.store import KeepSink, unused_folder
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import across_key, count_key, max_count_key
from lava_ros.simulation.numerical_error import NOT_MEASURED, NumericalError
from lava_ros.simulation.output.measurement import current_resolution
from lava_ros.simulation.output.snapshot import Snapshot
from lava_ros.simulation.resolution import Resolution
from lava_ros.simulation.selection import warnings_of


def _same(snapshot: Snapshot) -> Snapshot:
    return snapshot


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
        output: The folder; None for an unused one in ``runs/``.
        kind: Kind of the run: ``scene`` or ``case``.
        data: Parts of the description of the bag.
        simulated: Returns the scene on the cells of a simulation with an accuracy; None for the
            cells of the scene.
        shown: Converts a snapshot to the cells of the scene.
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
    kind: str = 'scene'
    data: Mapping[str, str] = field(default_factory=dict)
    simulated: Callable[[Accuracy], Scene] | None = None
    shown: Callable[[Snapshot], Snapshot] = _same


class SceneRun:
    """A run of a scene; ``run.json`` and the bag describe it in the same words.

    Attributes:
        request: The requested run.
        simulation: The simulation.
        folder: Its folder.
        snapshot: The newest map; None before the first.
        error: The numerical error; None if it is not measured.
        most_particles: Largest number of particles, or of cells with lava, in any map.
        effects: State of each effect with its reason, by name, after the newest switch.
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
        path = request.output or unused_folder(request.name, identity)
        record: dict[str, Any] = {
            'kind': request.kind, **description(scene, identity, plan, request.inputs),
            'wall_time_s': 0.0, 'effects': [],
        }
        times = json.dumps(list(map(float, request.times)))
        data = {**request.data, MAP_TIMES: times}
        self.folder = RunFolder(path, scene, record, data)
        self._earlier, self._begun = self.folder.record['wall_time_s'], wall_clock.monotonic()
        self._wall_time: float | None = None
        self.effects: dict[str, str] = {}
        for change in self.folder.record['effects']:
            self.effects |= change['effects']
        self.snapshot: Snapshot | None = None
        self.error: NumericalError | None = None
        try:
            self.simulation = self._started()
        except BaseException:
            self.folder.discard()
            raise
        self._method = self.simulation.accuracy.method
        self.most_particles = int(self.folder.record.get(max_count_key(self._method), 0))

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
        if self._wall_time is not None:
            return self._wall_time
        return float(self._earlier) + wall_clock.monotonic() - self._begun

    def keep(self) -> None:
        """Store the state from which the run can be resumed.

        Raises:
            LavaError: If it cannot be written.
        """
        self.folder.keep(
            self.simulation.checkpoint(), wall_time_s=self.wall_time,
            **{max_count_key(self._method): self.most_particles},
        )

    def _started(self) -> Simulation:
        request, checkpoint = self.request, self.folder.checkpoint
        if checkpoint is not None:
            return Simulation.resume(checkpoint, device=request.device)
        preset, accuracy = request.accuracy()
        scene = request.scene if request.simulated is None else request.simulated(accuracy)
        simulation = Simulation(
            scene, effects=request.forced, accuracy=accuracy, device=request.device,
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
        shown = self.request.shown
        maps = SnapshotSink(
            self.request.times, self._put, after=simulation.time, convert=shown
        )
        drive(simulation, self.request.until, [maps, KeepSink(self.keep), *sinks])
        if self.snapshot is None:
            # resumed after the last map
            self.snapshot = valid_snapshot(simulation, shown)
        self._wall_time = self.wall_time
        return self.snapshot

    def note_error(self, error: NumericalError | None) -> None:
        """Write the numerical error, None if it was not measured, and close the bag.

        Raises:
            LavaError: If a file cannot be written.
        """
        self.error = error
        if error is not None:
            self.folder.bag.put_error(
                {'numerical_error': error.text(), **numerical_error_values(error)}
            )
        self.folder.close_bag()

    def finish(self, facts: Mapping[str, Any] = {}) -> dict[str, Any]:
        """Write ``run.json`` with the results, and with further facts.

        Returns:
            The contents of ``run.json``.

        Raises:
            LavaError: If the file cannot be written.
        """
        snapshot, error = self.snapshot, self.error
        assert snapshot is not None
        resolution, budget = self.resolution, snapshot.budget
        self.folder.finish({
            'resolution': {
                'spacing_m': resolution.spacing, 'flow_width_m': resolution.width,
                across_key(self._method): resolution.across,
            },
            'flow_kind': None if resolution.kind is None else resolution.kind.text(),
            'numerical_error': None if error is None else error.as_dict(),
            'numerical_error_text': NOT_MEASURED if error is None else error.text(),
            'simulated_time_s': snapshot.time,
            'inundation_threshold_m': snapshot.threshold,
            'inundated_area_m2': snapshot.area(snapshot.inundated),  # type: ignore[arg-type]
            'standing_area_m2': snapshot.standing_area,
            **{name: float(value) for name, value in budget.texts().items()},
            count_key(self._method): snapshot.particle_count,
            max_count_key(self._method): self.most_particles,
            'steps': snapshot.steps.count,
            'wall_time_s': round(self.wall_time, 3),
            'warnings': self.warnings(),
            **facts,
        })
        return self.folder.record

    def warnings(self) -> list[str]:
        """Return what a reader of the maps must know, in phrases."""
        assert self.snapshot is not None
        return [
            *self.request.remarks, *self.snapshot.budget.warnings_at_end(),
            *self.resolution.warnings(), *self.missed,
        ]

    @property
    def missed(self) -> list[str]:
        """Warnings about effects that the flow or its vents need, and the run does not have."""
        return [
            *warnings_of(self.simulation.decisions()),
            *unused_velocities(self.simulation.scene.vents, self.effects),
        ]

    @property
    def resolution(self) -> Resolution:
        """Measured resolution of the newest map; the expected one if the flow is too small."""
        assert self.snapshot is not None
        simulation = self.simulation
        return current_resolution(self.snapshot, simulation.accuracy, simulation.resolution)

    def _put(self, simulation: Simulation, snapshot: Snapshot) -> None:
        """Write a frame, and the effects that have been switched."""
        self.snapshot = snapshot
        self.most_particles = max(self.most_particles, snapshot.particle_count)
        self._note_effects(simulation, snapshot.time)
        is_refined = self.request.simulated is not None
        scene = simulation.scene
        if is_refined:
            scene = replace(self.request.scene, terrain=snapshot.terrain)
        told = {'input_warnings': self.request.remarks, 'missed_effects': self.missed}
        told = {name: '; '.join(texts) for name, texts in told.items() if texts}
        self.folder.bag.put_snapshot(
            scene, snapshot, {**resolution_values(self.resolution), **told}
        )

    def _note_effects(self, simulation: Simulation, time: float) -> None:
        """Add the effects that have been switched to ``run.json`` and to the bag."""
        table = effect_table(simulation.effects, simulation.decisions())
        changed = {
            name: text for name, text in table.items()
            if name not in self.effects or is_on(text) != is_on(self.effects[name])
        }
        if not changed and self.snapshot is not None:
            return
        self.effects |= changed
        history = list(self.folder.record['effects'])
        if changed:
            history.append({'stamp_ns': stamp_at(time), 'time': time, 'effects': changed})
        self.folder.bag.describe({
            'effects': json.dumps(history),
            'parameters': json.dumps({
                'preset': self.folder.record['preset'],
                'method': self.simulation.accuracy.method,
            }),
            'device': simulation.device,
        })
        self.folder.put({'effects': history})
