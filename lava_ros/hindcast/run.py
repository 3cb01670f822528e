# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of cases, which resume after an interruption."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
import hashlib
import json
import math
from pathlib import Path
import shutil
import time as wall_clock

import numpy as np

from lava_ros import validation
from lava_ros.bag.status_values import numerical_error_values, resolution_values
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import refusing
from lava_ros.forecast.partner_runs import measure_error
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.coarse import coarsened, refined
from lava_ros.runs.drive import driving, Sink
from lava_ros.runs.provenance import identity_of as run_identity
from lava_ros.runs.provenance import program
from lava_ros.runs.run_folder import RunFolder
from lava_ros.runs.sinks import SnapshotSink, valid_snapshot
from lava_ros.runs.store import KeepSink, RunStore
from lava_ros.scene import Scene
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import Areas, NumericalError
from lava_ros.simulation.output.measurement import current_resolution
from lava_ros.simulation.output.snapshot import Snapshot
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import Resolution, resolved_accuracy
from lava_ros.simulation.selection import Decision

#: Default number of maps of a run.
MAPS = 24

#: Maximum displacement per step over the cell size, four times the default, and the integrator,
#: which is of first order: less than half the evaluations give the same scores
#: (docs/VALIDATION.md).
COURANT, INTEGRATOR = 2.0, 'rkl1'

#: Effects that are off by default. Inertia matters only within metres of a vent, and needs steps
#: that resolve waves during weeks of creeping flow. Lateral stress is in none of the models with
#: which the materials were calibrated, and makes a run six times as long (docs/VALIDATION.md).
FORCED = {
    name: False
    for name, effect in EFFECTS.items()
    if effect.needs_extent and math.isfinite(effect.threshold)
}

#: Name of the folder, inside the output, with the state of an unfinished run.
UNFINISHED = '.unfinished'


