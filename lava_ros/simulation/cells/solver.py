# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The solver on cells behind a simulation, with the methods of the solver of particles.

On a CPU it runs in one thread. On a GPU it is a member of a batch (``worlds.py``), or alone.
"""

from collections.abc import Generator
from functools import partial
import math
import time as wall_clock
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.memory import read, write_part
from lava_ros.simulation.batch import current_batch
from lava_ros.simulation.cells.columns import Columns
from lava_ros.simulation.cells.grid import deposit
from lava_ros.simulation.cells.heat import carries_heat
from lava_ros.simulation.cells.lava import CellLava, fill
from lava_ros.simulation.cells.state import (
    CLOCK,
    COUNTS,
    FULL,
    LENGTH,
    LONGEST,
    MAX_END,
    POURED,
    TARGET,
    THICKEST,
    TIME,
    UNREACHED,
    UNTIL,
    WAITING,
)
from lava_ros.simulation.cells.vents import CellVents
from lava_ros.simulation.cells.worlds import CellGroup, PackedWorld, World, worlds_alone
from lava_ros.simulation.output.checkpoint import Checkpoint, joined
from lava_ros.simulation.output.checkpoint_contents import (
    check_conserved,
    check_contents,
    check_restored,
)
from lava_ros.simulation.output.snapshot import check_places, Particles, ParticleSample
from lava_ros.simulation.particles.layout import (
    BORDER,
    centre_of,
    fitting,
    HOLES,
    SEA,
)
from lava_ros.simulation.particles.terrain import averaged
from lava_ros.simulation.step.stage import longest_step
from lava_ros.simulation.stop import Stop

#: Wall time of a launch to aim at [s], and maximum number of steps.
_LAUNCH_TIME, _MAX_STEPS = 0.02, 4096

#: Arrays and times of the flow, and arrays of the heat, in checkpoints.
_SAVED = (
    'thickness', 'flux_x', 'flux_y', 'fluidity', 'strength', 'box', 'left', 'counts', 'peaks',
)
_TIMES = [TIME, LENGTH, FULL]
_SAVED_HEAT = ('temperature', 'emission_time', 'frozen')


def check_effects(effects: Effects) -> None:
    """Raise LavaError, naming the effect, if one is on that cells do not have."""
    for name in effects:
        if EFFECTS[name].needs_particles:
            expected = 'false with method cells; method particles has it'
            raise LavaError(f'effects.{name}', True, expected)


class CellSolver(CellLava):
    """Lava on cells, with vents and kernels."""

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
            LavaError: If an effect is on that cells do not have, or the accuracy limits the
                mobility.
        """
        check_effects(effects)
        if accuracy.mobility_limit is not None:
            expected = 'none with method cells; method particles has it'
            raise LavaError('mobility_limit', accuracy.mobility_limit, expected)
        super().__init__(scene, effects, accuracy, device)
        self._end, self._steps_at_once = math.inf, 16
        self._world: Any = None
        self._is_heated = self._is_due = False

    def start_with(self, particles: Particles | None) -> None:
        """Place the initial lava, and open the vents of the scene.

        Raises:
            LavaError: If lava is not on the terrain.
        """
        if particles is None or not len(particles.position):
            self.start_bare()
        else:
            check_places(particles, self.scene.terrain)
            volume, hot = np.asarray(particles.volume), np.asarray(particles.temperature)
            sides = np.sqrt(volume / self.accuracy.thickness)
            volumes, warmth = (
                deposit(self.grid, particles.position, amounts, sides)
                for amounts in (volume, volume * hot)
            )
            with np.errstate(invalid='ignore', divide='ignore'):
                warm = warmth / volumes
            # not the rounded mean of equal numbers
            warm = np.clip(np.where(volumes > 0.0, warm, hot.max()), hot.min(), hot.max())
            nothing = np.zeros(self.grid.shape)
            self.put(Columns(volumes / self.grid.resolution**2, warm, nothing, nothing))
            self.volume_before = float(volume.sum())
        self._cover()
        self.open_vents(0.0)
        self._is_due = True

    def open_vents(self, since: float) -> None:
        """Put the vents of the scene on the cells, from a simulated time [s]."""
        assert self.accuracy.thickness is not None
        self.vents = CellVents(
            self.scene.vents, self.grid, since, rise=self.accuracy.thickness
        )
        self._is_set, self._world = False, None

    def _set(self, time: float) -> None:
        """Write the rates of emission from a time [s]."""
        state, cells = self.state, self.vents.cells
        source, hot = self.vents.sources(time, self.grid.resolution**2)
        #: Largest rate of emission [m/s].
        self.clock[POURED] = source.max(initial=0.0)
        row, column = (ends + 1 for ends in np.divmod(cells, self.grid.shape[1]))
        row, column, source, hot = (
            one[source > 0.0] for one in (row, column, source, hot)
        )
        box = np.array([0, -1, 0, -1], dtype=np.int32)
        if row.size:
            box[:] = row.min(), row.max(), column.min(), column.max()
        first, end = int(box[0]), int(box[1]) + 1
        for array, values in ((state.source, source), (self.heat.vent_temperature, hot)):
            if self._rows_with_vents:
                array.zero_()
            if row.size:
                shape = end - first, array.shape[1]
                rows = np.zeros(shape, dtype=wp.dtype_to_numpy(array.dtype))
                rows[row - first, column] = values
                write_part(array, slice(first, end), rows)
        self._rows_with_vents = end - first
        write_part(state.vent_box, slice(4), box)
        self._reached = self._window_with(box)
        if self._world is None:
            self._make_world()
        self._is_set = True

    def _window_with(self, vents: np.ndarray) -> np.ndarray:
        """Return the window that the next steps need at least, by that of the vents."""
        lava = self._lava_box + np.int32(1)
        boxes = [one for one in (vents, lava) if one[1] >= one[0]]
        if not boxes:
            return vents
        # the window never shrinks: the air also cools the cells where lava will be
        ends = np.stack(boxes)
        wet = np.where([True, False, True, False], ends.min(axis=0), ends.max(axis=0))
        last = np.repeat(np.array(self.state.thickness.shape, dtype=np.int32) - 1, 2)
        return np.clip(wet + np.array([-2, 2, -2, 2], dtype=np.int32), 0, last)

    def _make_world(self) -> None:
        """Make the arguments of the kernels, and find out whether lava carries heat."""
        was_heated = self._is_heated
        self._temperatures |= {vent.temperature for vent in self.vents.vents}
        self._is_heated = carries_heat(self.scene, self.effects) or len(self._temperatures) > 1
        if self._is_heated and not was_heated:
            wp.copy(self.heat.former, self.state.stage)
        elif not self._is_heated and self._temperatures:
            (temperature,) = self._temperatures
            if temperature != self._warmth:
                self._warm(temperature)
        if self.effects.any('is_lateral'):
            self.state.allocate_lateral()
        world = World.ctype()
        parts = {'flow': self.state, 'heat': self.heat, 'highest': self.peaks}
        for name, part in parts.items():
            part.write(getattr(world, name))
        covered = world.covered
        covered.rows, covered.columns = self.scene.terrain.shape
        covered.scale = self.scene.terrain.resolution / self.grid.resolution
        covered.threshold = self.accuracy.inundation_threshold
        maps = {'known': self._known, **vars(self.covered.maps)}
        for name, array in maps.items():
            setattr(covered, name, array.__ctype__())
        self._world = PackedWorld(world, (*parts.values(), maps))
        cell = self.grid.resolution
        own = longest_step(self.scene, self.accuracy, self.effects, cell)
        self._longest_step = min(own, self.heat.longest_step(cell))

    def advancing_to(
        self, until: float, end: float | None, deadline: float, max_end: float = math.inf
    ) -> Generator[None, None, Stop]:
        """Advance to a time, as ``ParticleSolver.advancing_to``; no step is ever incomplete."""
        self._end = self._end if end is None else end
        clock = self.clock
        while clock[TIME] < until and wall_clock.monotonic() < deadline:
            time = float(clock[TIME])
            if not self._is_set:
                self._set(time)
            change = self.vents.next_change(time)
            stop = min(self._end, change)
            clock[LONGEST], clock[MAX_END] = self._longest_step, max_end
            clock[UNTIL], clock[TARGET] = stop, min(until, stop)
            yield from self._taking_steps(deadline)
            if clock[WAITING] > 0.0:
                break
            if clock[TIME] >= change:
                self._is_set = False
        is_step_pending = bool(clock[WAITING] > 0.0)
        step = clock[WAITING] if is_step_pending else clock[FULL]
        clock[WAITING] = 0.0
        return Stop(float(clock[TIME]), float(step), is_step_pending)

    def _taking_steps(self, deadline: float) -> Generator[None, None, None]:
        """Take steps to ``clock[TARGET]`` as a member of a batch, or some steps alone."""
        clock, batch = self.clock, current_batch()
        # as float32, in which the kernel compares it
        is_empty = self.thickest <= float(np.float32(self._film))
        is_idle = is_empty and clock[POURED] == 0.0 and math.isfinite(clock[TARGET])
        if is_idle and not self._is_due:
            # as the kernel does, without a launch in each tick of a clock
            clock[TIME] = max(clock[TIME], clock[TARGET])
            return
        if batch is None or not self.device.is_cuda:
            self._take_steps()
            yield
            return
        kind = self.effects, self._is_heated
        batch.advance_world(
            kind, partial(CellGroup, *kind, self.device), self._world,
            (clock, self._reached, self._is_due),
        )
        self._is_due = False
        yield
        self._read(batch.readback)

    def _take_steps(self) -> None:
        """Take some steps, for about ``_LAUNCH_TIME``."""
        begun, before = wall_clock.perf_counter(), self.steps
        self._launch(self.clock, self._steps_at_once)
        spent = (wall_clock.perf_counter() - begun) / max(self.steps - before, 1)
        self._steps_at_once = min(max(int(_LAUNCH_TIME / spent), 1), _MAX_STEPS)

    def _launch(self, clock: np.ndarray, steps: int) -> None:
        """Take at most some steps by a clock, and read where they ended; 0 records the lava."""
        if (batch := current_batch()) is not None:
            batch.wait_for_launches()
        worlds = worlds_alone(self.device)
        worlds.put(0, self._world)
        worlds.order(0, clock, self._reached, self._is_due)
        self._is_due = False
        self._read(worlds.launch([0], self.effects, self._is_heated, steps)()[0])

    def _read(self, report: np.ndarray) -> None:
        """Take clock, counts and thickest lava from a report, and keep it."""
        self._report = report.copy()
        self.clock[:], self.counts[:] = report[CLOCK], report[COUNTS]
        self.thickest = float(report[THICKEST])

    def sample(self) -> ParticleSample:
        """Return the cells with lava as columns at their middles."""
        if not self._is_set:
            self._set(self.time)
        # a step that may not end is only begun
        clock = self.clock.copy()
        clock[MAX_END], clock[TARGET], clock[UNTIL] = clock[TIME], math.inf, math.inf
        clock[LONGEST] = self._longest_step
        self._launch(clock, 1)
        self.clock[WAITING] = 0.0
        return self.read_sample()

    def record(self) -> None:
        """Record the ground that lava covers now, if that is due."""
        if self._is_due:
            if not self._is_set:
                self._set(self.time)
            self._launch(self.clock, 0)

    def switch_effects(self, effects: Effects) -> None:
        """Continue with other effects.

        Raises:
            LavaError: If cells do not have one of them.
        """
        check_effects(effects)
        before, lava = self.effects, self.columns()
        self.effects = effects
        if effects.any('needs_age') and not before.any('needs_age'):
            # ages count from now
            lava.emission_time[:] = self.time
        # a film has not reached its cell, but lava that moves takes its age with it
        lava.emission_time[lava.emission_time == UNREACHED] = self.time
        self.heat.set_constants(self.scene, effects)
        self.put(lava)
        if not before.any('ages_in_place'):
            self._age_from_arrival()
        self._is_set, self._world = False, None

    def _age_from_arrival(self) -> None:
        """Let ages that count in place begin with the arrival of lava on the map."""
        if self.effects.any('ages_in_place'):
            arrived, terrain = read(self.covered.maps.arrived), self.scene.terrain
            part = averaged(arrived >= 0.0, terrain, self.grid)
            total = averaged(np.maximum(arrived, 0.0), terrain, self.grid)
            mean = total / np.maximum(part, 1e-9)
            fill(self.heat.emission_time, np.where(part > 0.0, mean, UNREACHED))

    def replace_vents(self, scene: Scene) -> None:
        """Continue with the vents of another scene; no lava waits in conduits."""
        now = self.time
        self.volume_before += self.vents.emitted(now)
        self.scene = scene
        self.open_vents(now)
        self._is_due = True

    def replace_terrain(self, scene: Scene) -> None:
        """Replace the terrain by that of another scene; lava outside it has left.

        Raises:
            LavaError: If the spacing is too small for the terrain. The previous one then remains.
        """
        self.record()
        now, former, grid, lava = self.time, self.state, self.grid, self.columns()
        peaks, attributes = self.peaks, dict(vars(self))
        self.scene = scene
        try:
            self._place_terrain()
        except BaseException:
            # a grid that is refused, or does not fit into memory
            vars(self).update(attributes)
            raise
        self.volume_before += self.vents.emitted(now)
        self.state.counts.assign(former.counts)
        moved = lava.convert(lambda values: averaged(values, grid, self.grid))
        area, new = grid.resolution**2, self.grid.resolution**2
        left = former.left.numpy() * area
        for before, after in (
            (lava.thickness, moved.thickness), (lava.solidified, moved.solidified)
        ):
            left[BORDER] += max(before.sum() * area - after.sum() * new, 0.0)
            for place, cells in (
                (SEA, self.grid.is_sea), (HOLES, np.isnan(self.grid.elevation))
            ):
                left[place] += after[cells].sum() * new
                after[cells] = 0.0
        self.state.left.assign(left / new)
        self.put(moved)
        self.peaks.move(peaks, lambda values: averaged(values, grid, self.grid))
        self._cover()
        self._age_from_arrival()
        self.open_vents(now)
        self._is_due = True

    def save(self) -> dict[str, np.ndarray]:
        """Copy all arrays that are needed to continue, by name, and the columns as particles."""
        self.record()
        sample = self.sample()
        rows = np.column_stack([
            sample.position - centre_of(self.scene.terrain), sample.volume, sample.temperature
        ])
        flow, heat = (
            {name: getattr(owner, name).numpy().copy() for name in names}
            for owner, names in ((self.state, _SAVED), (self.heat, _SAVED_HEAT))
        )
        return joined({
            'state': {'particle': rows}, 'cells': {'clock': self.clock[_TIMES], **flow},
            'heat': heat, 'arrived': self.covered.save(),
        })

    def load(self, checkpoint: Checkpoint) -> None:
        """Continue from a checkpoint of the same scene, effects and accuracy.

        Raises:
            LavaError: If an array is missing, or does not belong to the scene and the accuracy.
        """
        check_contents(checkpoint)
        parts = checkpoint.by_owner()
        del parts['state']['particle']
        arrived = parts.pop('arrived', None)

        def take(owner: str, name: str, array: np.ndarray) -> np.ndarray:
            found = parts.get(owner, {}).pop(name, None)
            return fitting(f'{owner}.{name}', found, array.shape, array.dtype)

        state, heat = self.state, self.heat
        for owner, target, names in (('cells', state, _SAVED), ('heat', heat, _SAVED_HEAT)):
            for name in names:
                array = getattr(target, name)
                array.assign(take(owner, name, array.numpy()))
        for name, array in (('cells.thickness', state.thickness), ('heat.frozen', heat.frozen)):
            if array.numpy().min() < 0.0:
                raise LavaError(f'checkpoint.{name}', float(array.numpy().min()), 'at least 0 m')
        box, last = state.box.numpy(), np.repeat(state.thickness.shape, 2) - 1
        if ((box < 0) | (box > last)).any():
            raise LavaError('checkpoint.cells.box', box.tolist(), f'from 0 to {last.tolist()}')
        times = take('cells', 'clock', self.clock[_TIMES])
        restored = state.fluidity, state.strength, state.peaks, heat.emission_time
        values = [array.numpy().copy() for array in restored]
        self.put(self.columns())
        # put rounds them, and knows no age nor where lava has been
        for array, value in zip(restored, values, strict=True):
            array.assign(value)
        self.clock[_TIMES], self.counts[:] = times, state.counts.numpy()
        self.thickest = float(state.peaks.numpy()[0])
        self._cover()
        if arrived is not None:
            self.covered.load(arrived)
        check_restored(checkpoint, joined(parts), self.time)
        self.volume_before = checkpoint.emitted
        self.open_vents(checkpoint.since)
        self._is_due = arrived is None
        check_conserved(self.budget())

