# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0


"""Runs a case, map by map, and goes on where an earlier run was cut off."""

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
from lava_ros.errors import LavaError
from lava_ros.files import replacing, write_output
from lava_ros.files.npz import read_arrays
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.coarse import coarsened, GRIDS, grids_of, refined
from lava_ros.scene import scene_to_dict, Terrain
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.checkpoint import from_bytes
from lava_ros.simulation.measurement import measure_resolution
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import Resolution, resolved_accuracy
from lava_ros.simulation.selection import Decision
from lava_ros.simulation.snapshot import Snapshot, StepReport

#: Maps of a run.
MAPS = 24

#: Displacement in a step over a cell, in place of the usual half: weeks take half the steps, and
#: what it changes is less than what a change of the ground by its own error does.
COURANT = 1.0

#: What is left out unless it is asked for: momentum matters metres from a vent, and asks for steps
#: that resolve waves through weeks of creeping. Lateral stress is in no model that materials have
#: been calibrated with, these ones included, and takes six times the time (docs/VALIDATION.md).
FORCED = {'inertia': False, 'helmholtz': False}

#: Wall time between two looks at the progress [s].
LOOK = 1.0

#: Name of the folder of what a run that is not finished needs, inside its output.
UNFINISHED = '.unfinished'


@dataclass(frozen=True)
class Settings:
    """How a case is run.

    A spacing [m] takes the place of the preset's; a device of None is the best there is. Effects
    that are not forced on or off are chosen from the scene. Maps are even over the simulated time,
    each at the first end of a time step at or after its time: their number does not change the
    flow, and there are fewer of them where a step passes the times of several. ``courant`` is the
    largest displacement in a step over a cell, where the preset has the usual one.
    """

    preset: str = DEFAULT
    spacing: float | None = None
    device: str | None = None
    forced: Mapping[str, bool] = field(default_factory=dict)
    maps: int = MAPS
    courant: float = COURANT

    def accuracy(self, case: Case) -> Accuracy:
        """The accuracy of a case: the preset's, with longer steps, and deterministic."""
        # a flow that forks goes the same way again, on a GPU too
        accuracy = replace(preset_accuracy(self.preset), spacing=self.spacing, deterministic=True)
        if accuracy.courant_number == Accuracy().courant_number:
            accuracy = replace(accuracy, courant_number=self.courant)
        return resolved_accuracy(accuracy, case.scene, horizon=case.duration)

    def coarseness(self, case: Case) -> int:
        """Cells of the elevation to a side of the simulation's: none finer than particles."""
        spacing = self.accuracy(case).spacing
        assert spacing is not None
        return max(1, round(spacing / case.scene.terrain.resolution))


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a run: the flow at its end, and how it was simulated.

    ``peak`` is the largest thickness in any map [m], float32, shape [rows, columns]. The wall time
    [s] is without file access; of one of several runs on a GPU it is only what the host did for
    it. ``accuracy`` has every automatic value filled in. ``decisions`` say why each effect is on
    or off. ``resolution`` is measured if the flow is large enough, else the expected one.
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
        """Expected error of the footprint by the effects that were left out."""
        return math.fsum(item.cost for item in self.decisions)


