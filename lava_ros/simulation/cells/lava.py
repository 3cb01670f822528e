# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The lava of a simulation on cells: its arrays, and what others read of them."""

from collections.abc import Iterator
from dataclasses import replace
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.laws import Rheology
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.backend.memory import bytes_per_cell, read, read_parts, write_part
from lava_ros.simulation.cells.cell_size import doublings_of
from lava_ros.simulation.cells.columns import Columns
from lava_ros.simulation.cells.covered import Covered
from lava_ros.simulation.cells.grid import (
    cells_under,
    fraction_with_data,
    grid_of,
    on_terrain,
    Part,
    within_ring,
)
from lava_ros.simulation.cells.ground import lay_ground
from lava_ros.simulation.cells.heat import HeatState, hottest_of
from lava_ros.simulation.cells.highest import Highest
from lava_ros.simulation.cells.peaks import CellPeaks
from lava_ros.simulation.cells.state import (
    BOUNDS,
    BOX,
    Cells,
    CellState,
    EVALUATIONS,
    FACES,
    FULL,
    Heat,
    LATERAL,
    LEFT,
    STAGES,
    STEPS,
    TIME,
    UNREACHED,
)
from lava_ros.simulation.cells.vents import CellVents
from lava_ros.simulation.output.budget import lost_volumes, VolumeBudget
from lava_ros.simulation.output.covered_maps import box_of, CoveredCells, show_covered_cells
from lava_ros.simulation.output.diagnostics import Moment, SHOWN, snapshot_of
from lava_ros.simulation.output.peaks import PeakMaps, Peaks
from lava_ros.simulation.output.snapshot import (
    ParticleSample,
    PendingSnapshot,
    StepReport,
)
from lava_ros.simulation.output.window import Window
from lava_ros.simulation.particles.terrain import known_on

#: Thickness below which lava does not flow, over the expected thickness of the flow up to 1 m.
FILM = 1e-6

#: Thickness up to which lava is a rounding error of the fluxes and not on maps, over the mean of a
#: map: all of it together is at most this fraction of the volume.
DUST = 1e-9


#: Maps that simulations on the same terrain share.
_SHARED = 'kind', 'elevation', 'known'


class _Maps:
    """Arrays of the terrain's cells (``layout.CELL_MAPS``), and the launches over them."""

    extent = 0

    def __init__(self, device: Any) -> None:
        self.device, self.launches = device, Launches(device)


