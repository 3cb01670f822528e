# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The arrays of a simulation on its device."""

from collections.abc import Callable, Mapping
from functools import lru_cache
import math
from typing import Any

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.backend.memory import ArrayBlock, forget_failure, read, Readback
from lava_ros.simulation.particles import layout as at
from lava_ros.simulation.particles.layout import Arrays, CellMaps

#: Threads on a GPU of a kernel that rarely has work: it must cost little when it has none.
RARE_THREADS = 65536

#: Particle counts up to which this many threads suffice; there may be many small simulations.
_FEW_RARE = 4096, 16384

#: Threads of such a kernel in a batch, for members of any size.
RARE_THREADS_TOGETHER = 1024

#: Maximum fraction of the capacity in use before it grows. Threads without a particle cost time,
#: so there is little spare capacity; a vent that finds none waits until it has grown.
MAX_FILL = 0.875

#: Capacity below which growing doubles it [particles].
FEW_PARTICLES = 16384

#: Threads per particle on a GPU, and the maximum capacity for which they are worthwhile.
SHARED_LANES, SHARED_UP_TO = 4, 50_000

#: Threads that a GPU holds at once, idle ones included, with ``compiled.FEW_THREADS`` on 132
#: processors. At or below this number latency dominates: registers are then not scarce, and
#: launches are expensive.
AT_ONCE = 150_000


