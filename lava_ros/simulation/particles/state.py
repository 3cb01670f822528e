# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The arrays of a simulation on its device."""

from collections.abc import Callable, Mapping
import math
from typing import Any, TYPE_CHECKING

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.effects.effect import Array
from lava_ros.errors import LavaError
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.backend.memory import forget_failure, read, Readback, zeros
from lava_ros.simulation.particles import layout as at

#: Threads on a GPU of a kernel that rarely has work: it must cost little when it has none.
RARE_THREADS = 65536

#: Particle counts up to which this many threads suffice; there may be many small simulations.
_FEW_RARE = 4096, 16384

#: Threads of such a kernel in a batch, for members of any size.
RARE_THREADS_TOGETHER = 1024

#: Maximum fraction of the capacity in use before it grows. Threads without a particle cost time,
#: so there is little spare capacity; a vent that finds none waits until it has grown.
FULLEST = 0.875

#: Capacity below which growing doubles it [particles].
FEW = 16384

#: Threads per particle on a GPU, and the maximum capacity for which they are worthwhile.
SHARED_LANES, SHARED_UP_TO = 4, 50_000

#: Threads that a GPU holds at once, idle ones included, with ``compiled.FEW_THREADS`` on 132
#: processors. At or below this number latency dominates: registers are then not scarce, and
#: launches are expensive.
AT_ONCE = 150_000


