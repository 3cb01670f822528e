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
import time as wall_clock

import numpy as np

from lava_ros import validation
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError, refusing
from lava_ros.files import replacing, write_output
from lava_ros.files.npz import read_arrays
from lava_ros.forecast.partner_runs import measure_error
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.coarse import coarsened, GRIDS, grids_of, refined
from lava_ros.scene import Scene, scene_to_dict, Terrain
from lava_ros.scene.events import TerrainEvent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import Areas, NumericalError
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.checkpoint import from_bytes
from lava_ros.simulation.output.measurement import measure_resolution
from lava_ros.simulation.output.snapshot import Snapshot, StepReport
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import Resolution, resolved_accuracy
from lava_ros.simulation.selection import Decision

#: Default number of maps of a run.
MAPS = 24

#: Maximum displacement per step over the cell size, four times the usual one, and the integrator,
#: of first order: less than half as many evaluations, for the same scores (docs/VALIDATION.md).
COURANT, INTEGRATOR = 2.0, 'rkl1'

#: Effects that are off by default. Inertia matters only within metres of a vent, and needs steps
#: that resolve waves during weeks of creeping flow. Lateral stress is in none of the models with
#: which materials were calibrated, and takes six times as long (docs/VALIDATION.md).
FORCED = {
    name: False
    for name, effect in EFFECTS.items()
    if effect.needs_extent and math.isfinite(effect.threshold)
}

#: Wall time after which a run stores its state again [s].
KEEP_EVERY = 10.0

#: Name of the folder, inside the output, with the state of an unfinished run.
UNFINISHED = '.unfinished'