@dataclass(frozen=True)
class Settings:
    """Settings of a run.

    Attributes:
        preset: Preset of the accuracy.
        spacing: Particle spacing [m]; None for the spacing of the preset.
        device: Warp device; None for the first GPU, or the CPU without one.
        forced: Effects forced on or off; others are chosen from the scene.
        maps: Number of maps, evenly spaced over the simulated time, each at the end of the time
            step in which it is due. It does not change the flow. A step in which several are due
            makes one map.
        courant: Maximum displacement per step over the cell size, unless the preset has its own.
        integrator: Time integration, unless the preset has its own displacement.
        thickness: Thickness scale, which sets the volume of a particle [m]; None for the scale of
            the expected flow.
        mobility_limit: Maximum of speed over slope [m/s]; None for no limit.
        method: Carriers of the lava (``Accuracy.method``).
    """

    preset: str = DEFAULT
    spacing: float | None = None
    device: str | None = None
    forced: Mapping[str, bool] = field(default_factory=dict)
    maps: int = MAPS
    courant: float = COURANT
    integrator: str = INTEGRATOR
    thickness: float | None = None
    mobility_limit: float | None = None
    method: str = 'particles'

    def accuracy(self, case: Case) -> Accuracy:
        """Return the accuracy for a case: the preset's with longer steps, and deterministic."""
        # repeated runs take the same path at a fork of a flow, even on a GPU
        accuracy = replace(
            preset_accuracy(self.preset), spacing=self.spacing, thickness=self.thickness,
            deterministic=True, mobility_limit=self.mobility_limit, method=self.method,
        )
        if accuracy.courant_number == Accuracy().courant_number:
            accuracy = replace(accuracy, courant_number=self.courant, integrator=self.integrator)
        forced = {**FORCED, **self.forced}
        return resolved_accuracy(accuracy, case.scene, forced, horizon=case.duration)

    def coarseness(self, case: Case) -> int:
        """Return the side of a simulated cell in cells of the elevation: about the spacing.

        Method cells makes its own grid of the elevation.
        """
        if self.method == 'cells':
            return 1
        spacing = self.accuracy(case).spacing
        assert spacing is not None
        return max(1, round(spacing / case.scene.terrain.resolution))


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a run.

    Attributes:
        snapshot: The flow at the end.
        peak: Largest thickness in any map [m], float32, shape [rows, columns].
        wall_time: Wall time without file access [s]. For one of several runs on a GPU, only the
            time of the host.
        most_particles: Largest number of particles.
        effects: Names of the effects that are on.
        accuracy: The accuracy, without automatic values.
        resolution: Measured resolution; the expected one if the flow is too small.
        decisions: Reasons why each effect is on or off.
    """

    snapshot: Snapshot
    peak: np.ndarray
    wall_time: float
    most_particles: int
    effects: tuple[str, ...]
    accuracy: Accuracy
    resolution: Resolution
    decisions: tuple[Decision, ...]
    device: str

    @property
    def effects_error(self) -> float:
        """Expected error of the inundated area because of effects that are off."""
        return math.fsum(item.cost for item in self.decisions)


class Run:
    """A run of a case, from its start or, if ``is_resumed``, from the last stored state."""

    def __init__(
        self, case: Case, settings: Settings, *, folder: Path | None = None, has_maps: bool = True
    ) -> None:
        """Start a run, or resume the run whose state is in ``folder``; None stores no state.

        Without ``has_maps`` only the last map is made. The folder then has no bag.

        Raises:
            LavaError: If a setting is not valid, or the folder belongs to another case or other
                settings.
        """
        validation.number('--maps', settings.maps, at_least=1, at_most=10_000)
        self.case, self.settings = case, settings
        self._coarseness = settings.coarseness(case)
        self._has_maps = has_maps
        self._latest: Snapshot | None = None
        self._store = None if folder is None else self._opened(folder)
        known = {} if self._store is None else self._store.arrays
        shape = case.scene.terrain.shape
        self._peak = np.array(known.get('peak', np.zeros(shape, np.float32)))
        record = {} if self._store is None else self._store.record
        self._wall_time = float(record.get('wall_time_s', 0.0))
        self._most_particles = int(record.get('most_particles', 0))
        # wall time of the current part that writes files [s]
        self._writing_time = 0.0

    def _opened(self, folder: Path) -> RunStore:
        case, settings = self.case, self.settings
        record = {'identity': identity_of(case, settings), 'program': program()}
        expected = 'a folder without an unfinished run of another case or of other settings; '
        expected += '--fresh starts again from time 0'
        if not self._has_maps:
            return RunStore(folder, record, expected)
        data = {'case': case.name, 'parameters': json.dumps({'preset': settings.preset})}
        return RunFolder(folder, self.case.scene.at(0.0), record, data, expected)

    @property
    def is_resumed(self) -> bool:
        """True if the run continues an interrupted one."""
        return self._store is not None and self._store.checkpoint is not None

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._simulation.time

    @property
    def map_times(self) -> list[float]:
        """Simulated times at which maps are due [s]."""
        duration, maps = self.case.duration, self.settings.maps
        return [*(duration * (index / maps) for index in range(1, maps)), duration]

    def parts(self, *sinks: Sink) -> Iterator[None]:
        """Simulate in parts, so that the caller can do other work while a GPU computes.

        Args:
            sinks: Further observers of the flow.
        """
        simulation, times = self._simulation, self.map_times
        if not self._has_maps:
            times = times[-1:]
        maps = SnapshotSink(times, self._add, after=simulation.time, convert=self._refined)
        keep = [KeepSink(self.keep, self.map_times)] if self._store is not None else []
        steps = driving(simulation, self.case.duration, [maps, *keep, *sinks])
        is_done = False
        while not is_done:
            started, self._writing_time = wall_clock.monotonic(), 0.0
            is_done = next(steps, True) is True
            self._wall_time += wall_clock.monotonic() - started - self._writing_time
            self._most_particles = max(self._most_particles, simulation.most_particles)
            if not is_done:
                yield

    def result(self) -> Result:
        """Return the result so far."""
        simulation, snapshot = self._simulation, self._latest
        if snapshot is None or snapshot.time != simulation.time:
            snapshot = valid_snapshot(simulation, self._refined)
        return Result(
            snapshot=snapshot,
            peak=self._peak,
            wall_time=self._wall_time,
            most_particles=self._most_particles,
            effects=tuple(simulation.effects),
            accuracy=simulation.accuracy,
            resolution=current_resolution(
                snapshot, simulation.accuracy, simulation.resolution
            ),
            decisions=simulation.decisions(),
            device=simulation.device,
        )

    def keep(self) -> None:
        """Store the state for a resume, if there is a folder."""
        if self._store is not None:
            with self._writing():
                self._store.keep(
                    self._simulation.checkpoint(), {'peak': self._peak},
                    wall_time_s=self._wall_time, most_particles=self._most_particles,
                )

    def close(self) -> None:
        """Release the folder for other runs, if there is one."""
        if self._store is not None:
            self._store.close()

    def write_bag(self, result: Result, error: NumericalError, bag: Path) -> None:
        """Finish the bag of a run with maps, and move it; it replaces an earlier bag.

        Args:
            result: Result of the run.
            error: Its numerical error.
            bag: Folder of the bag.

        Raises:
            LavaError: If it cannot be written.
        """
        store = self._store
        assert isinstance(store, RunFolder)
        effects = {
            item.name: f'{"on" if item.is_on else "off"}: {item.reason}'
            for item in result.decisions
        }
        with refusing('output', str(bag), 'a writable folder', OSError):
            store.bag.describe({
                'device': result.device,
                'effects': json.dumps([{'time': 0.0, 'effects': effects}]),
            })
            store.bag.put_error({'numerical_error': error.text(), **numerical_error_values(error)})
            store.close()
            shutil.rmtree(bag, ignore_errors=True)
            store.bag.directory.rename(bag)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        started = wall_clock.monotonic()
        yield
        self._writing_time += wall_clock.monotonic() - started

    def _add(self, simulation: Simulation, snapshot: Snapshot) -> None:
        np.maximum(self._peak, np.nan_to_num(snapshot.thickness), out=self._peak)
        self._latest = snapshot
        if isinstance(self._store, RunFolder):
            with self._writing():
                scene = self.case.scene.at(snapshot.time)
                values = resolution_values(current_resolution(
                    snapshot, simulation.accuracy, simulation.resolution
                ))
                self._store.bag.put_snapshot(scene, snapshot, values)

    def _refined(self, snapshot: Snapshot) -> Snapshot:
        return refined(snapshot, self.case.scene.terrain, self._coarseness)

    @cached_property
    def _simulation(self) -> Simulation:
        # created at the first use, because it may have to be compiled
        started, device = wall_clock.monotonic(), self.settings.device
        if self._store is not None and self._store.checkpoint is not None:
            simulation = Simulation.resume(self._store.checkpoint, device=device)
        else:
            simulation = Simulation(
                simulated_scene(self.case, self._coarseness),
                effects={**FORCED, **self.settings.forced},
                accuracy=self.settings.accuracy(self.case),
                device=device,
                horizon=self.case.duration,
            )
        self._wall_time += wall_clock.monotonic() - started
        return simulation


def identity_of(case: Case, settings: Settings) -> str:
    """Return a hash that identifies the case and the settings."""
    grids = [case.footprint, *(outline.footprint for outline in case.outlines)]
    return run_identity(case.scene, {
        'grids': [hashlib.sha256(grid.tobytes()).hexdigest() for grid in grids],
        'span': [case.start, case.end],
        'accuracy': asdict(settings.accuracy(case)),
        'forced': dict(settings.forced),
        'maps': settings.maps,
    })


def simulate(case: Case, settings: Settings) -> Result:
    """Run a case to its end without storing its state."""
    run = Run(case, replace(settings, maps=1))
    for _ in run.parts():
        pass
    return run.result()


def measure_run_error(case: Case, settings: Settings, result: Result) -> NumericalError:
    """Measure the numerical error of a run with its partner runs.

    Args:
        case: The case.
        settings: Settings of the run.
        result: Result of the run.
    """
    coarseness = settings.coarseness(case)
    return measure_error(
        simulated_scene(case, coarseness),
        Areas.of(result.snapshot),
        result.snapshot.time,
        accuracy=result.accuracy,
        effects=Effects(**{name: name in result.effects for name in EFFECTS}),
        horizon=case.duration,
        device=settings.device,
        areas=lambda partner: Areas.of(refined(partner, case.scene.terrain, coarseness)),
    )


def simulated_scene(case: Case, coarseness: int) -> Scene:
    """Return the scene of a case, with its events, on cells larger by ``coarseness``."""
    return case.scene.on(lambda terrain: coarsened(terrain, coarseness))