class Run:
    """A case on its way, from its start or, if ``is_resumed``, from where it was cut off."""

    def __init__(self, case: Case, settings: Settings, *, folder: Path | None = None) -> None:
        """Start a run, or resume the one whose state is in ``folder``; None keeps nothing.

        Raises:
            LavaError: A setting is not usable, or the folder is of another case or other settings.
        """
        validation.number('--maps', settings.maps, at_least=1, at_most=10_000)
        self.case, self.settings, self._folder = case, settings, folder
        self._coarseness = settings.coarseness(case)
        self._peak = np.zeros(case.scene.terrain.shape, np.float32)
        self._wall_time = 0.0
        self._most_particles = self._maps = self._done_events = 0
        self.is_resumed = folder is not None and (folder / 'run.json').is_file()
        if folder is not None and self.is_resumed:
            self._simulation = self._resumed(folder)

    def snapshots(self) -> Iterator[tuple[float, Snapshot | None]]:
        """Simulate.

        Yields:
            The share of the time that is simulated, from time to time, and at each map a snapshot.
        """
        looked = wall_clock.monotonic()
        for snapshot in self.parts():
            if snapshot is None and wall_clock.monotonic() < looked + LOOK:
                continue
            yield self._simulation.time / self.case.duration, snapshot
            looked = wall_clock.monotonic()

    def parts(self) -> Iterator[Snapshot | None]:
        """Simulate in parts, so that others can go on while a GPU is at work.

        Yields:
            A snapshot at each map, None after the other parts.
        """
        case, maps = self.case, self.settings.maps
        changes = [max(event.time - case.start, 0.0) for event in case.events]
        times = [*(case.duration * (index / maps) for index in range(1, maps)), case.duration]
        for time in times:
            if time <= self._simulation.time:
                # a map that was kept, or that of the last step, is of this time as well
                continue
            for change in changes[self._done_events :]:
                if change < time:
                    yield from self._advancing(change, limit=change)
                    terrain = case.events[self._done_events].terrain
                    self._simulation.set_terrain(coarsened(terrain, self._coarseness))
                    self._done_events += 1
            limit = min([case.duration, *changes[self._done_events :]])
            yield from self._advancing(time, limit=limit)
            with self._timed():
                snapshot = self._snapshot()
                flaw = snapshot.flaw()
                if flaw:
                    raise LavaError('the simulated flow', flaw, 'finite numbers')
                self._add(snapshot)
            if self._folder is not None:
                self._keep(self._folder, snapshot)
            yield snapshot

    def result(self) -> Result:
        """The result so far."""
        simulation, snapshot = self._simulation, self._snapshot()
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

    def kept(self) -> list[Snapshot]:
        """The snapshots that were kept in the folder, by time."""
        folder, terrain = self._folder, self.case.scene.terrain
        assert folder is not None
        return [_read(folder / f'map_{index:04d}.npz', terrain) for index in range(self._maps)]

    @contextmanager
    def _timed(self) -> Iterator[None]:
        started = wall_clock.monotonic()
        yield
        self._wall_time += wall_clock.monotonic() - started

    def _add(self, snapshot: Snapshot) -> None:
        np.maximum(self._peak, np.nan_to_num(snapshot.thickness), out=self._peak)
        self._maps += 1

    def _snapshot(self) -> Snapshot:
        snapshot = self._simulation.snapshot()
        return refined(snapshot, self.case.scene.terrain, self._coarseness)

    @cached_property
    def _simulation(self) -> Simulation:
        # only when it is needed: it may have to be compiled first
        scene = self.case.scene
        with self._timed():
            return Simulation(
                replace(scene, terrain=coarsened(scene.terrain, self._coarseness)),
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

    def _identity(self) -> str:
        """What tells this run from any other."""
        case, settings = self.case, self.settings
        digest = hashlib.sha256(case.footprint.tobytes())
        for terrain in (case.scene.terrain, *(event.terrain for event in case.events)):
            digest.update(terrain.elevation.tobytes())
        plain = {
            'scene': scene_to_dict(case.scene),
            'span': [case.start, case.end],
            'events': [event.time for event in case.events],
            'accuracy': asdict(settings.accuracy(case)),
            'forced': dict(settings.forced),
            'maps': settings.maps,
        }
        digest.update(json.dumps(plain, sort_keys=True).encode())
        return digest.hexdigest()

    def _keep(self, folder: Path, snapshot: Snapshot) -> None:
        """Write what is needed to go on; the last file to be replaced makes it count."""
        plain = {
            'identity': self._identity(),
            'maps': self._maps,
            'events': self._done_events,
            'wall_time': self._wall_time,
            'most_particles': self._most_particles,
        }
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _write(folder / f'map_{self._maps - 1:04d}.npz', snapshot)
            checkpoint = self._simulation.checkpoint().to_bytes()
            write_output('output', folder / f'checkpoint_{self._maps:04d}', checkpoint)
            write_output('output', folder / 'run.json', json.dumps(plain))
            (folder / f'checkpoint_{self._maps - 1:04d}').unlink(missing_ok=True)
        except OSError as error:
            raise LavaError('output', str(folder), f'a folder to write to ({error})') from error

    def _resumed(self, folder: Path) -> Simulation:
        try:
            plain = json.loads((folder / 'run.json').read_text(encoding='utf-8'))
            if plain['identity'] != self._identity():
                right = 'a folder without an unfinished run of another case or of other settings; '
                right += '--fresh starts anew'
                raise LavaError('output', str(folder.parent), right)
            self._maps = int(plain['maps'])
            checkpoint = from_bytes((folder / f'checkpoint_{self._maps:04d}').read_bytes())
        except LavaError:
            raise
        except (OSError, KeyError, ValueError) as error:
            right = f'a complete unfinished run; --fresh starts anew ({error})'
            raise LavaError('output', str(folder), right) from error
        for snapshot in self.kept():
            np.maximum(self._peak, np.nan_to_num(snapshot.thickness), out=self._peak)
        self._wall_time = float(plain['wall_time'])
        self._most_particles = int(plain['most_particles'])
        self._done_events = int(plain['events'])
        return Simulation.resume(checkpoint, device=self.settings.device)


def simulate(case: Case, settings: Settings) -> Result:
    """Run a case to its end, and keep nothing."""
    run = Run(case, replace(settings, maps=1))
    for _ in run.parts():
        pass
    return run.result()


def _write(path: Path, snapshot: Snapshot) -> None:
    plain = {
        'time': snapshot.time,
        'budget': asdict(snapshot.budget),
        'steps': asdict(snapshot.steps),
        'particle_count': snapshot.particle_count,
    }
    with replacing(path) as partial:
        data = np.frombuffer(json.dumps(plain).encode(), np.uint8)
        np.savez_compressed(partial, plain=data, **grids_of(snapshot))  # type: ignore[arg-type]


def _read(path: Path, terrain: Terrain) -> Snapshot:
    try:
        arrays = read_arrays('output', path)
        plain = json.loads(arrays['plain'].tobytes())
        return Snapshot(
            time=plain['time'],
            terrain=terrain,
            budget=VolumeBudget(**plain['budget']),
            particle_count=plain['particle_count'],
            steps=StepReport(**plain['steps']),
            **{name: arrays[name] for name in GRIDS if name in arrays},
        )
    except (OSError, KeyError, TypeError, ValueError) as error:
        right = f'a map of an earlier run; --fresh starts anew ({error})'
        raise LavaError('output', str(path), right) from error