class State:
    """Every device array that depends on the number of particles, and the clock.

    Positions are kept relative to the terrain's centre. float32 resolves 1 mm at 10 km.
    ``remainder`` carries the rounding error of each step to the next (compensated summation).

    Attributes:
        particle: x, y [m], volume [m3], temperature [K] of each particle. Arrays up to ``surface``
            have the shape [capacity].
        cell, rank: Cell of each particle and its rank there.
        members: Only when deterministic on a GPU: the particles of each cell, unsorted.
        ordered: ``particle`` in the order of the neighbour grid's cells.
        remainder: Only in float32: rounding error of each particle's position [m]. Without it slow
            lava far from the centre would never move.
        temperature_remainder: Only in float32, if temperatures change: rounding error of each
            particle's temperature [K]. Without it lava would not cool in short steps.
        emission_time: Only if an effect needs the age of lava: simulated time at which each
            particle was emitted [s], float64. An age is the clock minus this time.
        velocity: Only if an effect needs it: velocity of each particle in the middle of the latest
            step [m/s].
        slope: Only if an effect needs it: gradient of the surface at each ordered particle.
        base: Position at the start of the step [m] and displacement since then two stages ago [m],
            of each particle; absent with the Euler integrator.
        drift: Displacement one stage ago [m] and velocity at the start of the step [m/s]; absent
            with the Euler integrator.
        mean_temperature: Only if the speed depends on temperature: mean temperature around each
            particle at the start of the step [K].
        flow: Thickness [m], velocity x and y [m/s], of each ordered particle.
        share: Contribution of each ordered particle to a map: to a cell of unit weight, before the
            kernel's weight [m^(1/2)], or to the single cell in ``home`` [m].
        home: Number of the single cell that receives an ordered particle's volume, -1 if several
            do.
        surface: Only if the gradient uses differences: elevation of the surface [m] and the area
            V/h [m2] of each ordered particle.
        clock: Simulated time, step, target time, latest full step (while stages idle because the
            next step would end too late: that step) and, with inertia, the previous step [s],
            float64.
        limit_time: Time that no step may pass, at or after the target, and time after which no
            step may end: one that would is not begun [s], float64; not in checkpoints.
        counts: Particles; steps; the limit of the latest step; 1 if the capacity was reached; the
            current stage (0 at the last one); the stages of the step; 1 if the stage is the last;
            the velocity evaluations so far; the current stage including the last (0 past the
            target, where stages idle); the sides of the neighbour grid's window that particles are
            near (sum of 1 west, 2 south, 4 east, 8 north); and the particles emitted since the
            cells were built, which are not in the first count.
        chosen: 1 from when a stage is chosen within its motion (fused_stage.py) until its end.
        stage: Weights of the current stage.
        rates: Reciprocal of the step each limit allows [1/s].
        top: Elevation of the highest ground that lava came from, above the terrain's mean [m].
        left: Volume that has left the terrain [m3], float64.
        arrived: Time at which lava touched each cell of the terrain [s], -1 before, float32, shape
            [rows, columns]; kept by ``CoveredCells``, as the next three.
        half_inundated: Time at which lava had covered half of each cell [s], -1 before, float32.
        covered: Squares of each cell that lava has covered, one bit each, int32.
        bounds: Rectangle of all cells in which particles have been: rows from its first one to the
            terrain's end, rows up to its last one, and the same for columns; 0 without, int32.

    Effects declare their additional arrays in their own files (``Effect.arrays``).
    """

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...  # noqa: D105

    def __init__(
        self, capacity: int, effects: Effects, accuracy: Accuracy, device: Any
    ) -> None:
        """Allocate for ``capacity`` particles."""
        forget_failure(device)
        self.real = at.REAL[accuracy.precision]
        self.effects = effects
        self.has_velocity = effects.any('needs_velocity')
        self.is_staged = accuracy.integrator != 'euler' and not self.has_velocity
        self.order = 1 if accuracy.integrator == 'rkl1' else 2
        self.has_remainder = accuracy.precision == 'float32'
        self.has_temperature_remainder = self.has_remainder and bool(effects.having('terms'))
        self.is_deterministic = accuracy.deterministic
        # a step of fixed length is not limited
        self.is_guarded = accuracy.fixed_step is None
        self.has_mean = effects.any('stiffens')
        self.has_age = effects.any('needs_age')
        # particles that have frozen or merged into another have no volume and are dropped
        self.has_empty = effects.any('removes_particles')
        # without a pass after the motion, the motion itself assigns the particles to cells
        self.bins_in_motion = not self.has_empty
        # the pairwise energy gradient conserves momentum, which a bore needs
        self.has_surface = accuracy.gradient != 'energy' and not self.has_velocity
        self.device = device
        self.launches = Launches(device)
        #: Maximum number of particles that vents emit before the host reads the counts again.
        self.particles_ahead = 0
        self._allocate(capacity)
        self.top.fill_(-at.FAR)
        if not device.is_cuda:
            # a view of the current values: creating it takes 10 us
            self._seen_counts = self.counts.numpy()
        self._time, self._target = (
            self.clock[place : place + 1] for place in (at.TIME, at.TARGET)
        )
        self._limit, self._max_end = (
            self.limit_time[place : place + 1] for place in (at.LIMIT_TIME, at.MAX_END)
        )
        self._limits = math.nan, math.nan
        self._readbacks = [Readback((self.clock, self.counts))]

    @property
    def _arrays(self) -> dict[str, Array]:
        """Specifications of all arrays of this state, by name: its own and its effects'."""
        is_needed = {
            'emission_time': self.has_age,
            'velocity': self.has_velocity,
            'slope': self.effects.any('needs_drop'),
            'remainder': self.has_remainder,
            'temperature_remainder': self.has_temperature_remainder,
            'surface': self.has_surface,
            'base': self.is_staged,
            'drift': self.is_staged,
            'mean_temperature': self.has_mean,
            'members': self.is_ranked_again,
        }
        own = {name: array for name, array in at.ARRAYS.items() if is_needed.get(name, True)}
        return own | self.effects.arrays

    def _allocate(self, capacity: int) -> None:
        """Allocate the arrays of some particles; keep those that do not depend on the number."""
        kinds, items, others = at.kinds_of(self.real), {}, {}
        for name, array in self._arrays.items():
            dtype = kinds[array.dtype]
            if array.count is None:
                items[name] = dtype, capacity
            elif not hasattr(self, name):
                others[name] = dtype, array.count
            if array.is_carried:
                items[f'ordered_{name}'] = dtype, capacity
        arrays = zeros(items, self.device, spare=at.SPARE) | zeros(others, self.device)
        self.launches.forget()
        vars(self).update(arrays, capacity=capacity)

    @property
    def extent(self) -> int:
        """Number of particles that a launch covers: on a GPU the whole capacity."""
        if self.device.is_cuda:
            return self.capacity
        if self.launches.is_capturing:
            return self.launches.extent
        return int(self._seen_counts[at.PARTICLES] + self._seen_counts[at.NEWCOMERS])

    @property
    def is_ranked_again(self) -> bool:
        """True if particles rank in their cells by number, not in the order of GPU atomics."""
        return self.is_deterministic and self.device.is_cuda

    @property
    def parts(self) -> int:
        """Number of parts in which a particle's neighbours are summed, which threads can share."""
        return SHARED_LANES if self.device.is_cuda and self.capacity <= SHARED_UP_TO else 1

    @property
    def lanes(self) -> int:
        """Threads per particle: one for each part, because few particles do not fill a GPU.

        A batch does fill it (batched_launches.py); its launches are recorded.
        """
        return 1 if self.launches.is_capturing else self.parts

    @property
    def is_short(self) -> bool:
        """True if a GPU runs all threads of a pass over the particles at once."""
        is_alone = self.device.is_cuda and not self.launches.is_capturing
        return is_alone and self.capacity * self.lanes <= AT_ONCE

    @property
    def is_wide(self) -> bool:
        """True if sums over neighbours process several of them at a time (simd.py)."""
        return not self.device.is_cuda and self.real is wp.float32

    @property
    def rare_threads(self) -> int:
        """Threads of a kernel that rarely has work; each processes every n-th item."""
        if not self.device.is_cuda:
            return 1
        if self.launches.is_capturing:
            # all members of a batch must run the same kernels
            return RARE_THREADS_TOGETHER
        # each different number is a separate kernel
        return next((few for few in _FEW_RARE if self.capacity <= few), RARE_THREADS)

    def emitting_threads(self, most: int) -> int:
        """Return the number of emitting threads: one gives the same order in every run."""
        return most if self.device.is_cuda and not self.is_deterministic else 1

    def read_clock(self) -> tuple[np.ndarray, np.ndarray]:
        """Return copies of ``clock`` and ``counts`` after all earlier launches on this stream."""
        return self._readbacks[0].begin()()

    def begin_readback(self) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        """Start to copy them; return a function that waits, to be called before a third copy."""
        # page-locked memory is slow to allocate, and a member of a batch needs none of these
        while len(self._readbacks) < 3:
            self._readbacks.append(Readback((self.clock, self.counts)))
        self._readbacks[1:] = reversed(self._readbacks[1:])
        return self._readbacks[1].begin()

    def make_room(self, counts: np.ndarray) -> None:
        """Grow if a copy of ``counts`` shows that it is necessary."""
        if self.needs_room(counts):
            # spare capacity is cheap while there are few particles
            twice = 2 * self.capacity if self.capacity < FEW else 0
            expected = at.count_in(counts) + self.particles_ahead
            self.grow(max(room_for(expected), room_for(self.capacity), twice))

    def needs_room(self, counts: np.ndarray) -> bool:
        """Return True if the capacity is almost used up or a vent found none."""
        return bool(counts[at.FULL] or at.count_in(counts) > self.growth_threshold)

    @property
    def growth_threshold(self) -> float:
        """Maximum number of particles for which the capacity suffices until the next readback."""
        return FULLEST * self.capacity - self.particles_ahead

    def grow(self, capacity: int) -> None:
        """Grow to a capacity of ``capacity`` particles and keep the existing ones.

        Raises:
            RuntimeError: If memory is insufficient; the state is then unchanged.
        """
        names = 'particle', 'cell', 'rank', *self._carried, *self._of_step
        kept = {name: getattr(self, name) for name in names}
        count = min(self.capacity, capacity)
        try:
            self._allocate(capacity)
        except RuntimeError as error:
            forget_failure(self.device)
            raise RuntimeError(f'room for {capacity} particles: {error}') from error
        # copies the full old capacity, which avoids waiting for the number of particles
        for name, values in kept.items():
            wp.copy(getattr(self, name), values, count=count)
        self.write_count(at.FULL, 0)

    @property
    def _carried(self) -> list[str]:
        """Names of the arrays that particles carry from step to step, each with a twin."""
        of_step, arrays = ('base', 'drift', 'mean_temperature'), self._arrays.items()
        return [name for name, array in arrays if array.is_carried and name not in of_step]

    @property
    def _of_step(self) -> tuple[str, ...]:
        """Names of the arrays that particles carry from stage to stage of a step."""
        names = ('base', 'drift') if self.is_staged else ()
        return (*names, 'mean_temperature') if self.has_mean else names

    def _put(self, name: str, values: np.ndarray) -> None:
        """Replace the first items of an array."""
        # a count of 0 would copy everything
        if len(values):
            array = getattr(self, name)
            rows = wp.array(values, dtype=array.dtype, device=self.device)
            wp.copy(array, rows, count=len(values))

    def write_target(
        self, time: float, limit: float | None = None, max_end: float = math.inf
    ) -> None:
        """Replace the target time of ``clock`` and, if ``limit`` is given, ``limit_time`` [s].

        Stages that have been launched already still use the previous values.
        """
        self._target.fill_(time)
        # a fill is a launch, and members of an ensemble have the same limits for all their parts
        if limit is not None and (limit, max_end) != self._limits:
            self._limit.fill_(limit)
            self._max_end.fill_(max_end)
            self._limits = limit, max_end

    def write_time(self, time: float) -> None:
        """Replace the simulated time [s], between two steps."""
        self._time.fill_(time)

    def write_count(self, place: int, value: int) -> None:
        """Replace one of the ``counts``."""
        self.counts[place : place + 1].fill_(value)

    @property
    def count(self) -> int:
        """Number of particles (read back from the device)."""
        return at.count_in(self.read_clock()[1])

    def write_particles(self, values: np.ndarray) -> None:
        """Replace all particles by rows of (x, y from the centre, volume, temperature), float64.

        The first rows are the existing particles: they keep their velocity and emission time. The
        new ones are emitted now.
        """
        count = min(self.count, len(values))
        kept = {name: read(getattr(self, name)[:count]) for name in self._carried if count}
        if self.has_remainder:
            kept['remainder'] = values[:, :2] - values[:, :2].astype(np.float32)
        if self.has_temperature_remainder:
            kept['temperature_remainder'] = values[:, 3] - values[:, 3].astype(np.float32)
        if len(values) > FULLEST * self.capacity:
            self._allocate(room_for(len(values)))
        self._put('particle', values)
        for name in self._carried:
            getattr(self, name).zero_()
        self._begin_ages()
        for name, former in kept.items():
            self._put(name, former)
        self.write_count(at.PARTICLES, len(values))
        self.write_count(at.NEWCOMERS, 0)

    def take_over(self, former: 'State') -> None:
        """Adopt the data of another state with other effects, as far as both have them."""
        carried = set(self._carried) & set(former._carried)
        for name in ('particle', *carried, 'clock', 'counts', 'top', 'left'):
            wp.copy(getattr(self, name), getattr(former, name))
        vars(self).update({name: getattr(former, name) for name in at.CELL_MAPS})
        if not former.has_age:
            self._begin_ages()

    def _begin_ages(self) -> None:
        """Let all lava count as emitted now, if an effect needs its age."""
        if self.has_age:
            self.emission_time.fill_(self.read_clock()[0][at.TIME])

    def save(self) -> dict[str, np.ndarray]:
        """Copy all arrays that the next step depends on, between two steps, by name."""
        count = self.count
        arrays = {
            name: read(getattr(self, name))[:count]
            for name in ('particle', *self._carried)
        }
        return arrays | {name: read(getattr(self, name)) for name in self._sums}

    def load(self, arrays: Mapping[str, np.ndarray], capacity: int) -> None:
        """Restore the arrays that ``save`` has copied, with the same capacity.

        Raises:
            LavaError: If an array is missing or has the wrong shape or type.
        """
        count = len(arrays['particle'])
        self._allocate(capacity)
        for name in ('particle', *self._carried, *self._sums):
            # reading the array itself would wait for the device
            array = getattr(self, name)
            item = wp.empty(0, dtype=array.dtype, device='cpu').numpy()
            shape = (*(array.shape if name in self._sums else (count,)), *item.shape[1:])
            self._put(name, at.fitting(f'state.{name}', arrays.get(name), shape, item.dtype))
        _, counts = self.read_clock()
        if (counts[at.PARTICLES], counts[at.NEWCOMERS], counts[at.STAGE]) != (count, 0, 0):
            expected = f'{count} particles, between two steps'
            raise LavaError('checkpoint.state.counts', counts.tolist(), expected)

    @property
    def _sums(self) -> list[str]:
        """Names of the arrays that do not depend on the number of particles."""
        items = self.effects.arrays.items()
        kept = [name for name, array in items if array.is_saved]
        return ['clock', 'counts', 'rates', 'stage', 'top', 'left', *kept]

    def take_order(self, *, within_step: bool = False) -> None:
        """Copy the ordered arrays back to the particles, also possible within a step."""
        wp.copy(self.particle, self.ordered)
        for name in (*self._carried, *(self._of_step if within_step else ())):
            wp.copy(getattr(self, name), getattr(self, f'ordered_{name}'))

    def read_particles(self) -> np.ndarray:
        """Return rows of (x, y, volume, temperature), float64, x and y from the centre."""
        count = self.count
        if not count:
            return np.empty((0, 4))
        rows = read(self.particle[:count]).astype(np.float64)
        if self.has_remainder:
            rows[:, :2] += read(self.remainder[:count])
        if self.has_temperature_remainder:
            rows[:, 3] += read(self.temperature_remainder[:count])
        return rows


def room_for(count: int) -> int:
    """Return the capacity for some particles: whole blocks of threads, a third of them spare."""
    return 256 * math.ceil(max(4 * count / 3, 1) / 256)
