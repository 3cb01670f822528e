# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of cases: requests of runs with maps, and runs without maps that also resume."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
import hashlib
import math
from pathlib import Path
import time as wall_clock
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.effects import EFFECTS
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.coarse import coarsened, refined
from lava_ros.hindcast.fluid import bounded
from lava_ros.runs.drive import driving, Sink
from lava_ros.runs.provenance import description
from lava_ros.runs.provenance import identity_of as run_identity
from lava_ros.runs.scene_run import Request, SceneRun
from lava_ros.runs.sinks import SnapshotSink, valid_snapshot
from lava_ros.runs.store import KeepSink, RunStore
from lava_ros.scene import Scene
from lava_ros.scene.from_outline import with_outline
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import max_count_key
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
        mobility_limit: Maximum derivative of speed by slope [m/s]; None for one that bounds
            the cost of fluid lava (fluid.py).
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
        """Return the accuracy for a case, without automatic values."""
        accuracy = self.adapted(replace(
            preset_accuracy(self.preset), spacing=self.spacing, thickness=self.thickness
        ))
        accuracy = bounded(accuracy, case.scene, self.effects, horizon=case.duration)
        return resolved_accuracy(accuracy, case.scene, self.effects, horizon=case.duration)

    def adapted(self, accuracy: Accuracy) -> Accuracy:
        """Return the accuracy of a preset with longer steps, and deterministic."""
        # repeated runs take the same path at a fork of a flow, even on a GPU
        accuracy = replace(
            accuracy, deterministic=True, mobility_limit=self.mobility_limit, method=self.method
        )
        if accuracy.courant_number == Accuracy().courant_number:
            accuracy = replace(accuracy, courant_number=self.courant, integrator=self.integrator)
        return accuracy

    @property
    def effects(self) -> dict[str, bool]:
        """Effects forced on or off, with those that are off by default."""
        return {**FORCED, **self.forced}

    def coarseness(self, case: Case) -> int:
        """Return the side of a simulated cell in cells of the elevation."""
        return coarseness(case, self.accuracy(case))

    def map_times(self, case: Case) -> list[float]:
        """Return the simulated times at which maps are due [s]."""
        duration, maps = case.duration, self.maps
        return [*(duration * (index / maps) for index in range(1, maps)), duration]


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a run.

    Attributes:
        snapshot: The flow at the end.
        wall_time: Wall time without file access [s]. For one of several runs on a GPU, only the
            time of the host.
        most_particles: Largest number of particles, or of cells with lava.
        effects: Names of the effects that are on.
        accuracy: The accuracy, without automatic values.
        resolution: Measured resolution; the expected one if the flow is too small.
        decisions: Reasons why each effect is on or off.
        device: Computing device.
    """

    snapshot: Snapshot
    wall_time: float
    most_particles: int
    effects: tuple[str, ...]
    accuracy: Accuracy
    resolution: Resolution
    decisions: tuple[Decision, ...]
    device: str

    @classmethod
    def of(
        cls, simulation: Simulation, snapshot: Snapshot, wall_time: float, most_particles: int
    ) -> 'Result':
        """Return the result of a simulation, of which a snapshot is on the cells of its case."""
        accuracy = simulation.accuracy
        return cls(
            snapshot, wall_time, most_particles, tuple(simulation.effects), accuracy,
            current_resolution(snapshot, accuracy, simulation.resolution),
            simulation.decisions(), simulation.device,
        )

    @classmethod
    def of_run(cls, made: SceneRun) -> 'Result':
        """Return the result of a completed run with maps."""
        assert made.snapshot is not None
        return cls.of(made.simulation, made.snapshot, made.wall_time, made.most_particles)

    @property
    def effects_error(self) -> float:
        """Expected error of the inundated area because of effects that are off."""
        return math.fsum(item.cost for item in self.decisions)


def request_of(
    case: Case, settings: Settings, accuracy: Callable[[], tuple[str, Accuracy]] | None = None,
    chosen: Mapping[str, Any] = {}, name: str = '', **others: Any,
) -> Request:
    """Return the request of a run of a case with maps.

    Args:
        case: The case.
        settings: Settings of the run.
        accuracy: Returns the name of the preset and the accuracy; None for those of the settings.
        chosen: Everything else that determines the result, as plain data.
        name: Name of the folder unless ``output`` is given.
        others: Other fields of the request.

    Raises:
        LavaError: If a setting is not valid.
    """
    validation.number('--maps', settings.maps, at_least=1, at_most=10_000)
    return Request(
        case.scene,
        name=name or f'{case.name}_{settings.preset}',
        until=case.duration,
        times=settings.map_times(case),
        settings={**_chosen(case, settings), **chosen},
        accuracy=accuracy or (lambda: (settings.preset, settings.accuracy(case))),
        forced=settings.effects,
        device=settings.device,
        kind='case',
        data={'case': case.name},
        simulated=lambda accuracy: simulated_scene(case, coarseness(case, accuracy)),
        shown=lambda snapshot: shown_on(case, snapshot),
        **others,
    )


class Run:
    """A run of a case without maps, from its start or, if ``is_resumed``, from a stored state."""

    def __init__(self, case: Case, settings: Settings, *, folder: Path | None = None) -> None:
        """Start a run, or resume the run whose state is in ``folder``; None stores no state.

        Raises:
            LavaError: If the folder belongs to another case or other settings.
        """
        self.case, self.settings = case, settings
        self._latest: Snapshot | None = None
        self._store: RunStore | None = None
        if folder is not None:
            identity = identity_of(case, settings)
            record = description(case.scene, identity, _chosen(case, settings))
            self._store = RunStore(folder, {'kind': 'case', **record})
        record = {} if self._store is None else self._store.record
        self._wall_time = float(record.get('wall_time_s', 0.0))
        self._most_particles = int(record.get(max_count_key(settings.method), 0))

    @property
    def is_resumed(self) -> bool:
        """True if the run continues an interrupted one."""
        return self._store is not None and self._store.checkpoint is not None

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._simulation.time

    def parts(self, *sinks: Sink) -> Iterator[None]:
        """Simulate in parts, so that the caller can do other work while a GPU computes.

        Args:
            sinks: Further observers of the flow.
        """
        simulation, end = self._simulation, self.case.duration
        last = SnapshotSink([end], self._note, after=simulation.time, convert=self._refined)
        keep = [KeepSink(self.keep, self.settings.map_times(self.case))] * bool(self._store)
        steps = driving(simulation, end, [last, *keep, *sinks])
        is_done = False
        while not is_done:
            started = wall_clock.monotonic()
            is_done = next(steps, True) is True
            self._wall_time += wall_clock.monotonic() - started
            self._most_particles = max(self._most_particles, simulation.most_particles)
            if not is_done:
                yield

    def result(self) -> Result:
        """Return the result so far."""
        simulation, snapshot = self._simulation, self._latest
        if snapshot is None or snapshot.time != simulation.time:
            snapshot = valid_snapshot(simulation, self._refined)
        return Result.of(simulation, snapshot, self._wall_time, self._most_particles)

    def keep(self) -> None:
        """Store the state for a resume, if there is a folder."""
        if self._store is not None:
            self._store.keep(
                self._simulation.checkpoint(), wall_time_s=self._wall_time,
                **{max_count_key(self.settings.method): self._most_particles},
            )

    def close(self) -> None:
        """Release the folder for other runs, if there is one."""
        if self._store is not None:
            self._store.close()

    def _note(self, simulation: Simulation, snapshot: Snapshot) -> None:
        self._latest = snapshot

    def _refined(self, snapshot: Snapshot) -> Snapshot:
        return shown_on(self.case, snapshot)

    @cached_property
    def _simulation(self) -> Simulation:
        # created at the first use, because it may have to be compiled
        started, settings, case = wall_clock.monotonic(), self.settings, self.case
        if self._store is not None and self._store.checkpoint is not None:
            simulation = Simulation.resume(self._store.checkpoint, device=settings.device)
        else:
            accuracy = settings.accuracy(case)
            simulation = Simulation(
                simulated_scene(case, coarseness(case, accuracy)), effects=settings.effects,
                accuracy=accuracy, device=settings.device, horizon=case.duration,
            )
        self._wall_time += wall_clock.monotonic() - started
        return simulation


def identity_of(case: Case, settings: Settings) -> str:
    """Return a hash that identifies the case and the settings."""
    return run_identity(case.scene, {
        'grids': _digests(case), 'span': [case.start, case.end],
        'accuracy': asdict(settings.accuracy(case)), 'forced': dict(settings.forced),
        'maps': settings.maps,
    })


def _chosen(case: Case, settings: Settings) -> dict[str, Any]:
    """Return what determines the result of a run, except for its scene, as plain data."""
    return {
        'preset': settings.preset, 'spacing_m': settings.spacing,
        'mobility_limit_m_per_s': settings.mobility_limit, 'method': settings.method,
        'span_s': [case.start, case.end],
        'observations': _digests(case),
    }


def _digests(case: Case) -> list[str]:
    """Return the digests of the mapped flow fields."""
    grids = [case.footprint, *(outline.footprint for outline in case.outlines)]
    return [hashlib.sha256(grid.tobytes()).hexdigest() for grid in grids]


def simulate(case: Case, settings: Settings) -> Result:
    """Run a case to its end without storing its state."""
    run = Run(case, settings)
    for _ in run.parts():
        pass
    return run.result()


def shown_on(case: Case, snapshot: Snapshot) -> Snapshot:
    """Return a snapshot on the cells of a case; lava has covered the outline at its start."""
    ground = case.scene.ground_at(snapshot.time)
    if case.initial is None:
        return refined(snapshot, ground)
    assert snapshot.inundated is not None
    outlined = outlined_part(case, round(snapshot.terrain.resolution / ground.resolution))
    # cells in the outline become whole, so that the other cells have the rest of the area
    rest = with_outline(snapshot.inundated, outlined) - outlined
    outside = np.maximum(np.float32(1.0) - outlined, np.float32(1e-6))
    shown = refined(replace(snapshot, inundated=rest / outside), ground)
    covered = case.initial & shown.terrain.has_data
    values = {'inundated': 1.0, 'arrived': 0.0, 'half_inundated': 0.0}
    return replace(shown, **{
        name: np.where(covered, np.float32(value), getattr(shown, name))
        for name, value in values.items()
    })


def outlined_part(case: Case, factor: int) -> np.ndarray:
    """Return the fraction of each cell in the outline from which a case starts.

    Args:
        case: A case that starts from an outline.
        factor: Side of a cell in cells of the elevation.

    Returns:
        Fraction of the cells with data at the start, float32, shape [rows, columns].
    """
    terrain = case.scene.terrain
    assert case.initial is not None
    known = np.where(terrain.has_data, case.initial, np.nan)
    part = coarsened(replace(terrain, elevation=known), factor).elevation
    return np.nan_to_num(part).astype(np.float32)


def coarseness(case: Case, accuracy: Accuracy) -> int:
    """Return the side of a simulated cell in cells of the elevation: about the spacing.

    Method cells makes its own grid of the elevation.
    """
    if accuracy.method == 'cells':
        return 1
    assert accuracy.spacing is not None
    return max(1, round(accuracy.spacing / case.scene.terrain.resolution))


def simulated_scene(case: Case, coarseness: int) -> Scene:
    """Return the scene of a case, with its events, on cells larger by ``coarseness``."""
    return case.scene.on(lambda terrain: coarsened(terrain, coarseness))
