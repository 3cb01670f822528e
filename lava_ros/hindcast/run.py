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


"""Runs a case, map by map, and goes on where an earlier run was cut off."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
import hashlib
import json
from pathlib import Path
import time as wall_clock
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files import replacing, write_output
from lava_ros.files.npz import read_arrays
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.coarse import coarsened, GRIDS, refined
from lava_ros.scene import scene_to_dict
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.budget import VolumeBudget
from lava_ros.simulation.checkpoint import from_bytes
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import Resolution, resolved_accuracy
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
    that are not forced on or off are chosen from the scene. Maps are even over the simulated time.
    ``courant`` is the largest displacement in a step over a cell, where the preset has the usual
    one.
    """

    preset: str = DEFAULT
    spacing: float | None = None
    device: str | None = None
    forced: Mapping[str, bool] = field(default_factory=dict)
    maps: int = MAPS
    courant: float = COURANT

    def accuracy(self, case: Case) -> Accuracy:
        """The accuracy of a case: the preset's, with longer steps, and deterministic."""
        accuracy = replace(preset_accuracy(self.preset), spacing=self.spacing)
        courant = accuracy.courant_number
        if courant == Accuracy().courant_number:
            courant = self.courant
        # a flow that forks goes the same way again, on a GPU too
        accuracy = replace(accuracy, courant_number=courant, deterministic=True)
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
    it. ``accuracy`` has every automatic value filled in.
    """

    snapshot: Snapshot
    peak: np.ndarray
    wall_time: float
    most_particles: int
    effects: tuple[str, ...]
    accuracy: Accuracy
    resolution: Resolution
    device: str


class Run:
    """A case on its way, from its start or, if ``is_resumed``, from where it was cut off."""

    def __init__(self, case: Case, settings: Settings, *, folder: Path | None = None) -> None:
        """Start a run, or resume the one whose state is in ``folder``; None keeps nothing.

        Raises:
            LavaError: A setting is not usable, or the folder is of another case or other settings.
        """
        validation.number('--maps', settings.maps, at_least=1, at_most=10_000)
        self.case, self.settings = case, settings
        self._coarseness = settings.coarseness(case)
        self._folder = folder
        self._simulation: Simulation | None = None
        self._peak = np.zeros(case.scene.terrain.shape, np.float32)
        self._wall_time = 0.0
        self._most_particles = self._maps = self._done_events = 0
        self.is_resumed = folder is not None and (folder / 'run.json').is_file()
        if folder is not None and self.is_resumed:
            self._go_on(folder)

    def snapshots(self) -> Iterator[tuple[float, Snapshot | None]]:
        """Simulate.

        Yields:
            The share of the time that is simulated, from time to time, and at each map a snapshot.
        """
        looked = wall_clock.monotonic()
        for snapshot in self.parts():
            if snapshot is None and wall_clock.monotonic() < looked + LOOK:
                continue
            yield self._prepared().time / self.case.duration, snapshot
            looked = wall_clock.monotonic()

    def parts(self) -> Iterator[Snapshot | None]:
        """Simulate in parts, so that others can go on while a GPU is at work.

        Yields:
            A snapshot at each map, None after the other parts.
        """
        case, duration = self.case, self.case.duration
        simulation = self._prepared()
        maps = self.settings.maps
        times = [duration * (index + 1) / maps for index in range(maps)]
        for time in times[self._maps :]:
            changes = [
                (event.time - case.start, event) for event in case.events[self._done_events :]
            ]
            for when, event in [item for item in changes if item[0] < time]:
                yield from self._advancing(simulation, max(when, 0.0))
                simulation.set_terrain(coarsened(event.terrain, self._coarseness))
                self._done_events += 1
            yield from self._advancing(simulation, time)
            started = wall_clock.monotonic()
            snapshot = self._snapshot(simulation)
            flaw = snapshot.flaw()
            if flaw:
                raise LavaError('the simulated flow', flaw, 'finite numbers')
            self._add(snapshot)
            self._wall_time += wall_clock.monotonic() - started
            if self._folder is not None:
                self._keep(self._folder, simulation, snapshot)
            yield snapshot

    def result(self) -> Result:
        """The result so far."""
        simulation = self._prepared()
        return Result(
            snapshot=self._snapshot(simulation),
            peak=self._peak,
            wall_time=self._wall_time,
            most_particles=self._most_particles,
            effects=tuple(simulation.effects),
            accuracy=simulation.accuracy,
            resolution=simulation.resolution,
            device=simulation.device,
        )

    def kept(self) -> list[Snapshot]:
        """The snapshots that were kept in the folder, by time."""
        assert self._folder is not None
        return list(self._read_maps(self._folder, self._maps))

    def _read_maps(self, folder: Path, count: int) -> Iterator[Snapshot]:
        for index in range(count):
            yield _read(folder / f'map_{index:04d}.npz', self.case.scene.terrain)

    def _add(self, snapshot: Snapshot) -> None:
        np.maximum(self._peak, np.nan_to_num(snapshot.thickness), out=self._peak)
        self._maps += 1

    def _snapshot(self, simulation: Simulation) -> Snapshot:
        return refined(simulation.snapshot(), self.case.scene.terrain, self._coarseness)

    def _prepared(self) -> Simulation:
        if self._simulation is None:
            started = wall_clock.monotonic()
            scene = self.case.scene
            self._simulation = Simulation(
                replace(scene, terrain=coarsened(scene.terrain, self._coarseness)),
                effects={**FORCED, **self.settings.forced},
                accuracy=self.settings.accuracy(self.case),
                device=self.settings.device,
                horizon=self.case.duration,
                notes_arrival=True,
            )
            self._wall_time += wall_clock.monotonic() - started
        return self._simulation

    def _advancing(self, simulation: Simulation, until: float) -> Iterator[None]:
        started = wall_clock.monotonic()
        for _ in simulation.advancing(until):
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

    def _keep(self, folder: Path, simulation: Simulation, snapshot: Snapshot) -> None:
        """Write what is needed to go on; the last file to be replaced makes it count."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _write(folder / f'map_{self._maps - 1:04d}.npz', snapshot)
            name = f'checkpoint_{self._maps:04d}'
            write_output('output', folder / name, simulation.checkpoint().to_bytes())
            plain = {
                'identity': self._identity(),
                'maps': self._maps,
                'events': self._done_events,
                'wall_time': self._wall_time,
                'most_particles': self._most_particles,
            }
            write_output('output', folder / 'run.json', json.dumps(plain))
            (folder / f'checkpoint_{self._maps - 1:04d}').unlink(missing_ok=True)
        except OSError as error:
            raise LavaError('output', str(folder), f'a folder to write to ({error})') from error

    def _go_on(self, folder: Path) -> None:
        try:
            plain = json.loads((folder / 'run.json').read_text(encoding='utf-8'))
            if plain['identity'] != self._identity():
                right = 'a folder without an unfinished run of another case or of other settings; '
                right += '--fresh starts anew'
                raise LavaError('output', str(folder.parent), right)
            maps = int(plain['maps'])
            checkpoint = from_bytes((folder / f'checkpoint_{maps:04d}').read_bytes())
        except (OSError, KeyError, ValueError) as error:
            if isinstance(error, LavaError):
                raise
            right = f'a complete unfinished run; --fresh starts anew ({error})'
            raise LavaError('output', str(folder), right) from error
        self._wall_time = float(plain['wall_time'])
        self._most_particles = int(plain['most_particles'])
        for snapshot in self._read_maps(folder, maps):
            self._add(snapshot)
        self._done_events = int(plain['events'])
        self._simulation = Simulation.resume(checkpoint, device=self.settings.device)