@dataclass(frozen=True)
class Settings:
    """Settings of a run.

    Attributes:
        preset: Preset of the accuracy.
        spacing: Particle spacing [m]; None for that of the preset.
        device: Warp device; None for the first GPU, or the CPU without one.
        forced: Effects forced on or off; others are chosen from the scene.
        maps: Number of maps, evenly spaced over the simulated time, each at the end of the time
            step in which it is due. It does not change the flow. A step in which several are due
            makes one map.
        courant: Maximum displacement per step over the cell size, unless the preset has its own.
        integrator: Time integration, unless the preset has its own displacement.
        thickness: Thickness scale, which sets the volume of a particle [m]; None for that of the
            expected flow.
    """

    preset: str = DEFAULT
    spacing: float | None = None
    device: str | None = None
    forced: Mapping[str, bool] = field(default_factory=dict)
    maps: int = MAPS
    courant: float = COURANT
    integrator: str = INTEGRATOR
    thickness: float | None = None

    def accuracy(self, case: Case) -> Accuracy:
        """Return the accuracy for a case: the preset's with longer steps, and deterministic."""
        # repeated runs take the same path at a fork of a flow, also on a GPU
        accuracy = replace(
            preset_accuracy(self.preset), spacing=self.spacing, thickness=self.thickness,
            deterministic=True,
        )
        if accuracy.courant_number == Accuracy().courant_number:
            accuracy = replace(accuracy, courant_number=self.courant, integrator=self.integrator)
        forced = {**FORCED, **self.forced}
        return resolved_accuracy(accuracy, case.scene, forced, horizon=case.duration)

    def coarseness(self, case: Case) -> int:
        """Return the side of a simulated cell in cells of the elevation: about the spacing."""
        spacing = self.accuracy(case).spacing
        assert spacing is not None
        return max(1, round(spacing / case.scene.terrain.resolution))


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a run.

    Attributes:
        snapshot: The flow at the end.
        peak: Largest thickness in any map [m], float32, shape [rows, columns].
        wall_time: Wall time without file access [s]. Of one of several runs on a GPU, only that of
            the host.
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
    """A run of a case, from its start or, if ``is_resumed``, from the state stored last."""

    def __init__(
        self, case: Case, settings: Settings, *, folder: Path | None = None, has_maps: bool = True
    ) -> None:
        """Start a run, or resume the one whose state is in ``folder``; None stores no state.

        Without ``has_maps`` only the last map is made.

        Raises:
            LavaError: If a setting is not valid, or the folder belongs to another case or other
                settings.
        """
        validation.number('--maps', settings.maps, at_least=1, at_most=10_000)
        self.case, self.settings, self._folder = case, settings, folder
        self._coarseness = settings.coarseness(case)
        self._peak = np.zeros(case.scene.terrain.shape, np.float32)
        self._wall_time = 0.0
        self._most_particles = self._maps = self._stored = 0
        self._has_maps = has_maps
        # maps that are not stored yet, and the latest map
        self._new: list[Snapshot] = []
        self._latest: Snapshot | None = None
        self._stored_at = wall_clock.monotonic()
        self.is_resumed = folder is not None and (folder / 'run.json').is_file()
        if folder is not None and self.is_resumed:
            self._simulation = self._resumed(folder)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._simulation.time

    def parts(self) -> Iterator[float | None]:
        """Simulate in parts, so that the caller can do other work while a GPU computes.

        Yields:
            The simulated time [s] when a map is due, None after the other parts.
        """
        case, maps = self.case, self.settings.maps
        times = [*(case.duration * (index / maps) for index in range(1, maps)), case.duration]
        for time in times:
            if time <= self._simulation.time:
                # a stored map, or that of the last step, is also for this time
                continue
            yield from self._advancing(time, limit=case.duration)
            if self._has_maps or time == case.duration:
                with self._timed():
                    self._add(self._snapshot())
            if wall_clock.monotonic() - self._stored_at >= KEEP_EVERY:
                self.keep()
            yield self.time

    def result(self) -> Result:
        """Return the result so far."""
        simulation, snapshot = self._simulation, self._latest
        if snapshot is None or snapshot.time != simulation.time:
            snapshot = self._snapshot()
        return Result(
            snapshot=snapshot,
            peak=self._peak,
            wall_time=self._wall_time,
            most_particles=self._most_particles,
            effects=tuple(simulation.effects),
            accuracy=simulation.accuracy,
            resolution=measure_resolution(snapshot, simulation.accuracy) or simulation.resolution,
            decisions=simulation.decisions(),
            device=simulation.device,
        )

    def kept(self) -> Iterator[Snapshot]:
        """Return the maps of a run with a folder, in the order of time."""
        folder, terrain = self._folder, self.case.scene.terrain
        assert folder is not None
        for index in range(self._maps):
            yield _read(folder / f'map_{index:04d}.npz', terrain)
        yield from self._new

    @contextmanager
    def _timed(self) -> Iterator[None]:
        started = wall_clock.monotonic()
        yield
        self._wall_time += wall_clock.monotonic() - started

    def _add(self, snapshot: Snapshot) -> None:
        flaw = snapshot.flaw()
        if flaw:
            raise LavaError('the simulated flow', flaw, 'finite numbers')
        np.maximum(self._peak, np.nan_to_num(snapshot.thickness), out=self._peak)
        self._latest = snapshot
        if self._folder is not None:
            self._new.append(snapshot)

    def _snapshot(self) -> Snapshot:
        snapshot = self._simulation.snapshot()
        return refined(snapshot, self.case.scene.terrain, self._coarseness)

    @cached_property
    def _simulation(self) -> Simulation:
        # made on first use, because it may have to be compiled
        with self._timed():
            return Simulation(
                _simulated_scene(self.case, self._coarseness),
                effects={**FORCED, **self.settings.forced},
                accuracy=self.settings.accuracy(self.case),
                device=self.settings.device,
                horizon=self.case.duration,
            )

    def _advancing(self, until: float, *, limit: float) -> Iterator[None]:
        simulation, started = self._simulation, wall_clock.monotonic()
        for _ in simulation.advancing(until, limit=limit):
            self._wall_time += wall_clock.monotonic() - started
            yield
            started = wall_clock.monotonic()
        self._wall_time += wall_clock.monotonic() - started
        self._most_particles = max(self._most_particles, simulation.most_particles)

    def keep(self) -> None:
        """Write the state for a resume, if there is a folder.

        ``run.json``, written last, makes it valid.
        """
        folder = self._folder
        if folder is None:
            return
        with refusing('output', str(folder), 'a folder to write to', OSError):
            folder.mkdir(parents=True, exist_ok=True)
            for index, snapshot in enumerate(self._new, self._maps):
                _write(folder / f'map_{index:04d}.npz', snapshot)
            self._maps += len(self._new)
            self._new.clear()
            self._stored += 1
            checkpoint = self._simulation.checkpoint().to_bytes()
            write_output('output', folder / f'checkpoint_{self._stored:04d}', checkpoint)
            plain = {
                'identity': identity_of(self.case, self.settings),
                'maps': self._maps,
                'stored': self._stored,
                'wall_time': self._wall_time,
                'most_particles': self._most_particles,
            }
            write_output('output', folder / 'run.json', json.dumps(plain))
            (folder / f'checkpoint_{self._stored - 1:04d}').unlink(missing_ok=True)
        self._stored_at = wall_clock.monotonic()

    def _resumed(self, folder: Path) -> Simulation:
        expected = 'a complete unfinished run; --fresh starts again from time 0'
        with refusing('output', str(folder), expected, OSError, KeyError, ValueError):
            plain = json.loads((folder / 'run.json').read_text(encoding='utf-8'))
            if plain['identity'] != identity_of(self.case, self.settings):
                expected = 'a folder without an unfinished run of another case or of other '
                expected += 'settings; --fresh starts again from time 0'
                raise LavaError('output', str(folder.parent), expected)
            self._maps, self._stored = int(plain['maps']), int(plain['stored'])
            checkpoint = from_bytes((folder / f'checkpoint_{self._stored:04d}').read_bytes())
        for snapshot in self.kept():
            np.maximum(self._peak, np.nan_to_num(snapshot.thickness), out=self._peak)
        self._wall_time = float(plain['wall_time'])
        self._most_particles = int(plain['most_particles'])
        return Simulation.resume(checkpoint, device=self.settings.device)


