# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The device side of a simulation: particles, grids and kernels for one scene and set of effects.

``Simulation`` decides what to simulate, and ``advance.py`` how far. The solver owns the arrays and
runs single stages.
"""

from collections.abc import Callable
from functools import partial
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.scene import Scene
from lava_ros.scene.vents import match_vents
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.memory import read
from lava_ros.simulation.backend.streams import Reader
from lava_ros.simulation.backend.threads import is_alone
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.covered_maps import (
    CoveredCells,
    record_covered_ground,
    show_covered_cells,
)
from lava_ros.simulation.output.diagnostics import (
    FlowDiagnostics,
    moment_of,
    SHOWN,
    snapshot_of,
)
from lava_ros.simulation.output.peaks import Peaks
from lava_ros.simulation.output.rasterization import Raster
from lava_ros.simulation.output.snapshot import (
    Particles,
    ParticleSample,
    PendingSnapshot,
    rows_of,
)
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.layout import centre_of
from lava_ros.simulation.particles.neighbors import NeighborGrid
from lava_ros.simulation.particles.solidified import RaisedTerrain
from lava_ros.simulation.particles.state import room_for, State
from lava_ros.simulation.particles.terrain import StaggeredTerrain
from lava_ros.simulation.step.stage import Stage
from lava_ros.simulation.step.vents import check_rates, Emission, VentSet

#: Initial capacity, in particles.
_FIRST_CAPACITY = 4096

#: Stages per launch, by whether the device is a GPU.
_GRAPH_STAGES = {True: 16, False: 1}

#: Stages that may run before the host reacts to the counts of particles: two launches are in
#: flight while it reads those of a third.
_STAGES_AHEAD = {True: 3 * _GRAPH_STAGES[True], False: 1}

#: Maximum number of particles for which room is kept in advance.
_MAX_AHEAD = 2**20

#: Positions of no particles.
_NOWHERE = np.empty((0, 2))


class Solver:
    """Particles, terrain, vents and kernels on a device.

    Attributes:
        scene: The current scene.
        accuracy: The resolution, with all automatic values filled in.
        device: The Warp device.
        state: Arrays of the particles, and the clock.
        terrain: The ground on the device, shared by simulations on the same terrain.
        covered: What lava has covered of each cell of the terrain.
        raised: ``terrain``, no longer shared, if lava can solidify or has solidified onto it;
            otherwise None.
        neighbors: The grid of cells in which neighbours are found.
        raster: The terrain's cells, for maps.
        stage: The kernels of one stage of a step.
        vents: The vents on the device.
        volume_before: Volume on the terrain at the start, plus that of former vents [m3].
        most_particles: Maximum number of particles at any readback so far.
        is_empty: True if there was no particle at the latest readback.
    """

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
        self.state = State(_FIRST_CAPACITY, effects, accuracy, device)
        self._diagnostics, self._reader = FlowDiagnostics(), Reader(device)
        self.volume_before = 0.0
        self.most_particles = 0
        self.is_empty = False
        self.raised: RaisedTerrain | None = None
        self.covered = CoveredCells(scene.terrain, device)
        self._place_terrain()

    def start_with(self, particles: Particles | None) -> None:
        """Place the initial particles, open the vents of the scene, and find the highest ground.

        Raises:
            LavaError: If a particle is not on the terrain, a discharge is out of range, or the
                spacing is too small for the terrain.
        """
        places = _NOWHERE
        if particles is None:
            self.cover()
        else:
            assert self.accuracy.spacing is not None
            rows = rows_of(particles, self.scene.terrain, self.accuracy.spacing)
            self.add_particles(rows)
            if self.state.has_velocity:
                self.state.velocity[: len(rows)].assign(particles.velocity)
            self.cover()
            self.volume_before = float(self.state.read_particles()[:, 2].sum())
            self.sort()
            self.record_covered_ground()
            places = self.state.read_particles()[:, :2]
        check_rates(self.scene.vents, self.accuracy.particle_volume)
        self.open_vents(0.0, Emission.of_new_vents(len(self.scene.vents)))
        self.raise_top(places, until=0.0)

    def switch_effects(self, effects: Effects) -> None:
        """Continue with other effects."""
        # drop particles that have solidified or merged, which a state with other effects keeps
        self.order()
        former = self.state
        self.state = State(former.capacity, effects, self.accuracy, self.device)
        self.state.take_over(former)
        self._reserve_room()
        if effects.any('freezes') and self.raised is None:
            self.own_terrain()
        else:
            self._build_stage()

    def own_terrain(self) -> RaisedTerrain:
        """Return the ground that solidified lava can raise, after allocating it if necessary."""
        if self.raised is None:
            self._place_terrain(is_raised=True)
            self.cover()
        assert self.raised is not None
        return self.raised

    def _place_terrain(self, *, is_raised: bool = False) -> None:
        """Copy the terrain to the device, and create the grids and kernels that depend on it.

        Solidified lava remains on it. ``cover`` must then fit the neighbour grid.
        """
        terrain, accuracy, former = self.scene.terrain, self.accuracy, self.raised
        if is_raised or former is not None or self.state.effects.any('freezes'):
            self.raised = RaisedTerrain(terrain, accuracy.precision, self.device)
        if self.raised is not None and former is not None:
            self.raised.take_over(former, self.state.left)
        self.terrain = self.raised or StaggeredTerrain.shared(
            terrain, accuracy.precision, self.device
        )
        self.neighbors = self._grid_over(self.terrain)
        output_radius = max(accuracy.raster_ratio * accuracy.radius, 1.5 * terrain.resolution)
        # grids for solidified lava, and for what lava has covered
        self.raster = Raster(
            self.terrain, output_radius, accuracy.kernel, self.device,
            reach=max(output_radius, accuracy.radius),
            more=(self.raised is not None) + len(SHOWN),
        )
        self._shown = self.raster.grids[-len(SHOWN) :]
        # times of cells that lava has not reached
        self._shown[1:].fill_(math.nan)
        solid = None if self.raised is None else self.raised.thickness()
        self.covered.move(terrain, solid, accuracy.inundation_threshold)
        self.covered.attach(self.state)
        self._build_stage()

    def _grid_over(self, terrain: StaggeredTerrain) -> NeighborGrid:
        """Return a neighbour grid for a terrain, to be fitted by ``cover``."""
        accuracy = self.accuracy
        return NeighborGrid(terrain, accuracy.radius, accuracy.ratio, self.device)

    def _build_stage(self) -> None:
        """Collect the kernels of the effects for the state, the terrain and the grids."""
        self.stage = Stage(
            self.scene, self.accuracy, self.state, self.neighbors, self.terrain
        )

    def replace_terrain(self, scene: Scene) -> None:
        """Replace the terrain by that of another scene; particles outside it count as lost.

        Raises:
            LavaError: If the spacing is too small for the terrain. The previous one then remains.
        """
        self.settle()
        rows = self.state.read_particles()
        rows[:, :2] += centre_of(self.scene.terrain) - centre_of(scene.terrain)
        ground = StaggeredTerrain.shared(scene.terrain, self.accuracy.precision, self.device)
        self._grid_over(ground).window(np.concatenate([rows[:, :2], corners_of(scene)]))
        now = self.state.time
        before = self.vents.emission(now)
        self.volume_before += self.vents.emitted(now)
        self.scene = scene
        self._place_terrain()
        self.state.write_particles(rows)
        self.cover()
        self.open_vents(now, before)

    def replace_vents(self, scene: Scene) -> list[tuple[float, ...]]:
        """Continue with the vents of another scene.

        Returns:
            The particles that empty the conduits of closing vents, for ``add_particles``.

        Raises:
            LavaError: If the spacing is too small for the distances between the vents. The
                previous vents then remain.
        """
        self.neighbors.window(corners_of(scene))
        self.settle()
        now, former = self.state.time, self.vents
        matches = match_vents(former.vents, scene.vents, least=self.accuracy.spacing or 0.0)
        closing = set(range(len(former.vents))).difference(matches)
        waiting = former.pending(now)
        self.volume_before += former.emitted(now)
        particle_volume = self.accuracy.particle_volume
        new = Emission.of_new_vents(len(scene.vents), self.volume_before, particle_volume)
        before = former.emission(now).continued(matches, new)
        self.scene = scene
        self.open_vents(now, before)
        self.raise_top()
        return [row for number in closing for row in former.parting(number, waiting[number])]

    def emitted_fraction(self, until: float) -> float:
        """Return the fraction of the volume emitted by a later time [s] that is emitted now."""
        now = self.state.time
        volume = self.volume_before + self.vents.emitted(now)
        later = sum(vent.volume_between(now, until) for vent in self.scene.vents)
        return float(volume / max(volume + later, 1e-30))

    def open_vents(self, since: float, before: Emission) -> None:
        """Put the vents of the scene on the device.

        Args:
            since: Simulated time at which they open [s].
            before: Their emission before that time.
        """
        self.vents = VentSet(
            self.scene.vents, self.scene.terrain, self.accuracy, self.device, since=since,
            before=before,
        )
        self._reserve_room()

    def _reserve_room(self) -> None:
        """Reserve capacity for particles that vents emit before the host reads the counts."""
        # otherwise lava would wait in the vents, and be emitted all at once
        state = self.state
        _, steps, rates = self.vents.step_limits.T
        assert self.accuracy.longest_step is not None
        volume = (np.minimum(steps, self.accuracy.longest_step) * rates).max()
        per_step = volume / self.accuracy.particle_volume
        # steps have at least two stages with RKL2
        ahead = math.ceil(_STAGES_AHEAD[self.device.is_cuda] / (2 if state.is_staged else 1))
        state.particles_ahead = math.ceil(min(ahead * per_step, _MAX_AHEAD))
        state.make_room(state.read_clock()[1])

    def raise_top(self, places: np.ndarray = _NOWHERE, *, until: float | None = None) -> None:
        """Update the elevation of the highest ground that lava came from.

        Args:
            places: Additional places relative to the terrain's centre [m], shape [count, 2].
            until: Time by which a vent must have emitted lava to count [s], by default now. Each
                vent counts once.
        """
        new = self.vents.giving(self.state.time if until is None else until)
        if not len(places) and not new:
            return
        self.vents.counted |= new
        every = [places]
        centre, resolution = centre_of(self.scene.terrain), self.scene.terrain.resolution
        for vent in (self.scene.vents[number] for number in new):
            start, end = np.subtract((vent.position, vent.end or vent.position), centre)
            count = 1 + math.ceil(math.dist(start, end) / resolution)
            every.append(start + np.linspace(0.0, 1.0, count)[:, None] * (end - start))
        self.terrain.raise_to(np.concatenate(every), self.state.top)

    def lower_top(self) -> None:
        """Find the highest ground that lava came from again, on a new terrain."""
        self.state.top.fill_(-at.FAR)
        self.raise_top(self.state.read_particles()[:, :2])

    def add_particles(self, rows: np.ndarray | list[Any]) -> None:
        """Add particles given as (map x, map y, volume, temperature)."""
        if not len(rows):
            return
        added = np.array(rows, dtype=np.float64)
        added[:, :2] -= centre_of(self.scene.terrain)
        self.state.write_particles(np.concatenate([self.state.read_particles(), added]))
        self.state.launches.forget()

    def run_stages(self) -> None:
        """Run one stage on the CPU, or a graph of several stages on a GPU.

        Stages past the target time have no effect.
        """
        state, is_cuda = self.state, self.device.is_cuda
        if not is_alone(state):
            self.take_stages()
            return
        self.bin()
        if not state.launches.can_replay(state.extent):
            if is_cuda:
                self.take_stages()
            # on a CPU each possible particle costs time
            extent = min(room_for(state.extent), state.capacity)
            take = partial(self.take_stages, _GRAPH_STAGES[is_cuda])
            state.launches.capture(take, extent)
        state.launches.replay()

    def take_stages(self, count: int = 1, *, observe: Callable[[], None] | None = None) -> None:
        """Launch stages; ``observe`` is called before the motion of each."""
        for _ in range(count):
            self.stage.take(self.scene, self.vents, observe=observe)

    def count_particles(self, counts: np.ndarray) -> bool:
        """Update the numbers of particles from a readback; return True when the last has gone."""
        count, was_empty = at.count_in(counts), self.is_empty
        self.most_particles, self.is_empty = max(self.most_particles, count), count == 0
        return self.is_empty and not was_empty

    def skip_to(self, until: float, end: float) -> None:
        """Set the clock to a time if no lava is emitted before ``end``, both in s."""
        clock, counts = self.state.read_clock()
        is_idle = not at.count_in(counts) and not counts[at.STAGE]
        if is_idle and not self.vents.emit_by(end) and clock[at.TIME] < until:
            self.state.write_time(until)

    def make_room(self, counts: np.ndarray) -> None:
        """Enlarge the arrays or the neighbour grid if a readback of the counts requires it."""
        self.state.make_room(counts)
        if counts[at.NEAR_BORDER]:
            if self.neighbors.is_binned:
                # particles off the terrain have been counted
                self.neighbors.rebuild(self.state)
                self.state.take_order(within_step=True)
            self.state.write_count(at.NEAR_BORDER, 0)
            self.neighbors.widen(int(counts[at.NEAR_BORDER]))
            self.state.launches.forget()

    def bin(self) -> None:
        """Assign the particles to cells in place of the previous motion, if it has not."""
        if self.state.bins_in_motion and not self.neighbors.is_binned:
            self.neighbors.bin(self.state)

    def cover(self) -> None:
        """Fit the neighbour grid to the lava and the vents."""
        self.settle()
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
        record_covered_ground(self.state, self.neighbors.motion_arguments(self.state))

    def sort(self) -> None:
        """Sort the particles by cell and drop those off the terrain.

        Raises:
            LavaError: If too many particles are in one place.
        """
        self.order()
        self.neighbors.refuse_crowds()

    def order(self) -> None:
        """Sort the particles by cell, without a readback."""
        self.neighbors.rebuild(self.state)
        self.state.take_order()

    def observe(self, peaks: Peaks) -> None:
        """Raise peaks to the values of the current flow, within a stage that moves nothing."""

        def observe() -> None:
            self._fill_raster()
            peaks.observe(self.state, self.terrain.known, self.raster)

        self.take_stages(observe=observe)

    def draw_maps(self) -> Any:
        """Map the flow of the ordered particles; return the grids of the raster."""
        self.stage.compute_flow()
        self._reader.before_writing()
        self._fill_raster()
        show_covered_cells(self.state, self._shown, self.raster.window)
        return self.raster.grids

    def _fill_raster(self) -> None:
        self.raster.fill(self.state, self.neighbors.motion_arguments(self.state))
        if self.raised is not None:
            self.raised.show(
                self.state, self.scene.lava.solidus, self.raster.grids, self.raster.window
            )

    def begin_snapshot(self, *, overlaps: bool) -> PendingSnapshot:
        """Map the ordered particles; the copy to the host may overlap with the next steps."""
        state, grids = self.state, self.draw_maps()
        numbers = self._diagnostics.take(state, self.vents, self.raised)
        copies = self._reader.begin([grids, numbers], overlaps=overlaps)
        terrain, vents, before = self.scene.terrain, self.vents, self.volume_before
        threshold = self.accuracy.inundation_threshold
        return PendingSnapshot(
            lambda: snapshot_of(copies(), terrain, state, vents, before, threshold)
        )

    def read_sample(self) -> ParticleSample:
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
        numbers = read(self._diagnostics.take(self.state, self.vents, self.raised))
        return moment_of(numbers, self.state, self.vents, self.volume_before).budget


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