def simulate(case: Case, settings: Settings) -> Result:
    """Run a case to its end, and keep nothing."""
    run = Run(case, replace(settings, maps=1))
    for _ in run.snapshots():
        pass
    return run.result()


def _write(path: Path, snapshot: Snapshot) -> None:
    grids = {name: getattr(snapshot, name) for name in GRIDS}
    plain: dict[str, Any] = {
        'time': snapshot.time,
        'budget': asdict(snapshot.budget),
        'steps': asdict(snapshot.steps),
        'particle_count': snapshot.particle_count,
    }
    with replacing(path) as partial:
        np.savez_compressed(
            partial,
            plain=np.frombuffer(json.dumps(plain).encode(), np.uint8),
            **{name: grid for name, grid in grids.items() if grid is not None},
        )


def _read(path: Path, terrain: Any) -> Snapshot:
    try:
        arrays = read_arrays('output', path)
        plain = json.loads(arrays['plain'].tobytes())
        return Snapshot(
            time=plain['time'],
            terrain=terrain,
            thickness=arrays['thickness'],
            temperature=arrays['temperature'],
            budget=VolumeBudget(**plain['budget']),
            particle_count=plain['particle_count'],
            steps=StepReport(**plain['steps']),
            frozen=arrays.get('frozen'),
            arrived=arrays.get('arrived'),
        )
    except (OSError, KeyError, ValueError) as error:
        right = f'a map of an earlier run; --fresh starts anew ({error})'
        raise LavaError('output', str(path), right) from error