def identity_of(case: Case, settings: Settings) -> str:
    """Return a hash that differs for every other case and other settings."""
    digest = hashlib.sha256(case.footprint.tobytes())
    for outline in case.outlines:
        digest.update(outline.footprint.tobytes())
    for terrain in (case.scene.terrain, *(event.terrain for event in case.events)):
        digest.update(terrain.elevation.tobytes())
    plain = {
        'scene': scene_to_dict(case.scene),
        'span': [case.start, case.end],
        'events': [(event.time, event.text) for event in case.events],
        'accuracy': asdict(settings.accuracy(case)),
        'forced': dict(settings.forced),
        'maps': settings.maps,
    }
    digest.update(json.dumps(plain, sort_keys=True).encode())
    return digest.hexdigest()


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
        _simulated_scene(case, coarseness),
        Areas.of(result.snapshot),
        result.snapshot.time,
        accuracy=result.accuracy,
        effects=Effects(**{name: name in result.effects for name in EFFECTS}),
        horizon=case.duration,
        device=settings.device,
        areas=lambda partner: Areas.of(refined(partner, case.scene.terrain, coarseness)),
    )


def _simulated_scene(case: Case, coarseness: int) -> Scene:
    """Return the scene of a case, with its events, on cells larger by ``coarseness``."""
    # an event before the start is applied at the start
    events = tuple(
        TerrainEvent(max(event.time - case.start, 0.0), event.text, event.terrain)
        for event in case.events
    )
    scene = replace(case.scene, events=events)
    return scene.on(lambda terrain: coarsened(terrain, coarseness))


def _write(path: Path, snapshot: Snapshot) -> None:
    plain = {
        'time': snapshot.time,
        'budget': asdict(snapshot.budget),
        'steps': asdict(snapshot.steps),
        'particle_count': snapshot.particle_count,
        'threshold': snapshot.threshold,
    }
    with replacing(path) as partial:
        data = np.frombuffer(json.dumps(plain).encode(), np.uint8)
        np.savez_compressed(partial, plain=data, **grids_of(snapshot))  # type: ignore[arg-type]


def _read(path: Path, terrain: Terrain) -> Snapshot:
    expected = 'a map of an earlier run; --fresh starts again from time 0'
    with refusing('output', str(path), expected, OSError, KeyError, TypeError, ValueError):
        arrays = read_arrays('output', path)
        plain = json.loads(arrays['plain'].tobytes())
        return Snapshot(
            time=plain['time'],
            terrain=terrain,
            budget=VolumeBudget(**plain['budget']),
            particle_count=plain['particle_count'],
            steps=StepReport(**plain['steps']),
            threshold=float(plain['threshold']),
            **{name: arrays[name] for name in GRIDS if name in arrays},
        )
