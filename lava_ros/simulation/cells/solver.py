# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The solver on cells behind a simulation, with the methods of the solver of particles.

It runs on a CPU, in one thread.
"""

from collections.abc import Generator, Iterable
from functools import lru_cache
import math
import time as wall_clock
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, Vent
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.cells.covered import Covered, note_function
from lava_ros.simulation.cells.flow import step_function
from lava_ros.simulation.cells.grid import deposit
from lava_ros.simulation.cells.heat import carries_heat
from lava_ros.simulation.cells.heated_step import heated_step_function
from lava_ros.simulation.cells.lava import CellLava, Columns, mixed
from lava_ros.simulation.cells.peaks import Highest, raise_function
from lava_ros.simulation.cells.state import (
    Cells,
    FULL,
    Heat,
    LENGTH,
    LONGEST,
    MAX_END,
    TARGET,
    TIME,
    UNTIL,
    WAITING,
)
from lava_ros.simulation.cells.vents import CellVents
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.checkpoint_contents import (
    check_conserved,
    check_contents,
    check_restored,
)
from lava_ros.simulation.output.snapshot import Particles, ParticleSample
from lava_ros.simulation.particles.layout import (
    BORDER,
    CELL_MAPS,
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


@lru_cache
def _kernel(effects: Effects, is_heated: bool) -> Any:
    """Return the kernel that takes steps, at most a number, and records what lava covers."""
    step = step_function(effects, is_uniform=True)
    heated_step, note = heated_step_function(effects) if is_heated else None, note_function()
    raise_row = raise_function()

    @wp.kernel(
        module='unique', enable_backward=False, grid_stride=False,
        module_options={'enable_backward': False},
    )
    def take_steps(s: Cells, m: Heat, c: Covered, k: Highest, most: int):
        for _ in range(most):
            if s.clock[TIME] >= s.clock[TARGET] or s.clock[WAITING] > wp.float64(0.0):
                break
            if wp.static(is_heated):
                heated_step(s, m)
            else:
                step(s)
            if s.clock[WAITING] == wp.float64(0.0):
                note(s, c)
                for row in range(s.box[0], s.box[1] + 1):
                    raise_row(s, m, k, row, s.box[2], s.box[3])

    return take_steps


@lru_cache
def _note_kernel() -> Any:
    note = note_function()

    @wp.kernel(module='unique', enable_backward=False, grid_stride=False)
    def note_lava(s: Cells, c: Covered):
        note(s, c)

    return note_lava


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
            LavaError: If the device is a GPU, an effect is on that cells do not have, or the
                accuracy limits the mobility.
        """
        if device.is_cuda:
            raise LavaError('device', str(device), 'cpu with method cells')
        check_effects(effects)
        if accuracy.mobility_limit is not None:
            expected = 'none with method cells; method particles has it'
            raise LavaError('mobility_limit', accuracy.mobility_limit, expected)
        super().__init__(scene, effects, accuracy, device)
        self._end, self._steps_at_once = math.inf, 16

    def start_with(self, particles: Particles | None) -> None:
        """Place the initial lava, and open the vents of the scene.

        Raises:
            LavaError: If lava is not on the terrain.
        """
        lava = self.columns()
        if particles is not None and len(particles.position):
            for index in np.flatnonzero(~self.scene.terrain.covered(particles.position))[:1]:
                where = tuple(particles.position[index].tolist())
                raise LavaError(f'particles.position[{index}]', where, 'a place on the terrain')
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
            lava = Columns(
                volumes / self.grid.resolution**2, warm, lava.emission_time, lava.solidified
            )
            self.volume_before = float(volume.sum())
        self.put(lava)
        self._cover()
        self.open_vents(0.0)
        self._note()

    def open_vents(self, since: float) -> None:
        """Put the vents of the scene on the cells, from a simulated time [s]."""
        assert self.accuracy.thickness is not None
        self.vents = CellVents(
            self.scene.vents, self.grid, since, rise=self.accuracy.thickness
        )
        self._is_set = False

    def _set(self, time: float) -> None:
        """Write the rates of emission from a time [s], and the window of the lava."""
        state, area = self.state, self.grid.resolution**2
        source, warmth = np.zeros((2, *self.grid.shape))
        rates = self.vents.rates(time)
        for vent, (cells, parts), rate in zip(
            self.vents.vents, self.vents.weights, rates, strict=True
        ):
            source.ravel()[cells] += parts * (rate / area)
            warmth.ravel()[cells] += parts * (rate / area) * vent.temperature
        ringed = np.pad(source, 1)
        state.source.assign(ringed)
        hottest = max((vent.temperature for vent in self.vents.vents), default=0.0)
        with np.errstate(invalid='ignore', divide='ignore'):
            hot = np.where(source > 0.0, warmth / source, hottest)
        if len({vent.temperature for vent in self.vents.vents}) == 1:
            # not the rounded mean of equal numbers
            hot[:] = hottest
        self.heat.vent_temperature.assign(np.pad(hot, 1).astype(np.float32))
        state.vent_box.assign(_box_of(ringed > 0.0))
        wet = _box_of((ringed > 0.0) | (state.stage.numpy() > np.float32(state.film)))
        if wet[1] >= wet[0]:
            last = np.repeat(np.array(ringed.shape, dtype=np.int32) - 1, 2)
            wet = np.clip(wet + np.array([-2, 2, -2, 2], dtype=np.int32), 0, last)
        box = state.box.numpy()
        if box[1] > box[0]:
            # the window never shrinks: the air also cools the cells where lava will be
            least, most = np.minimum(wet, box), np.maximum(wet, box)
            wet = np.where([True, False, True, False], least, most).astype(np.int32)
        state.box.assign(wet)
        self._make_arguments()
        self._longest_step = self._find_longest_step()
        self._is_set = True

    def _make_arguments(self) -> None:
        """Make the arguments of the kernels, and find out whether lava carries heat."""
        temperature, thickness = (
            array.numpy() for array in (self.heat.temperature, self.state.thickness)
        )
        temperatures = {vent.temperature for vent in self.vents.vents}
        temperatures |= set(np.unique(temperature[thickness > 0.0]).tolist())
        was_heated = getattr(self, '_is_heated', False)
        self._is_heated = carries_heat(self.scene, self.effects) or len(temperatures) > 1
        if self._is_heated and not was_heated:
            self.heat.former.assign(thickness.astype(np.float32))
        elif not self._is_heated and temperatures:
            self.heat.temperature.fill_(temperatures.pop())
            self._write_laws()
        covered = Covered()
        covered.rows, covered.columns = self.scene.terrain.shape
        covered.scale = self.scene.terrain.resolution / self.grid.resolution
        covered.threshold = self.accuracy.inundation_threshold
        covered.known = self._known
        for name in CELL_MAPS:
            setattr(covered, name, getattr(self.covered.maps, name))
        flow, heat = self.state.argument(), self.heat.argument()
        self._arguments = flow, heat, covered, self.peaks.highest

    def advancing_to(
        self, until: float, end: float | None, deadline: float, max_end: float = math.inf
    ) -> Generator[None, None, Stop]:
        """Advance to a time, as ``advance.advancing_to``; no step is ever incomplete."""
        self._end = self._end if end is None else end
        clock = self.state.clock.numpy()
        clock[WAITING] = 0.0
        while clock[TIME] < until and wall_clock.monotonic() < deadline:
            time = float(clock[TIME])
            if not self._is_set:
                self._set(time)
            change = self.vents.next_change(time)
            stop = min(self._end, change)
            clock[LONGEST], clock[MAX_END] = self._longest_step, max_end
            clock[UNTIL], clock[TARGET] = stop, min(until, stop)
            if self.is_empty and not self.vents.rates(time).any():
                # nothing moves
                clock[TIME] = min(until, stop)
            else:
                self._take_steps()
                if clock[WAITING] > 0.0:
                    break
            if clock[TIME] >= change:
                self._is_set = False
            yield
        is_step_pending = bool(clock[WAITING] > 0.0)
        step = clock[WAITING] if is_step_pending else clock[FULL]
        clock[WAITING] = 0.0
        return Stop(float(clock[TIME]), float(step), is_step_pending)

    def _find_longest_step(self) -> float:
        """Return the longest step that the user, the effects and conduction allow [s]."""
        cell = self.grid.resolution
        own = longest_step(self.scene, self.accuracy, self.effects, cell)
        return min(own, self.heat.longest_step(cell))

    def _take_steps(self) -> None:
        """Take some steps, for about ``_LAUNCH_TIME``."""
        begun, before = wall_clock.perf_counter(), self.steps
        wp.launch(
            _kernel(self.effects, self._is_heated), dim=1,
            inputs=[*self._arguments, self._steps_at_once], device=self.device,
        )
        spent = (wall_clock.perf_counter() - begun) / max(self.steps - before, 1)
        self._steps_at_once = min(max(int(_LAUNCH_TIME / spent), 1), _MAX_STEPS)

    def sample(self) -> ParticleSample:
        """Return the cells with lava as columns at their middles."""
        if not self._is_set:
            self._set(self.time)
        # a step that may not end is only begun
        clock = self.state.clock.numpy()
        clock[MAX_END], clock[TARGET], clock[UNTIL] = clock[TIME], math.inf, math.inf
        clock[LONGEST] = self._longest_step
        wp.launch(
            _kernel(self.effects, self._is_heated), dim=1, inputs=[*self._arguments, 1],
            device=self.device,
        )
        clock[WAITING] = 0.0
        return self.read_sample()

    def _note(self) -> None:
        """Record the ground that lava covers now."""
        if not self._is_set:
            self._set(self.time)
        flow, _, covered, _ = self._arguments
        wp.launch(_note_kernel(), dim=1, inputs=[flow, covered], device=self.device)

    # what the solver of particles does between steps, and cells need not

    def order(self) -> None:
        """Do nothing: cells have an order."""

    sort = settle = forget = lower_top = order

    def raise_top(self, *, until: float | None = None) -> None:
        """Do nothing: the speed has no bound of free fall."""

    def skip_to(self, until: float, end: float) -> None:
        """Do nothing: ``advancing_to`` skips the time without lava."""

    def check_rates(self, vents: Iterable[Vent]) -> None:
        """Accept any discharge."""

    def add_particles(self, rows: list[Any]) -> None:
        """Do nothing: no lava waits in conduits."""

    def switch_effects(self, effects: Effects) -> None:
        """Continue with other effects.

        Raises:
            LavaError: If cells do not have one of them.
        """
        check_effects(effects)
        needed_age, lava = self.effects.any('needs_age'), self.columns()
        self.effects = effects
        if effects.any('needs_age') and not needed_age:
            # ages count from now
            lava.emission_time[:] = self.time
        constants = type(self.heat).on(self.state, self.scene, effects)
        self.heat.law, self.heat.constants = constants.law, constants.constants
        self.heat.diffusivity = constants.diffusivity
        self.put(lava)
        self._is_set = False

    def replace_vents(self, scene: Scene) -> list[Any]:
        """Continue with the vents of another scene; no lava waits in conduits."""
        now = self.time
        self.volume_before += self.vents.emitted(now)
        self.scene = scene
        self.open_vents(now)
        self._note()
        return []

    def replace_terrain(self, scene: Scene) -> None:
        """Replace the terrain by that of another scene; lava outside it has left."""
        now, former, grid, lava = self.time, self.state, self.grid, self.columns()
        peaks = self.peaks
        self.volume_before += self.vents.emitted(now)
        self.scene = scene
        self._place_terrain()
        self.state.clock.assign(former.clock)
        self.state.counts.assign(former.counts)
        moved = mixed(lava, lambda values: averaged(values, grid, self.grid))
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
        self.open_vents(now)
        self._note()

    def save(self) -> dict[str, np.ndarray]:
        """Copy all arrays that are needed to continue, by name, and the columns as particles."""
        sample = self.sample()
        rows = np.column_stack([
            sample.position - centre_of(self.scene.terrain), sample.volume, sample.temperature
        ])
        return {
            'state.particle': rows,
            'cells.clock': self.state.clock.numpy()[_TIMES],
            **{f'cells.{name}': getattr(self.state, name).numpy().copy() for name in _SAVED},
            **{f'heat.{name}': getattr(self.heat, name).numpy().copy() for name in _SAVED_HEAT},
            **{f'arrived.{name}': item for name, item in self.covered.save().items()},
        }

    def load(self, checkpoint: Checkpoint) -> None:
        """Continue from a checkpoint of the same scene, effects and accuracy.

        Raises:
            LavaError: If an array is missing, or does not belong to the scene and the accuracy.
        """
        check_contents(checkpoint)
        arrays = dict(checkpoint.arrays)
        del arrays['state.particle']

        def take(owner: str, name: str, array: np.ndarray) -> np.ndarray:
            key = f'{owner}.{name}'
            return fitting(key, arrays.pop(key, None), array.shape, array.dtype)

        state, heat = self.state, self.heat
        for owner, target, names in (('cells', state, _SAVED), ('heat', heat, _SAVED_HEAT)):
            for name in names:
                array = getattr(target, name)
                array.assign(take(owner, name, array.numpy()))
        for name, array in (('cells.thickness', state.thickness), ('heat.frozen', heat.frozen)):
            if array.numpy().min() < 0.0:
                raise LavaError(f'checkpoint.{name}', float(array.numpy().min()), 'at least 0 m')
        times = take('cells', 'clock', state.clock.numpy()[_TIMES])
        fluidity, strength, peaks = (
            getattr(state, name).numpy().copy() for name in ('fluidity', 'strength', 'peaks')
        )
        self.put(self.columns())
        # put rounds them, and knows no age
        state.fluidity.assign(fluidity)
        state.strength.assign(strength)
        state.peaks.assign(peaks)
        state.clock.numpy()[_TIMES] = times
        arrived = {
            name.removeprefix('arrived.'): arrays.pop(name) for name in [*arrays]
            if name.startswith('arrived.')
        }
        self._cover()
        if arrived:
            self.covered.load(arrived)
        check_restored(checkpoint, arrays, self.time)
        self.volume_before = checkpoint.emitted
        self.open_vents(checkpoint.since)
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
