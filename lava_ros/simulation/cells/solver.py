# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The solver on cells behind a simulation, with the methods of the solver of particles.

It runs on a CPU, in one thread.
"""

from collections.abc import Generator
from dataclasses import replace
from functools import lru_cache
import math
import time as wall_clock
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import EFFECTS, Effects, load
from lava_ros.effects.laws import Rheology
from lava_ros.errors import LavaError
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.cells.covered import Covered, note_function
from lava_ros.simulation.cells.flow import step_function
from lava_ros.simulation.cells.grid import deposit, grid_of, on_terrain
from lava_ros.simulation.cells.state import (
    Cells,
    CellState,
    EVALUATIONS,
    FULL,
    LENGTH,
    LONGEST,
    MAX_END,
    STAGES,
    STEPS,
    TARGET,
    THICKEST,
    TIME,
    UNTIL,
    WAITING,
)
from lava_ros.simulation.cells.vents import CellVents
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.checkpoint_contents import check_conserved, check_contents
from lava_ros.simulation.output.covered_maps import CoveredCells, show_covered_cells
from lava_ros.simulation.output.diagnostics import SHOWN
from lava_ros.simulation.output.looks import Looks, Seen
from lava_ros.simulation.output.snapshot import (
    Particles,
    ParticleSample,
    PendingSnapshot,
    Snapshot,
    StepReport,
)
from lava_ros.simulation.output.window import Window
from lava_ros.simulation.particles.layout import BORDER, centre_of, fitting, HOLES, SEA
from lava_ros.simulation.particles.terrain import averaged
from lava_ros.simulation.stop import Stop

#: Thickness below which lava does not flow, over the expected thickness of the flow.
FILM = 1e-6

#: Wall time of a launch to aim at [s].
_LAUNCH_TIME = 0.02

#: Parts of an effect that particles have and cells lack.
_MISSING = (
    'terms', 'relaxed', 'warmed', 'compute_velocity', 'accelerate', 'move_particles', 'AfterStep',
)

#: Arrays and times of the state in checkpoints.
_SAVED = ('thickness', 'flux_x', 'flux_y', 'left', 'counts', 'peaks')
_TIMES = [TIME, LENGTH, FULL]


def check_effects(effects: Effects) -> None:
    """Raise LavaError, naming the effect, if one is on that cells do not have."""
    for name in effects:
        effect = EFFECTS[name]
        is_missing = effect.needs_velocity or effect.is_lateral or effect.removes_particles
        is_missing |= effect.needs_age or any(hasattr(load(name), part) for part in _MISSING)
        if is_missing:
            raise LavaError(
                f'effects.{name}', True, 'false with method cells; method: particles has it'
            )


@lru_cache
def _kernel(effects: Effects) -> Any:
    step, note = step_function(effects, is_uniform=True), note_function()

    @wp.kernel(
        module='unique', enable_backward=False, grid_stride=False,
        module_options={'enable_backward': False},
    )
    def take_steps(s: Cells, c: Covered, most: int):
        for _ in range(most):
            if s.clock[TIME] >= s.clock[TARGET] or s.clock[WAITING] > wp.float64(0.0):
                break
            step(s)
            if s.clock[WAITING] == wp.float64(0.0):
                note(s, c)

    return take_steps


@lru_cache
def _note_kernel() -> Any:
    note = note_function()

    @wp.kernel(module='unique', enable_backward=False, grid_stride=False)
    def note_lava(s: Cells, c: Covered):
        note(s, c)

    return note_lava


class _Maps:
    """Arrays of the terrain's cells (``layout.CELL_MAPS``), and the launches over them."""

    extent = 0

    def __init__(self, device: Any) -> None:
        self.device, self.launches = device, Launches(device)