class CellLava:
    """Lava on cells.

    Attributes:
        scene: The current scene.
        effects: The effects that are on.
        accuracy: The resolution, without automatic values.
        device: The Warp device.
        grid: The ground on the solver's cells.
        state: Arrays of the flow, and the clock.
        heat: Temperature and age of the lava, and the ground that it has become.
        covered: What lava has covered of each cell of the terrain.
        peaks: Largest thickness and highest temperature of each cell, which steps update.
        vents: The vents on the cells.
        clock: Times of the latest step and the limits of the next (``CellState``) [s].
        counts: Numbers of steps and stages (``CellState``).
        thickest: Largest thickness of the lava [m].
        volume_before: Volume on the terrain at the start, and of vents that have closed [m3].
        most_particles: Largest number of cells with lava at any count so far.
        keeps_peaks: True: steps raise ``peaks``.
    """

    vents: CellVents
    keeps_peaks = True

    def __init__(
        self, scene: Scene, effects: Effects, accuracy: Accuracy, device: wp.Device
    ) -> None:
        """Allocate the arrays; arguments as for ``CellSolver``."""
        self.scene, self.effects, self.accuracy, self.device = scene, effects, accuracy, device
        assert accuracy.thickness is not None
        self._film = FILM * min(accuracy.thickness, 1.0)
        self.volume_before, self.most_particles = 0.0, 0
        self.clock, self.counts, self.thickest = np.zeros(9), np.zeros(4, dtype=int), 0.0
        #: Latest report of a launch (``worlds``), None if the lava has changed otherwise since.
        self._report: np.ndarray | None = None
        self._maps = _Maps(device)
        self.covered = CoveredCells(scene.terrain, device)
        self._place_terrain()

    @staticmethod
    def bytes_for(scene: Scene, effects: Effects, accuracy: Accuracy, volume: float) -> int:
        """Return the memory of a simulation without lava, as ``ParticleLava.bytes_for``."""
        del volume
        assert accuracy.spacing is not None
        terrain, scale = scene.terrain, 2.0 ** -doublings_of(scene.terrain, accuracy.spacing)
        own = math.prod(scale * side + 2.0 for side in terrain.shape)
        per_cell = bytes_per_cell(Covered, without=_SHARED)
        shared = _SHARED if effects.any('freezes') else (*_SHARED, *FACES)
        shared = shared if effects.any('is_lateral') else (*shared, *LATERAL)
        own *= bytes_per_cell(Cells, Heat, Highest, without=shared)
        return math.ceil(own) + terrain.elevation.size * per_cell

    def _place_terrain(self) -> None:
        """Make the arrays of the grid for the terrain of the scene."""
        terrain = self.scene.terrain
        assert self.accuracy.spacing is not None
        self.grid = grid_of(terrain, self.accuracy.spacing)
        if self.grid.resolution != self.accuracy.spacing:
            # on another terrain, the size of its cells that is nearest to the previous size
            self.accuracy = replace(self.accuracy, spacing=self.grid.resolution)
        self._fraction_with_data = fraction_with_data(terrain, self.grid)
        lava = self.scene.lava
        self.state = CellState(
            self.grid, self.device, lava=lava, weight=lava.density * self.scene.gravity,
            film=self._film,
        )
        self.heat = HeatState(self.state, self.scene, self.effects, self.accuracy)
        self.peaks = CellPeaks((self.state.rows, self.state.stride), self.device)
        self._grids: Any = None
        self.window = Window(terrain.shape, 2)
        self._known = known_on(terrain, self.device)
        self._rows_with_vents = 0

    def _cover(self) -> None:
        """Continue to record what lava covers on the cells of the terrain."""
        self._report = None
        terrain = self.scene.terrain
        rows, columns = terrain.shape
        whole = slice(0, rows), slice(0, columns)
        solid = None
        if not self._is_bare:
            (frozen,) = read_parts([self.heat.frozen], self._cells_under(whole))
            solid = self._on_terrain(frozen, whole)
        self.covered.move(terrain, solid, self.accuracy.inundation_threshold)
        self.covered.attach(self._maps)

    def _part_with_lava(self) -> Part:
        """Return rows and columns of maps with their ring, outside of which there is no lava."""
        ends = self._ends_at_start
        if self.steps:
            # no window before: the first step finds it
            low, high = self._reported(BOX, self.state.box).reshape(2, 2).T
            ends = np.array([np.minimum(ends[0], low), np.maximum(ends[1], high + 1)])
        rows, columns = ends.T.tolist()
        return slice(*rows), slice(*columns)

    def _reported(self, place: slice, array: Any) -> np.ndarray:
        """Return a part of the latest report, or the small array that it is a copy of."""
        if self._report is None:
            return read(array)
        values: np.ndarray = self._report[place].astype(wp.dtype_to_numpy(array.dtype))
        return values

    def _rectangle(self) -> Part:
        """Return the rows and columns of the terrain around all lava so far."""
        bounds = self._reported(BOUNDS, self.covered.maps.bounds)
        return self.window.within(bounds.tolist())

    def columns(self) -> Columns:
        """Copy the lava."""
        heat = self.heat
        arrays = self.state.thickness, heat.temperature, heat.emission_time, heat.frozen
        return Columns(*(_inner(array).copy() for array in arrays))

    def start_bare(self) -> None:
        """Prepare new arrays for a start without flowing or solidified lava."""
        self._report = None
        #: Temperatures of the lava [K], and the window in which it is.
        self._temperatures: set[float] = set()
        self._lava_box = np.array([0, -1, 0, -1], dtype=np.int32)
        self._is_bare = True
        #: First and end of rows and columns with any lava at the start, [2, 2].
        self._ends_at_start = np.array([np.add(self.grid.shape, 2), [0, 0]])
        if self.effects.any('ages_in_place'):
            self.heat.emission_time.fill_(UNREACHED)
        lay_ground(self.state, self.heat, self.effects, is_bare=True)
        self._warm(hottest_of(self.scene))

    def put(self, lava: Columns) -> None:
        """Replace the lava and the ground that it has become."""
        self._report = None
        state, heat = self.state, self.heat
        for values, arrays in (
            (lava.thickness, (state.thickness, state.stage, heat.former)),
            (lava.solidified, (heat.frozen,)),
        ):
            for array in arrays:
                if values.any():
                    array.assign(np.pad(values, 1).astype(wp.dtype_to_numpy(array.dtype)))
                else:
                    array.zero_()
        is_wet = lava.thickness > 0.0
        self._temperatures = set(np.unique(lava.temperature[is_wet]).tolist())
        rows, columns = box_of(lava.thickness > self._film)
        ends = rows.start, rows.stop - 1, columns.start, columns.stop - 1
        self._lava_box = np.array(ends, dtype=np.int32)
        emission_time = lava.emission_time
        if self.effects.any('ages_in_place'):
            emission_time = np.where(is_wet | (lava.solidified > 0.0), emission_time, UNREACHED)
        fill(heat.emission_time, emission_time)
        rows, columns = box_of(is_wet | (lava.solidified > 0.0))
        self._ends_at_start = np.array([[rows.start, columns.start], [rows.stop, columns.stop]])
        self._ends_at_start += 1
        is_solid = bool(lava.solidified.any())
        self._is_bare = not (is_wet.any() or is_solid)
        self.thickest = float(lava.thickness.max(initial=0.0))
        state.peaks.assign([self.thickest, 0.0])
        lay_ground(state, heat, self.effects, is_bare=not is_solid)
        self._warm(lava.temperature)

    def _warm(self, temperature: np.ndarray | float) -> None:
        """Write temperature [K], a map or a number, and viscosity and yield strength by it."""
        first = float(np.ravel(temperature)[0])
        is_uniform = bool(np.all(temperature == first))
        # a number instead of a map needs no search for its different values
        temperature = first if is_uniform else temperature
        #: The latest temperature of all cells [K]; None if they differ.
        self._warmth = first if is_uniform else None
        rheology, state = Rheology(self.scene.lava, self.effects), self.state
        fill(self.heat.temperature, temperature)
        found, which = np.array([first], dtype=np.float32), np.array(0)
        if not is_uniform:
            found, which = np.unique(np.float32(temperature), return_inverse=True)
        for array, law in (
            (state.fluidity, lambda one: 1.0 / rheology.viscosity_at(one)),
            (state.strength, rheology.strength_at),
        ):
            values = np.array([law(one) for one in found.tolist()], dtype=np.float32)
            fill(array, values[which].reshape(np.shape(temperature)))

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.clock[TIME])

    @property
    def steps(self) -> int:
        """Number of time steps so far."""
        return int(self.counts[STEPS])

    @property
    def count(self) -> int:
        """Number of cells with lava that flows."""
        if self._is_bare and not self.steps:
            return 0
        (thickness,) = read_parts([self.state.thickness], self._part_with_lava())
        count = int((thickness > self._film).sum())
        self.most_particles = max(self.most_particles, count)
        return count

    @property
    def capacity(self) -> int:
        """Number of cells."""
        return int(self.state.thickness.size)

    @property
    def column_spacing(self) -> float:
        """Distance between the columns into which emplaced lava is divided [m]."""
        return 0.25 * self.grid.resolution

    @property
    def grids(self) -> Any:
        """All lava, its temperature, the solidified part, and ``SHOWN`` on the terrain's cells."""
        if self._grids is None:
            terrain = self.scene.terrain
            # solidified lava in all, so that the number of maps does not depend on effects
            maps = np.zeros((3 + len(SHOWN), *terrain.shape), dtype=np.float32)
            maps[:, ~terrain.has_data] = np.nan
            # temperature without lava, and times of cells that lava has not reached
            maps[[1, -2, -1]] = np.nan
            self._grids = wp.array(maps, dtype=wp.float32, device=self.device, copy=False)
        return self._grids

    def record(self) -> None:
        """Record the ground that lava covers now, if that is due."""
        raise NotImplementedError

    def _on_terrain(self, values: np.ndarray, part: Part) -> np.ndarray:
        """Return values of ``cells_under`` a part on it, with all lava where there are data."""
        grid, terrain = self.grid, self.scene.terrain
        if self._fraction_with_data is not None:
            values = values / self._fraction_with_data[cells_under(part, grid, terrain)]
        return on_terrain(values, grid, terrain, part)

    def _cells_under(self, part: Part) -> Part:
        """Return rows and columns of maps with their ring, under some of the terrain's cells."""
        return within_ring(cells_under(part, self.grid, self.scene.terrain))

    def draw_maps(self) -> Any:
        """Write and return ``grids``."""
        self.record()
        # lava is nowhere else
        part = self._rectangle()
        heat, terrain = self.heat, self.scene.terrain
        thickness, temperature, frozen = read_parts(
            [self.state.thickness, heat.temperature, heat.frozen], self._cells_under(part)
        )
        remove_dust(thickness)
        flowing, solid, warmth = (
            self._on_terrain(values, part)
            for values in (thickness, frozen, thickness * temperature)
        )
        known = terrain.has_data[part]
        total = np.where(known, (flowing + solid).astype(np.float32), np.nan)
        with np.errstate(invalid='ignore', divide='ignore'):
            mean = np.where(flowing > 0.0, warmth / flowing, self.scene.lava.solidus)
        maps = np.stack(
            [total, np.where(total > 0.0, mean, np.nan), np.where(known, solid, np.nan)]
        ).astype(np.float32)
        write_part(self.grids, (slice(3), *part), maps)
        show_covered_cells(self._maps, self.grids[-len(SHOWN) :], self.window)
        return self.grids

    def begin_snapshot(self, *, overlaps: bool) -> PendingSnapshot:
        """Map the flow; a CPU has done so when this returns."""
        maps, counts = self.draw_maps().numpy(), self.counts
        steps = StepReport(
            count=int(counts[STEPS]), evaluations=int(counts[EVALUATIONS]),
            stages=int(counts[STAGES]), length=float(self.clock[FULL]), limit='diffusion',
        )
        moment = Moment(self.time, self.count, steps, self.budget())
        is_solid = self.effects.any('freezes') or moment.budget.solidified
        # a copy
        maps = maps[[0, 1, *([2] if is_solid else []), *range(3, len(maps))]]
        snapshot = snapshot_of(maps, moment, self.scene.terrain, self.accuracy)
        return PendingSnapshot(lambda: snapshot)

    def budget(self) -> VolumeBudget:
        """Return the budget of the lava's volume."""
        area = self.grid.resolution**2
        left = self._reported(LEFT, self.state.left) * area
        maps = [self.state.thickness, self.heat.frozen]
        parts = read_parts(maps, self._part_with_lava())
        flowing, solid = (values.sum() * area for values in parts)
        return VolumeBudget(
            emitted=self.volume_before + self.vents.emitted(self.time),
            flowing=float(flowing), solidified=float(solid), **lost_volumes(left),
        )

    def start_peaks(self) -> None:
        """Begin to keep peaks with the current lava."""
        if self._is_bare and not self.steps:
            # no lava so far
            return
        thickness = self.state.thickness.numpy()
        warm = np.where(thickness > 0.0, self.heat.temperature.numpy(), 0.0)
        self.peaks.restart(thickness + self.heat.frozen.numpy(), warm)

    def observing(self, peaks: Peaks) -> Iterator[None]:
        """Check the current flow; the steps themselves keep its peaks.

        The other members of a batch are not involved.
        """
        if self.device.is_cuda:
            # not a number anywhere makes the largest one of the report none
            peaks.check(np.array(self.thickest), np.array(0.0))
        else:
            maps = [self.state.thickness, self.heat.temperature]
            peaks.check(*read_parts(maps, self._part_with_lava()))
        yield from ()

    def maps_and_sample(self) -> tuple[Any, ParticleSample]:
        """Map the lava, and return the cells with lava as columns."""
        return self.draw_maps(), self.read_flow()

    def read_peaks(self, peaks: Peaks, *, where_wet: bool) -> PeakMaps:
        """Return the peaks so far, of all cells or of the rectangle that lava can reach."""
        self.record()
        rows, columns = self.scene.terrain.shape
        part = slice(0, rows), slice(0, columns)
        if where_wet:
            part = self._rectangle()
        terrain = self.scene.terrain
        thickness, temperature = self.peaks.on_terrain(
            lambda values: self._on_terrain(values, part), self._cells_under(part)
        )
        # 0 K is lava that was solid throughout
        warm = np.where(temperature > 0.0, temperature, self.scene.lava.solidus)
        warm[~(terrain.has_data[part] & (thickness > 0.0))] = np.nan
        kept = np.stack([thickness, warm]).astype(np.float32)
        return peaks.read(self._maps, terrain, part, kept=kept)

    def read_flow(self) -> ParticleSample:
        """Return the cells whose lava counts as inundation, or all as ``read_sample``.

        The film that a front leaves in the cell ahead is as cold as the air.
        """
        least = self.accuracy.inundation_threshold
        return self.read_sample(least=least if self.thickest >= least else 0.0)

    def read_sample(self, *, least: float = 0.0) -> ParticleSample:
        """Return the cells with lava as columns, by the fluxes of the latest evaluation.

        ``least`` is the minimum thickness [m], at least that of a film.
        """
        grid, thickness = self.grid, _inner(self.state.thickness)
        i, j = np.nonzero(thickness > max(self._film, least))
        own = thickness[i, j]
        east, north = read(self.state.first_x), read(self.state.first_y)
        # faces on both sides of the cell, in maps with a ring
        passed = np.stack([
            east[i + 1, j] + east[i + 1, j + 1], north[i, j + 1] + north[i + 1, j + 1],
        ], axis=1)
        return ParticleSample(
            position=np.column_stack([j + 0.5, i + 0.5]) * grid.resolution + grid.origin,
            volume=own * grid.resolution**2,
            temperature=_inner(self.heat.temperature)[i, j],
            thickness=own,
            velocity=0.5 * passed * grid.resolution / own[:, None],
        )


def fill(array: Any, values: np.ndarray | float) -> None:
    """Write a map without its ring, which continues it, or a number."""
    first = np.ravel(values)[0]
    if np.all(values == first):
        array.fill_(float(first))
    else:
        array.assign(np.pad(values, 1, mode='edge').astype(wp.dtype_to_numpy(array.dtype)))


def remove_dust(thickness: np.ndarray) -> None:
    """Set to 0 what rounding errors have left on a map, less than the rounding of the map."""
    thickness[thickness <= DUST * thickness.sum() / max(thickness.size, 1)] = 0.0


def _inner(array: Any) -> np.ndarray:
    """Return a map without its ring, which on a CPU shares the memory of the array."""
    values = read(array) if array.device.is_cuda else array.numpy()
    return values[1:-1, 1:-1]
