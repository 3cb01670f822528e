# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The lava of a simulation as particles: its arrays and grids, and what others read of them."""

import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.memory import read
from lava_ros.simulation.backend.streams import Reader
from lava_ros.simulation.backend.threads import launch_over
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.covered_maps import (
    covered_ground_kernel,
    CoveredCells,
    show_covered_cells,
)
from lava_ros.simulation.output.diagnostics import (
    gather_numbers,
    moment_of,
    SHOWN,
    snapshot_of,
)
from lava_ros.simulation.output.peaks import PeakMaps, Peaks
from lava_ros.simulation.output.rasterization import Raster
from lava_ros.simulation.output.snapshot import ParticleSample, PendingSnapshot, Snapshot
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.layout import centre_of
from lava_ros.simulation.particles.neighbors import NeighborGrid
from lava_ros.simulation.particles.solidified import RaisedTerrain
from lava_ros.simulation.particles.state import room_for, State
from lava_ros.simulation.particles.terrain import StaggeredTerrain
from lava_ros.simulation.step.stage import Stage
from lava_ros.simulation.step.vents import VentSet

#: Initial capacity, in particles.
FIRST_CAPACITY = 4096


class ParticleLava:
    """Lava as particles.

    Attributes:
        scene: The current scene.
        accuracy: The resolution, with all automatic values filled in.
        device: The Warp device.
        state: Arrays of the particles, and the clock.
        terrain: The ground on the device, shared by simulations on the same terrain.
        covered: The ground that lava has covered in each cell of the terrain.
        raised: ``terrain``, no longer shared, if lava can solidify or has solidified onto it;
            otherwise None.
        neighbors: The grid of cells in which neighbours are found.
        raster: The terrain's cells, for maps.
        stage: The kernels of one stage of a step.
        vents: The vents on the device.
        volume_before: Volume on the terrain at the start, plus the emission of former vents [m3].
        most_particles: Maximum number of particles at any readback so far.
        is_empty: True if there was no particle at the latest readback.
        keeps_peaks: False: observations gather the peaks.
    """

    vents: VentSet
    keeps_peaks = False

    def __init__(
        self, scene: Scene, effects: Effects, accuracy: Accuracy, device: wp.Device
    ) -> None:
        """Allocate the arrays; ``start_with`` or ``load`` places lava and vents.

        Args:
            scene: Terrain, vents and lava.
            effects: The effects that are on.
            accuracy: The resolution, with all automatic values filled in.
            device: The Warp device.
        """
        self.scene, self.accuracy, self.device = scene, accuracy, device
        self.state = State(FIRST_CAPACITY, effects, accuracy, device)
        self._numbers, self._reader = None, Reader(device)
        self.volume_before = 0.0
        self.most_particles = 0
        self.is_empty = False
        self.raised: RaisedTerrain | None = None
        self.covered = CoveredCells(scene.terrain, device)
        self.place_terrain()

    @staticmethod
    def bytes_for(scene: Scene, effects: Effects, accuracy: Accuracy, volume: float) -> int:
        """Return the memory of a simulation and its ``Peaks`` on a device [bytes].

        It leaves out what simulations on the same terrain share, and the arrays of few items.

        Args:
            scene: Terrain, vents and lava.
            effects: The effects that are on.
            accuracy: The resolution, with all automatic values filled in.
            volume: Expected volume of the lava [m3].
        """
        freezes = effects.any('freezes')
        kinds = at.kinds_of(at.REAL[accuracy.precision])
        types = [kinds[one.dtype] for one in at.CELL_MAPS.values() if len(one.shape) == 2]
        types += (Raster.COUNT + freezes + len(SHOWN) + Peaks.COUNT) * [wp.float32]
        types += freezes * [kinds['real'], wp.int64, wp.int64]
        per_cell = sum(map(wp.types.type_size_in_bytes, types))
        count = max(room_for(math.ceil(volume / accuracy.particle_volume)), FIRST_CAPACITY)
        per_particle = State(1, effects, accuracy, wp.get_device('cpu')).bytes_per_particle
        return scene.terrain.elevation.size * per_cell + count * per_particle

    def place_terrain(self, *, is_raised: bool = False) -> None:
        """Copy the terrain to the device, and create the grids and kernels that depend on it.

        Solidified lava remains on it. ``cover`` must then fit the neighbour grid.
        """
        terrain, accuracy, former = self.scene.terrain, self.accuracy, self.raised
        if is_raised or former is not None or self.state.effects.any('freezes'):
            self.raised = RaisedTerrain(terrain, accuracy.precision, self.device)
        if self.raised is not None and former is not None:
            self.raised.take_over(former, self.state.left)
        self.terrain = self.raised or StaggeredTerrain(terrain, accuracy.precision, self.device)
        self.neighbors = self.grid_over(self.terrain)
        output_radius = max(accuracy.raster_ratio * accuracy.radius, 1.5 * terrain.resolution)
        # grids for solidified lava, and for what lava has covered
        self.raster = Raster(
            self.terrain, output_radius, accuracy.kernel,
            reach=max(output_radius, accuracy.radius),
            more=(self.raised is not None) + len(SHOWN),
        )
        self._shown = self.raster.grids[-len(SHOWN) :]
        # times of cells that lava has not reached
        self._shown[1:].fill_(math.nan)
        solid = None if self.raised is None or former is None else self.raised.thickness()
        self.covered.move(terrain, solid, accuracy.inundation_threshold)
        self.covered.attach(self.state)
        self.build_stage()

    def grid_over(self, terrain: StaggeredTerrain) -> NeighborGrid:
        """Return a neighbour grid for a terrain, to be fitted by ``cover``."""
        accuracy = self.accuracy
        return NeighborGrid(terrain, accuracy.radius, accuracy.ratio)

    def build_stage(self) -> None:
        """Collect the kernels of the effects for the state, the terrain and the grids."""
        self.stage = Stage(self.scene, self.accuracy, self.state, self.neighbors, self.terrain)

    def own_terrain(self) -> RaisedTerrain:
        """Return the ground that solidified lava can raise, after allocating it if necessary."""
        if self.raised is None:
            self.place_terrain(is_raised=True)
            self.cover()
        assert self.raised is not None
        return self.raised

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.state.time

    @property
    def effects(self) -> Effects:
        """The effects that are on."""
        return self.state.effects

    @property
    def count(self) -> int:
        """Number of particles."""
        return self.state.count

    @property
    def steps(self) -> int:
        """Number of time steps so far."""
        return int(self.state.read_clock()[1][at.STEPS])

    @property
    def capacity(self) -> int:
        """Number of particles for which there is memory."""
        return self.state.capacity

    @property
    def column_spacing(self) -> float:
        """Distance between the columns into which emplaced lava is divided [m]."""
        assert self.accuracy.spacing is not None
        return self.accuracy.spacing

    def add_particles(self, rows: np.ndarray | list[Any]) -> None:
        """Add particles given as (map x, map y, volume, temperature)."""
        if not len(rows):
            return
        added = np.array(rows, dtype=np.float64)
        added[:, :2] -= centre_of(self.scene.terrain)
        self.state.write_particles(np.concatenate([self.state.read_particles(), added]))
        self.state.launches.forget()

    def bin(self) -> None:
        """Assign the particles to cells, unless the previous motion has done so."""
        if not (self.state.form.has_empty or self.neighbors.is_binned):
            self.neighbors.bin(self.state, self.stage.arguments)

    def cover(self) -> None:
        """Fit the neighbour grid to the lava and the vents."""
        self.settle()
        if self.state.read_clock()[1][at.NEAR_BORDER]:
            self.state.write_count(at.NEAR_BORDER, 0)
        rows = self.state.read_particles()
        self.neighbors.fit(np.concatenate([rows[:, :2], corners_of(self.scene)]))
        self.state.launches.forget()

    def settle(self) -> None:
        """Drop particles that are counted as lost, before any read or change."""
        if self.neighbors.is_binned:
            self.sort()

    def record_covered_ground(self) -> None:
        """Record the ground that lava covers now, if it has not flowed there."""
        self.order()
        self.stage.compute_flow()
        kernel = covered_ground_kernel(self.state.real)
        launch_over(self.state, kernel, [self.stage.arguments])

    def sort(self) -> None:
        """Sort the particles by cell and drop those off the terrain.

        Raises:
            LavaError: If too many particles are in one place.
        """
        self.order()
        self.neighbors.refuse_crowds()

    def order(self) -> None:
        """Sort the particles by cell, without a readback."""
        self.neighbors.rebuild(self.state, self.stage.arguments)
        self.state.take_order()

    def read_peaks(self, peaks: Peaks, *, where_wet: bool) -> PeakMaps:
        """Return the peaks so far, of all cells or of the rectangle that lava can reach."""
        rows, columns = self.scene.terrain.shape
        part = slice(0, rows), slice(0, columns)
        if where_wet:
            part = self.raster.window.rectangle(self.state)
        return peaks.read(self.state, self.scene.terrain, part)

    def draw_maps(self) -> Any:
        """Map the flow of the ordered particles; return the grids of the raster."""
        self.stage.compute_flow()
        self._reader.before_writing()
        self._fill_raster()
        show_covered_cells(self.state, self._shown, self.raster.window)
        return self.raster.grids

    def _fill_raster(self) -> None:
        self.raster.fill(self.state, self.stage.arguments)
        if self.raised is not None:
            self.raised.show(
                self.state, self.scene.lava.solidus, self.raster.grids, self.raster.window
            )

    def begin_snapshot(self, *, overlaps: bool) -> PendingSnapshot:
        """Map the flow; the copy to the host may overlap with the next steps."""
        if overlaps:
            # without a readback
            self.order()
        else:
            self.sort()
        state, grids = self.state, self.draw_maps()
        copies = self._reader.begin([grids, self._gather()], overlaps=overlaps)
        terrain, vents, before = self.scene.terrain, self.vents, self.volume_before
        accuracy = self.accuracy

        def finish() -> Snapshot:
            maps, values = copies()
            return snapshot_of(maps, moment_of(values, state, vents, before), terrain, accuracy)

        return PendingSnapshot(finish)

    def maps_and_sample(self) -> tuple[Any, ParticleSample]:
        """Map the flow, and read the particles back."""
        self.sort()
        return self.draw_maps(), self._read_sample()

    def sample(self) -> ParticleSample:
        """Read the particles back, with their current thickness and velocity."""
        self.sort()
        self.stage.compute_flow()
        return self._read_sample()

    def evaluate(self) -> None:
        """Compute thickness and velocity of the particles, including the neighbour search.

        Nothing is read back and nothing moves: this measures the cost of a stage of a time step.
        """
        self.neighbors.rebuild(self.state, self.stage.arguments)
        self.stage.compute_flow()
        self.stage.finish_flow()

    def _read_sample(self) -> ParticleSample:
        """Read back the ordered particles and their flow; ``stage.compute_flow`` must precede."""
        self.stage.finish_flow()
        rows = self.state.read_particles()
        flow = read(self.state.flow)[: len(rows)].astype(np.float64)
        return ParticleSample(
            position=rows[:, :2] + centre_of(self.scene.terrain),
            volume=rows[:, 2],
            temperature=rows[:, 3],
            thickness=flow[:, 0],
            velocity=flow[:, 1:],
        )

    def budget(self) -> VolumeBudget:
        """Return the volume budget."""
        self.settle()
        self._reader.before_writing()
        numbers = read(self._gather())
        return moment_of(numbers, self.state, self.vents, self.volume_before).budget

    def _gather(self) -> Any:
        """Gather clock, counts and volumes on the device; the next call overwrites them."""
        self._numbers = gather_numbers(self.state, self.vents, self.raised, self._numbers)
        return self._numbers


def corners_of(scene: Scene) -> np.ndarray:
    """Return corners of boxes around the vents, from the terrain's centre [m], [count, 2]."""
    corners = [
        np.add(end, side * vent.radius)
        for vent in scene.vents
        for end in (vent.position, vent.end)
        if end is not None
        for side in (-1.0, 1.0)
    ]
    return np.reshape(corners, (-1, 2)) - centre_of(scene.terrain)