class CellSolver:
    """Lava on cells, with vents and kernels.

    Attributes:
        scene: The current scene.
        effects: The effects that are on.
        accuracy: The resolution, without automatic values.
        device: The Warp device, a CPU.
        grid: The ground on the solver's cells.
        state: Arrays of the cells, and the clock.
        covered: What lava has covered of each cell of the terrain.
        vents: The vents on the cells.
        volume_before: Volume on the terrain at the start, and of vents that have closed [m3].
        temperature: Temperature of the lava [K].
        most_particles: Largest number of cells with lava at any count so far.
    """

    def __init__(
        self, scene: Scene, effects: Effects, accuracy: Accuracy, device: wp.Device
    ) -> None:
        """Allocate the arrays; there are no vents yet.

        Args:
            scene: Terrain, vents and lava.
            effects: The effects that are on.
            accuracy: The resolution, without automatic values.
            device: The Warp device.

        Raises:
            LavaError: If the device is a GPU, or an effect is on that cells do not have.
        """
        if device.is_cuda:
            raise LavaError('device', str(device), 'cpu with method cells')
        check_effects(effects)
        self.scene, self.effects, self.accuracy, self.device = scene, effects, accuracy, device
        assert accuracy.thickness is not None
        self._film = FILM * min(accuracy.thickness, 1.0)
        self.volume_before, self.most_particles = 0.0, 0
        self.temperature = scene.lava.reference_temperature
        self._end, self._steps_at_once = math.inf, 16
        self._maps = _Maps(device)
        self.covered = CoveredCells(scene.terrain, device)
        self._place_terrain()

    def _place_terrain(self, former: CellState | None = None) -> None:
        """Make the arrays of the grid for the terrain of the scene."""
        terrain, lava = self.scene.terrain, self.scene.lava
        assert self.accuracy.spacing is not None
        self.grid = grid_of(terrain, self.accuracy.spacing)
        cosine = self.effects.function('cosine', 0.0) is not None
        self.state = CellState.on(
            self.grid, self.device, lava=lava, weight=lava.density * self.scene.gravity,
            film=self._film, cosine_squared=self._cosine_squared if cosine else None,
        )
        if former is not None:
            self.state.clock.assign(former.clock)
            self.state.counts.assign(former.counts)
        self._is_set = False
        shape = (2 + len(SHOWN), *terrain.shape)
        self.grids = wp.zeros(shape, dtype=wp.float32, device=self.device)
        self.grids.numpy()[:, ~terrain.has_data] = np.nan
        self.grids.numpy()[-2:] = np.nan
        self._window = Window(terrain.shape, 2)
        self._known = wp.array(
            terrain.has_data.astype(np.uint8), dtype=wp.uint8, device=self.device
        )
        self.covered.move(terrain, None, self.accuracy.inundation_threshold)
        self.covered.attach(self._maps)

    def _cosine_squared(self, slope: np.ndarray) -> np.ndarray:
        return np.square(self.effects.function('cosine', slope))

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.state.clock.numpy()[TIME])

    @property
    def steps(self) -> int:
        """Number of time steps so far."""
        return int(self.state.counts.numpy()[STEPS])

    @property
    def count(self) -> int:
        """Number of cells with lava that flows."""
        count = int((self.state.thickness.numpy() > self._film).sum())
        self.most_particles = max(self.most_particles, count)
        return count

    @property
    def particle_volume(self) -> float:
        """Volume of lava of the expected thickness on a cell [m3]."""
        assert self.accuracy.thickness is not None
        return self.grid.resolution**2 * self.accuracy.thickness

    @property
    def column_spacing(self) -> float:
        """Distance between the columns into which emplaced lava is divided [m]."""
        return 0.25 * self.grid.resolution

    @property
    def capacity(self) -> int:
        """Number of cells."""
        return int(self.state.thickness.size)

    @property
    def radius(self) -> float:
        """Distance between cells that exchange lava [m]."""
        return self.grid.resolution

    @property
    def is_bare(self) -> bool:
        """True if no cell has lava that flows."""
        return bool(self.state.peaks.numpy()[THICKEST] <= self._film)

    def start_with(self, particles: Particles | None) -> None:
        """Place the initial lava, and open the vents of the scene.

        Raises:
            LavaError: If lava is not on the terrain, or has several temperatures.
        """
        if particles is not None and len(particles.position):
            for index in np.flatnonzero(~self.scene.terrain.covered(particles.position))[:1]:
                where = tuple(particles.position[index].tolist())
                raise LavaError(f'particles.position[{index}]', where, 'a place on the terrain')
            volumes = np.asarray(particles.volume)
            self._put(deposit(self.grid, particles.position, volumes) / self.grid.resolution**2)
            self.volume_before = float(volumes.sum())
        self.open_vents(0.0, () if particles is None else np.unique(particles.temperature))
        self._note()

    def open_vents(self, since: float, temperatures: Any = ()) -> None:
        """Put the vents of the scene on the cells.

        Args:
            since: Simulated time from which they emit [s].
            temperatures: Temperatures of the lava that is there [K].

        Raises:
            LavaError: If the lava has several temperatures.
        """
        assert self.accuracy.thickness is not None
        found = {float(item) for item in temperatures}
        found |= {vent.temperature for vent in self.scene.vents}
        if len(found) > 1:
            expected = 'one temperature of all lava with method cells; method: particles'
            raise LavaError('vents.temperature', sorted(found), expected)
        if found:
            self.temperature = found.pop()
        self.vents = CellVents(
            self.scene.vents, self.grid, since, rise=self.accuracy.thickness
        )
        self._is_set = False

    def _put(self, thickness: np.ndarray) -> None:
        """Replace the lava [m], shape of the grid."""
        state, ringed = self.state, np.pad(thickness, 1)
        state.thickness.assign(ringed)
        state.stage.assign(ringed.astype(np.float32))
        state.peaks.assign([float(thickness.max(initial=0.0)), 0.0])
        self._is_set = False

    def _set(self, time: float) -> None:
        """Write the rates of emission from a time [s], the window, and the laws of flow."""
        state, area = self.state, self.grid.resolution**2
        source = np.zeros(self.grid.shape)
        for (cells, parts), rate in zip(self.vents.weights, self.vents.rates(time), strict=True):
            source.ravel()[cells] += parts * (rate / area)
        ringed = np.pad(source, 1)
        state.source.assign(ringed)
        vents = _box_of(ringed > 0.0)
        state.vent_box.assign(vents)
        wet = _box_of((ringed > 0.0) | (state.thickness.numpy() > 0.0))
        if wet[1] >= wet[0]:
            last = np.repeat(np.array(ringed.shape, dtype=np.int32) - 1, 2)
            wet = np.clip(wet + np.array([-2, 2, -2, 2], dtype=np.int32), 0, last)
        state.box.assign(wet)
        rheology = Rheology(self.scene.lava, self.effects)
        state.fluidity.fill_(1.0 / rheology.viscosity_at(self.temperature))
        state.strength.fill_(rheology.strength_at(self.temperature))
        self._argument = state.argument()
        covered = Covered()
        covered.rows, covered.columns = self.scene.terrain.shape
        covered.scale = self.scene.terrain.resolution / self.grid.resolution
        covered.threshold = self.accuracy.inundation_threshold
        covered.known = self._known
        for name, array in self.covered.maps.items():
            setattr(covered, name, array)
        self._covered = covered
        self._is_set = True

    def advancing_to(
        self, until: float, end: float | None, deadline: float, max_end: float = math.inf
    ) -> Generator[None, None, Stop]:
        """Advance to a time, as ``advance.advancing_to``; no step is ever incomplete."""
        self._end = self._end if end is None else end
        clock = self.state.clock.numpy()
        clock[WAITING] = 0.0
        kernel = _kernel(self.effects)
        while clock[TIME] < until and wall_clock.monotonic() < deadline:
            time = float(clock[TIME])
            change = self.vents.next_change(time)
            if not self._is_set:
                self._set(time)
            stop = min(self._end, change)
            clock[LONGEST], clock[MAX_END] = self.accuracy.longest_step, max_end
            clock[UNTIL], clock[TARGET] = stop, min(until, stop)
            if self.is_bare and not self.vents.rates(time).any():
                # nothing moves
                clock[TIME] = min(until, stop)
            else:
                begun, before = wall_clock.perf_counter(), self.steps
                wp.launch(
                    kernel, dim=1, inputs=[self._argument, self._covered, self._steps_at_once],
                    device=self.device,
                )
                taken = max(self.steps - before, 1)
                spent = (wall_clock.perf_counter() - begun) / taken
                self._steps_at_once = min(max(int(_LAUNCH_TIME / spent), 1), 4096)
                if clock[WAITING] > 0.0:
                    break
            if clock[TIME] >= change:
                self._is_set = False
            yield
        is_waiting = bool(clock[WAITING] > 0.0)
        step = clock[WAITING] if is_waiting else clock[FULL]
        clock[WAITING] = 0.0
        return Stop(float(clock[TIME]), float(step), is_waiting)

    def _note(self) -> None:
        """Record the ground that lava covers now."""
        if not self._is_set:
            self._set(self.time)
        wp.launch(
            _note_kernel(), dim=1, inputs=[self._argument, self._covered], device=self.device
        )

    # what the solver of particles does between steps, and cells need not

    def order(self) -> None:
        """Do nothing: cells have an order."""

    sort = settle = forget = lower_top = order

    def raise_top(self, *, until: float | None = None) -> None:
        """Do nothing: the speed has no bound of free fall."""

    def rest(self, until: float, end: float) -> None:
        """Do nothing: ``advancing_to`` skips the time without lava."""

    def check_rates(self, vents: tuple[Any, ...]) -> None:
        """Accept any discharge."""

    def add_particles(self, rows: list[Any]) -> None:
        """Do nothing: no lava waits in conduits."""

    def switch_effects(self, effects: Effects) -> None:
        """Continue with other effects.

        Raises:
            LavaError: If cells do not have one of them.
        """
        check_effects(effects)
        is_steep = self.effects.function('cosine', 0.0) is not None
        self.effects, self._is_set = effects, False
        if (effects.function('cosine', 0.0) is not None) != is_steep:
            self._replace_grid()

    def _replace_grid(self) -> None:
        """Make the arrays of the grid again, with the same lava."""
        former, thickness = self.state, self.state.map_of('thickness')
        self._place_terrain(former)
        self.state.left.assign(former.left)
        self._put(thickness)

    def replace_vents(self, scene: Scene) -> list[Any]:
        """Continue with the vents of another scene."""
        now, former, before = self.time, self.vents, self.scene
        temperatures = {self.temperature} if self.volume_before or former.emitted(now) else ()
        self.scene = scene
        try:
            self.open_vents(now, temperatures)
        except LavaError:
            self.scene = before
            raise
        self.volume_before += former.emitted(now)
        self._note()
        return []

    def replace_terrain(self, scene: Scene) -> None:
        """Replace the terrain by that of another scene; lava outside it has left."""
        now, former, grid = self.time, self.state, self.grid
        volume, area = self.state.map_of('thickness'), grid.resolution**2
        self.volume_before += self.vents.emitted(now)
        self.scene = scene
        self._place_terrain(former)
        moved = averaged(volume, grid, self.grid)
        left = former.left.numpy() * area
        new = self.grid.resolution**2
        left[BORDER] += max(volume.sum() * area - moved.sum() * new, 0.0)
        for place, cells in ((SEA, self.grid.is_sea), (HOLES, np.isnan(self.grid.elevation))):
            left[place] += moved[cells].sum() * new
            moved[cells] = 0.0
        self.state.left.assign(left / new)
        self._put(moved)
        self.open_vents(now, {self.temperature})
        self._note()

    def emitted_fraction(self, until: float) -> float:
        """Return the volume of all lava so far over that at a later time [s]."""
        volume = self.volume_before + self.vents.emitted(self.time)
        later = sum(vent.volume_between(self.time, until) for vent in self.scene.vents)
        return float(volume / max(volume + later, 1e-30))

    def draw_maps(self) -> Any:
        """Map the flow to the terrain; return thickness, temperature and ``SHOWN``."""
        terrain, maps = self.scene.terrain, self.grids.numpy()
        thickness = on_terrain(self.state.map_of('thickness'), self.grid, terrain)
        thickness = thickness.astype(np.float32)
        known = terrain.has_data
        maps[0][known] = thickness[known]
        maps[1] = np.where(known & (thickness > 0.0), np.float32(self.temperature), np.nan)
        show_covered_cells(
            self._maps, self.grids[-len(SHOWN) :], self._window
        )
        return self.grids

    def begin_snapshot(self, *, beside: bool) -> PendingSnapshot:
        """Map the flow."""
        maps, terrain, budget = self.draw_maps().numpy().copy(), self.scene.terrain, self.budget()
        inundated, half_inundated, arrived = maps[-len(SHOWN) :]
        thin = np.sum(maps[0], where=np.isnan(arrived) & (maps[0] > 0.0), dtype=np.float64)
        counts, clock = self.state.counts.numpy(), self.state.clock.numpy()
        snapshot = Snapshot(
            time=self.time, terrain=terrain, thickness=maps[0], temperature=maps[1],
            budget=replace(budget, thin=float(thin) * terrain.resolution**2),
            particle_count=self.count,
            steps=StepReport(
                count=int(counts[STEPS]), evaluations=int(counts[EVALUATIONS]),
                stages=int(counts[STAGES]), length=float(clock[FULL]), limit='diffusion',
            ),
            arrived=arrived, half_inundated=half_inundated, inundated=inundated,
            threshold=self.accuracy.inundation_threshold,
        )
        return PendingSnapshot(lambda: snapshot)

    def budget(self) -> VolumeBudget:
        """Return the budget of the lava's volume."""
        area = self.grid.resolution**2
        left = self.state.left.numpy() * area
        return VolumeBudget(
            emitted=self.volume_before + self.vents.emitted(self.time),
            held=float(self.state.thickness.numpy().sum()) * area, pending=0.0,
            left=float(left.sum()), in_holes=float(left[HOLES]), in_sea=float(left[SEA]),
        )

    def look(self, looks: Looks) -> None:
        """Add the current flow to looks."""
        self.draw_maps()
        looks.take(self._maps, self._known, self)

    @property
    def window(self) -> Window:
        """The cells of the terrain that lava can reach."""
        return self._window

    def seen(self, looks: Looks, *, where_wet: bool) -> Seen:
        """Return the results of looks so far."""
        part = slice(0, self._known.shape[0]), slice(0, self._known.shape[1])
        if where_wet:
            part = self._window.rectangle(self._maps)
        return looks.seen(self._maps, part)

    def sample(self) -> ParticleSample:
        """Return the cells with lava as columns at their middles."""
        grid, thickness = self.grid, self.state.map_of('thickness')
        i, j = np.nonzero(thickness > self._film)
        own = thickness[i, j]
        per_time = grid.resolution / max(float(self.state.clock.numpy()[LENGTH]), 1e-30)
        east, north = self.state.flux_x.numpy(), self.state.flux_y.numpy()
        # faces on both sides of the cell, which has a ring around it
        passed = np.stack([
            east[i + 1, j] + east[i + 1, j + 1], north[i, j + 1] + north[i + 1, j + 1]
        ], axis=1)
        return ParticleSample(
            position=np.column_stack([j + 0.5, i + 0.5]) * grid.resolution + grid.origin,
            volume=own * grid.resolution**2,
            temperature=np.full(len(own), self.temperature),
            thickness=own,
            velocity=0.5 * passed * per_time / own[:, None],
        )

    read_sample = sample

    def save(self) -> dict[str, np.ndarray]:
        """Copy all arrays that are needed to continue, by name."""
        sample = self.sample()
        state = self.state
        rows = np.column_stack([
            sample.position - centre_of(self.scene.terrain), sample.volume, sample.temperature
        ])
        return {
            'state.particle': rows,
            'cells.clock': state.clock.numpy()[_TIMES],
            'cells.temperature': np.array([self.temperature]),
            **{f'cells.{name}': getattr(state, name).numpy().copy() for name in _SAVED},
            **{f'arrived.{name}': item for name, item in self.covered.save().items()},
        }

    def load(self, checkpoint: Checkpoint) -> None:
        """Continue from a checkpoint.

        Raises:
            LavaError: If an array is missing, or does not belong to the scene and the accuracy.
        """
        check_contents(checkpoint)
        state, arrays = self.state, dict(checkpoint.arrays)
        for name in _SAVED:
            array = getattr(state, name)
            array.assign(fitting(
                f'cells.{name}', arrays.pop(f'cells.{name}', None), array.shape,
                array.numpy().dtype,
            ))
        if state.thickness.numpy().min() < 0.0:
            raise LavaError('checkpoint.cells.thickness', 'a negative thickness', 'thicknesses')
        state.stage.assign(state.thickness.numpy().astype(np.float32))
        state.clock.numpy()[_TIMES] = fitting(
            'cells.clock', arrays.pop('cells.clock', None), (len(_TIMES),), np.float64
        )
        self.temperature = float(fitting(
            'cells.temperature', arrays.pop('cells.temperature', None), (1,), np.float64
        )[0])
        del arrays['state.particle']
        arrived = {
            name.removeprefix('arrived.'): arrays.pop(name) for name in [*arrays]
            if name.startswith('arrived.')
        }
        if arrived:
            self.covered.load(arrived)
        if arrays:
            raise LavaError('checkpoint.arrays', sorted(arrays), 'those of a simulation')
        if self.time != checkpoint.time:
            expected = f'that of the clock, {self.time:g} s'
            raise LavaError('checkpoint.time', checkpoint.time, expected)
        self.volume_before = checkpoint.emitted
        self.open_vents(checkpoint.since, {self.temperature})
        if not arrived:
            self._note()
        check_conserved(self.budget())


def _box_of(cells: np.ndarray) -> np.ndarray:
    """Return first and last row and column of marked cells; without any the last is before."""
    ends = []
    for axis in (1, 0):
        found = np.flatnonzero(cells.any(axis=axis))
        ends += [found[0], found[-1]] if found.size else [0, -1]
    return np.array(ends, dtype=np.int32)