class State(Arrays):
    """The particles of a simulation on its device, every array of a step, and the clock.

    Positions are kept relative to the terrain's centre. float32 resolves 1 mm at 10 km.
    ``remainder`` carries the rounding error of each step to the next (compensated summation).
    ``layout.Arrays`` declares the arrays.

    Attributes:
        capacity: Number of particles for which arrays are allocated.
        cell_maps: The ground that lava has covered; kept by ``CoveredCells``.
        form: Properties for which kernels are compiled.
    """

    capacity: int

    def __init__(self, capacity: int, effects: Effects, accuracy: Any, device: Any) -> None:
        """Allocate for ``capacity`` particles and an ``Accuracy``."""
        super().__init__()
        forget_failure(device)
        self.effects, self.device = effects, device
        self.is_deterministic = accuracy.deterministic
        has_velocity, is_single = effects.any('needs_velocity'), accuracy.precision == 'float32'
        is_staged = accuracy.integrator != 'euler' and not has_velocity
        self.form = form = at.Form(
            real=at.REAL[accuracy.precision],
            order=2 if is_staged and accuracy.integrator == 'rkl2' else 1,
            is_staged=is_staged,
            is_guarded=accuracy.fixed_step is None,
            has_velocity=has_velocity,
            has_remainder=is_single,
            has_temperature_remainder=is_single and bool(effects.having('terms')),
            has_mean=effects.any('stiffens'),
            has_age=effects.any('needs_age'),
            has_slope=effects.any('needs_drop'),
            has_surface=accuracy.gradient != 'energy' and not has_velocity,
            has_empty=effects.any('removes_particles'),
            is_ranked_again=accuracy.deterministic and device.is_cuda,
        )
        self.real = form.real
        self.launches = Launches(device)
        #: Maximum number of particles that vents emit before the host reads the counts again.
        self.particles_ahead = 0
        self._declared = at.declared_arrays(form, effects)
        declared = self._declared.items()
        #: Names of the arrays that particles carry from stage to stage of a step, and from step to
        #: step, and of the others in checkpoints.
        self._of_step = [name for name, one in declared if one.is_of_step]
        self._carried = [
            name for name, one in declared if one.is_carried and not one.is_of_step
        ]
        self._saved = [name for name, one in declared if one.is_saved]
        self.cell_maps = CellMaps()
        self._arrays: dict[str, wp.array] = {}
        self._allocate(capacity)
        self.top.fill_(-at.FAR)
        if not device.is_cuda:
            # a view of the current values: creating it takes 10 us
            self._counts_view = self.counts.numpy()
        self._time, self._target = (
            self.clock[place : place + 1] for place in (at.TIME, at.TARGET)
        )
        self._limit, self._max_end = (
            self.limit_time[place : place + 1] for place in (at.LIMIT_TIME, at.MAX_END)
        )
        self._limits = math.nan, math.nan
        self._readbacks = [Readback((self.clock, self.counts))]
        #: The latest readback, and the number of launches before it.
        self._latest = np.zeros(self.clock.size), np.zeros(self.counts.size, dtype=np.int32)
        self._read_after = self.launches.launched

    @property
    def arrays(self) -> dict[str, wp.array]:
        """All arrays, by the names that kernels use."""
        return self._arrays | vars(self.cell_maps)

    @property
    def bytes_per_particle(self) -> int:
        """Memory of the arrays for each particle [bytes]."""
        kinds = at.kinds_of(self.real)
        types = [kinds[one.dtype] for one in self._declared.values() if one.shape == ('particle',)]
        return sum(map(wp.types.type_size_in_bytes, types))

    def _allocate(self, capacity: int) -> None:
        """Allocate the arrays of some particles; keep those that do not depend on the number."""
        kinds, items, others = at.kinds_of(self.real), {}, {}
        for name, one in self._declared.items():
            (length,) = one.shape
            if length == 'particle':
                items[name] = kinds[one.dtype], (capacity,)
            elif name not in self._arrays:
                others[name] = kinds[one.dtype], (length,)
        blocks = ((some, ArrayBlock(some, self.device)) for some in (items, others))
        arrays = {name: block[name] for some, block in blocks for name in some}
        self.launches.forget()
        self._arrays |= arrays
        for name, array in arrays.items():
            setattr(self, name, array)
        self.capacity = capacity

    @property
    def extent(self) -> int:
        """Number of particles that a launch covers: on a GPU the whole capacity."""
        if self.device.is_cuda:
            return self.capacity
        if self.launches.is_capturing:
            return self.launches.extent
        return int(self._counts_view[at.PARTICLES] + self._counts_view[at.NEWCOMERS])

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

    def emitting_threads(self, max_threads: int) -> int:
        """Return the number of emitting threads: one gives the same order in every run."""
        return max_threads if self.device.is_cuda and not self.is_deterministic else 1

    def read_clock(self) -> tuple[np.ndarray, np.ndarray]:
        """Return copies of ``clock`` and ``counts`` after all earlier launches on this stream."""
        # a GPU waits for the launches of all members of a batch: not if there is nothing new
        launched = self.launches.launched
        if launched is None or launched != self._read_after:
            self._latest, self._read_after = self._readbacks[0].begin()(), launched
        clock, counts = self._latest
        return clock.copy(), counts.copy()

    def begin_readback(self) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        """Start to copy ``clock`` and ``counts``; return a function that waits for the copies.

        Call that function before a third copy is started.
        """
        # page-locked memory is slow to allocate, and a member of a batch needs none of these
        while len(self._readbacks) < 3:
            self._readbacks.append(Readback((self.clock, self.counts)))
        self._readbacks[1:] = reversed(self._readbacks[1:])
        return self._readbacks[1].begin()

    def make_room(self, counts: np.ndarray) -> None:
        """Grow if a copy of ``counts`` shows that it is necessary."""
        if self.needs_room(counts):
            # spare capacity is cheap while there are few particles
            twice = 2 * self.capacity if self.capacity < FEW_PARTICLES else 0
            expected = at.count_in(counts) + self.particles_ahead
            self.grow(max(room_for(expected), room_for(self.capacity), twice))

    def needs_room(self, counts: np.ndarray) -> bool:
        """Return True if the capacity is almost used up or a vent found none."""
        return bool(counts[at.FULL] or at.count_in(counts) > self.growth_threshold)

    @property
    def growth_threshold(self) -> float:
        """Maximum number of particles for which the capacity suffices until the next readback."""
        return MAX_FILL * self.capacity - self.particles_ahead

    def grow(self, capacity: int) -> None:
        """Grow to a capacity of ``capacity`` particles and keep the existing ones.

        Raises:
            RuntimeError: If memory is insufficient; the state is then unchanged.
        """
        names = 'particle', 'cell', 'rank', *self._carried, *self._of_step
        arrays = self.arrays
        kept = {name: arrays[name] for name in names}
        count = min(self.capacity, capacity)
        try:
            self._allocate(capacity)
        except RuntimeError as error:
            forget_failure(self.device)
            raise RuntimeError(f'room for {capacity} particles: {error}') from error
        # copies the full old capacity, which avoids waiting for the number of particles
        for name, values in kept.items():
            wp.copy(self.arrays[name], values, count=count)
        self.write_count(at.FULL, 0)

    def write_target(
        self, time: float, limit: float | None = None, max_end: float = math.inf
    ) -> None:
        """Replace the target time of ``clock`` and, if ``limit`` is given, ``limit_time`` [s].

        Stages that have been launched already still use the previous values.
        """
        self.launches.note_launch()
        self._target.fill_(time)
        # a fill is a launch, and members of an ensemble have the same limits for all their parts
        if limit is not None and (limit, max_end) != self._limits:
            self._limit.fill_(limit)
            self._max_end.fill_(max_end)
            self._limits = limit, max_end

    def write_time(self, time: float) -> None:
        """Replace the simulated time [s], between two steps."""
        self.launches.note_launch()
        self._time.fill_(time)

    def write_count(self, place: int, value: int) -> None:
        """Replace one of the ``counts``."""
        self.launches.note_launch()
        self.counts[place : place + 1].fill_(value)

    @property
    def time(self) -> float:
        """Simulated time [s] (read back from the device)."""
        return float(self.read_clock()[0][at.TIME])

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
        arrays = self.arrays
        kept = {name: read(arrays[name][:count]) for name in self._carried if count}
        if self.form.has_remainder:
            kept['remainder'] = values[:, :2] - values[:, :2].astype(np.float32)
        if self.form.has_temperature_remainder:
            kept['temperature_remainder'] = values[:, 3] - values[:, 3].astype(np.float32)
        if len(values) > MAX_FILL * self.capacity:
            self._allocate(room_for(len(values)))
        _put(self.particle, values)
        for name in self._carried:
            self.arrays[name].zero_()
        self._begin_ages()
        for name, former in kept.items():
            _put(self.arrays[name], former)
        self.write_count(at.PARTICLES, len(values))
        self.write_count(at.NEWCOMERS, 0)

    def take_over(self, former: 'State') -> None:
        """Adopt the data of another state with other effects, as far as both have them."""
        carried = set(self._carried) & set(former._carried)
        self.launches.note_launch()
        for name in ('particle', *carried, 'clock', 'counts', 'top', 'left'):
            wp.copy(self.arrays[name], former.arrays[name])
        self.cell_maps = former.cell_maps
        if not former.form.has_age:
            self._begin_ages()

    def _begin_ages(self) -> None:
        """Let all lava count as emitted now, if an effect needs its age."""
        if self.form.has_age:
            self.emission_time.fill_(self.read_clock()[0][at.TIME])

    def save(self) -> dict[str, np.ndarray]:
        """Copy all arrays that the next step depends on, between two steps, by name."""
        count, arrays = self.count, self.arrays
        carried = {name: read(arrays[name])[:count] for name in ('particle', *self._carried)}
        return carried | {name: read(arrays[name]) for name in self._saved}

    def load(self, arrays: Mapping[str, np.ndarray], capacity: int) -> None:
        """Restore the arrays that ``save`` has copied, with the same capacity.

        Raises:
            LavaError: If an array is missing or has the wrong shape or type.
        """
        count = len(arrays['particle'])
        if capacity != self.capacity:
            self._allocate(capacity)
        self.launches.note_launch()
        own = self.arrays
        for name in ('particle', *self._carried, *self._saved):
            array = own[name]
            dtype, of_item = _item_of(array.dtype)
            shape = (*(array.shape if name in self._saved else (count,)), *of_item)
            _put(array, at.fitting(f'state.{name}', arrays.get(name), shape, dtype))
        counts = arrays['counts']
        if (counts[at.PARTICLES], counts[at.NEWCOMERS], counts[at.STAGE]) != (count, 0, 0):
            expected = f'{count} particles, between two steps'
            raise LavaError('checkpoint.state.counts', counts.tolist(), expected)

    def take_order(self, *, within_step: bool = False) -> None:
        """Copy the ordered arrays back to the particles; a caller may do this within a step."""
        arrays = self.arrays
        wp.copy(self.particle, self.ordered)
        for name in (*self._carried, *(self._of_step if within_step else ())):
            wp.copy(arrays[name], arrays[f'ordered_{name}'])

    def read_particles(self) -> np.ndarray:
        """Return rows of (x, y, volume, temperature), float64, x and y from the centre."""
        count = self.count
        if not count:
            return np.empty((0, 4))
        rows = read(self.particle[:count]).astype(np.float64)
        if self.form.has_remainder:
            rows[:, :2] += read(self.remainder[:count])
        if self.form.has_temperature_remainder:
            rows[:, 3] += read(self.temperature_remainder[:count])
        return rows


def _put(array: wp.array, values: np.ndarray) -> None:
    """Replace the first items of an array."""
    # a count of 0 would copy everything
    if len(values):
        rows = wp.array(values, dtype=array.dtype, device='cpu', copy=False)
        wp.copy(array, rows, count=len(values))


@lru_cache
def _item_of(dtype: Any) -> tuple[np.dtype, tuple[int, ...]]:
    """Return the numpy type, and the shape, of an item of a Warp array."""
    empty = wp.empty(0, dtype=dtype, device='cpu').numpy()
    return empty.dtype, empty.shape[1:]


def room_for(count: int) -> int:
    """Return the capacity for some particles: whole blocks of threads, a third of them spare."""
    return 256 * math.ceil(max(4 * count / 3, 1) / 256)
