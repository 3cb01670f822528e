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
from lava_ros.scene import Terrain
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.backend.memory import forget_failure, zeros
from lava_ros.simulation.backend.streams import read, Readback
from lava_ros.simulation.checkpoint import FAR as FAR
from lava_ros.simulation.checkpoint import fitting

# Places in State.clock.
TIME, STEP, TARGET, FULL_STEP, FORMER_STEP = range(5)

# Places in State.stage: the weights of the Runge-Kutta stage at hand.
FORMER, BEFORE_FORMER, VELOCITY, FIRST_VELOCITY = range(4)

# Places in State.counts.
PARTICLES, STEPS, LIMIT, FULL, STAGE, STAGES, IS_LAST, EVALUATIONS = range(8)
CURRENT, NEAR_BORDER, NEWCOMERS = range(8, 11)

# Places in State.rates: reciprocals of the longest step each limit allows [1/s].
DIFFUSION, ADVECTION = range(2)

#: Indices into ``left``: over the terrain's border, and onto cells without data.
BORDER, HOLES = range(2)

#: Threads on a GPU of a kernel that rarely has anything to do: it costs little when it has not.
RARE_THREADS = 65536

#: As many are enough for few particles, of which there may be many simulations at once.
_FEW_RARE = 4096, 16384

#: The same in a batch, for members of any size.
RARE_THREADS_TOGETHER = 1024

#: Share of the room for particles from which more is made. Threads without a particle cost time,
#: so there is not much to spare; a vent that finds none waits until there is.
FULLEST = 0.875

#: Room for particles up to which it is doubled.
FEW = 16384

#: Threads to a particle on a GPU, and the room for particles up to which they pay.
SHARED_LANES, SHARED_UP_TO = 4, 50_000

#: Threads that a GPU holds at once, those to spare included, with ``compiled.FEW_THREADS`` on 132
#: processors. With no more of them it is waiting that takes the time: registers are not scarce
#: then, and launches are dear.
AT_ONCE = 150_000

#: Items behind the last that sums over neighbours may read (cells.py).
SPARE = 3

REAL = {'float32': wp.float32, 'float64': wp.float64}

#: The solver's own arrays; what is in them is said in ``State``. What is carried on has a twin,
#: ``ordered_`` and its name, in the order of the cells.
ARRAYS = {
    'stage': Array('real', 4),
    'rates': Array('real', 2),
    'top': Array('real', 1),
    'share': Array('real'),
    'age': Array('real', is_carried=True),
    'remainder': Array('vec2', is_carried=True),
    'surface': Array('vec2'),
    'flow': Array('vec3'),
    'particle': Array('vec4'),
    'ordered': Array('vec4'),
    'base': Array('vec4', is_carried=True),
    'drift': Array('vec4', is_carried=True),
    'mean_temperature': Array('real', is_carried=True),
    'counts': Array('int32', 11),
    'chosen': Array('int32', 1),
    'cell': Array('int32'),
    'rank': Array('int32'),
    'members': Array('int32'),
    'home': Array('int32'),
    'clock': Array('float64', 5),
    'limit_time': Array('float64', 1),
    'left': Array('float64', 2),
}


def kinds_of(real: Any) -> dict[str, Any]:
    """The Warp types by the names that an ``Array`` has for them."""
    vectors = {f'vec{length}': wp.types.vector(length, real) for length in (2, 3, 4)}
    return {'real': real, 'int32': wp.int32, 'float64': wp.float64, **vectors}


class State:
    """Every device array that depends on the number of particles, and the clock.

    Positions are kept relative to the terrain's centre. There a float32 resolves 1 mm at 10 km,
    and what a step cuts off is carried on to the next.

    Attributes:
        particle: x, y [m], volume [m3], temperature [K] of each particle. This and what follows,
            up to ``surface``, has the shape [capacity].
        cell, rank: Cell of each particle and its rank there.
        members: Only when deterministic on a GPU: the particles of each cell as they came.
        ordered: The same as ``particle`` in the order of the neighbour grid's cells.
        remainder: Only in float32: what rounding cut off each particle's position [m]. Without it
            slow lava far from the centre would never move.
        age: Only where an effect depends on it: time since each particle came out [s].
        base: Position at the start of the step [m] and displacement since then two stages ago [m],
            of each particle; none with the Euler integrator.
        drift: Displacement a stage ago [m] and velocity at the start of the step [m/s], likewise.
        mean_temperature: Only where the speed depends on it: mean temperature around each
            particle at the start of the step [K].
        flow: Thickness [m], velocity x and y [m/s], of each ordered particle.
        share: What each ordered particle gives to a map: to a cell of unit weight before the
            kernel's [m^(1/2)], or to the one it lies in [m].
        home: Number of the cell that has all of an ordered particle's volume, -1 where several
            share it.
        surface: Only where the gradient takes differences: elevation of the surface [m] and the
            area V/h [m2] of each ordered particle.
        clock: Simulated time, step, target time, latest full step and, with inertia, the step
            before [s], float64.
        limit_time: Time that no step may pass [s], at or after the target, float64; in no
            checkpoint.
        counts: Particles, steps, what limited the step, whether the capacity was reached; then the
            stage at hand (0 from the last one on), the stages of the step, whether it is the last
            one, the velocity evaluations so far, the stage at hand, the last one included (0 past
            the target, where stages idle),
            which sides of the neighbour grid's window particles are near (the sum of 1 in the
            west, 2 in the south, 4 in the east, 8 in the north), and the particles after those
            counted first that have come out since the cells were built.
        chosen: 1 from when a stage is chosen within its motion (fused_stage.py) until its end.
        stage: Weights of the stage at hand.
        rates: Reciprocal of the step each limit allows [1/s].
        top: Elevation of the highest ground that lava came from, above the terrain's mean [m].
        left: Volume that has left the terrain [m3], float64.
        arrived: Time at which lava reached each cell of the terrain [s], -1 before, float32, shape
            [rows, columns]; kept by ``Simulation``.

    What effects keep besides is declared in their files (``Effect.arrays``).
    """

    arrived: Any

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...  # noqa: D105

    def __init__(
        self, capacity: int, effects: Effects, accuracy: Accuracy, device: Any
    ) -> None:
        """Allocate for ``capacity`` particles."""
        forget_failure(device)
        self.real = REAL[accuracy.precision]
        self.effects = effects
        # with inertia a step has one stage: effects/inertia.py
        self.is_staged = accuracy.integrator == 'rkl2' and 'inertia' not in effects
        self.has_remainder = accuracy.precision == 'float32'
        self.is_deterministic = accuracy.deterministic
        # a step of a fixed length takes what comes
        self.is_guarded = accuracy.fixed_step is None
        self.has_velocity = 'inertia' in effects
        self.has_mean = effects.any('stiffens')
        self.has_age = effects.any('needs_age')
        # what froze or was merged into another has no volume and is dropped
        self.has_empty = effects.any('leaves_empty')
        # no pass comes after the motion: it puts the particles into their cells at once
        self.bins_in_motion = not self.has_empty
        # with inertia the pairs of the energy's gradient keep the momentum: a bore needs that
        self.has_surface = accuracy.gradient != 'energy' and 'inertia' not in effects
        self.device = device
        self.launches = Launches(device)
        self._allocate(capacity)
        self.top.fill_(-FAR)
        if not device.is_cuda:
            # it sees what is there: to make it anew takes 10 us
            self._seen_counts = self.counts.numpy()
        self._target = self.clock[TARGET : TARGET + 1]
        self._readbacks = [Readback((self.clock, self.counts))]

    @property
    def _arrays(self) -> dict[str, Array]:
        """The arrays that this state has, by name: its own and those that the effects declare."""
        is_needed = {
            'age': self.has_age,
            'remainder': self.has_remainder,
            'surface': self.has_surface,
            'base': self.is_staged,
            'drift': self.is_staged,
            'mean_temperature': self.has_mean,
            'members': self.is_ranked_again,
        }
        own = {name: array for name, array in ARRAYS.items() if is_needed.get(name, True)}
        return own | self.effects.arrays

    def _allocate(self, capacity: int) -> None:
        """Make room for some particles; what does not depend on how many they are is kept."""
        kinds, items, others = kinds_of(self.real), {}, {}
        for name, array in self._arrays.items():
            dtype = kinds[array.dtype]
            if array.count is None:
                items[name] = dtype, capacity
            elif not hasattr(self, name):
                others[name] = dtype, array.count
            if array.is_carried:
                items[f'ordered_{name}'] = dtype, capacity
        arrays = zeros(items, self.device, spare=SPARE) | zeros(others, self.device)
        self.launches.forget()
        vars(self).update(arrays, capacity=capacity)

    @property
    def extent(self) -> int:
        """Particles that a launch has to take: on a GPU as many as there is room for."""
        if self.device.is_cuda:
            return self.capacity
        if self.launches.is_capturing:
            return self.launches.extent
        return int(self._seen_counts[PARTICLES] + self._seen_counts[NEWCOMERS])

    @property
    def is_ranked_again(self) -> bool:
        """Whether particles rank in their cells by number, not as a GPU's atomics have it."""
        return self.is_deterministic and self.device.is_cuda

    @property
    def parts(self) -> int:
        """Parts in which a particle's neighbours are summed up, which threads can share."""
        return SHARED_LANES if self.device.is_cuda and self.capacity <= SHARED_UP_TO else 1

    @property
    def lanes(self) -> int:
        """Threads to a particle: one for each part, for few particles alone do not fill a GPU.

        Those of a batch do (batched_launches.py), for which launches are taken down.
        """
        return 1 if self.launches.is_capturing else self.parts

    @property
    def is_short(self) -> bool:
        """Whether all threads of a pass over the particles are at work on a GPU at once."""
        is_alone = self.device.is_cuda and not self.launches.is_capturing
        return is_alone and self.capacity * self.lanes <= AT_ONCE

    @property
    def is_wide(self) -> bool:
        """Whether sums over neighbours take several of them at a time (simd.py)."""
        return not self.device.is_cuda and self.real is wp.float32

    @property
    def rare_threads(self) -> int:
        """Threads of a kernel that rarely has anything to do; each takes every so many-th."""
        if not self.device.is_cuda:
            return 1
        if self.launches.is_capturing:
            # members with other kernels would not go through their stages together
            return RARE_THREADS_TOGETHER
        # each number of them is another kernel
        return next((few for few in _FEW_RARE if self.capacity <= few), RARE_THREADS)

    def read_clock(self) -> tuple[np.ndarray, np.ndarray]:
        """Copies of ``clock`` and ``counts``, when all that is launched on this stream is done."""
        return self._readbacks[0].begin()()

    def begin_readback(self) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        """Begin to copy them; what is returned waits for the copies, before a third is begun."""
        # page-locked memory is slow to make, and a member of a batch needs none of these
        while len(self._readbacks) < 3:
            self._readbacks.append(Readback((self.clock, self.counts)))
        self._readbacks[1:] = reversed(self._readbacks[1:])
        return self._readbacks[1].begin()

    def make_room(self, counts: np.ndarray) -> None:
        """Make more room for particles if a copy of ``counts`` says that it is needed."""
        if self.needs_room(counts):
            # what there is little of costs nothing to have to spare
            twice = 2 * self.capacity if self.capacity < FEW else 0
            self.grow(max(room_for(count_in(counts)), room_for(self.capacity), twice))

    def needs_room(self, counts: np.ndarray) -> bool:
        """Whether the room is almost full or a vent found none."""
        return bool(counts[FULL] or count_in(counts) > FULLEST * self.capacity)

    def grow(self, capacity: int) -> None:
        """Make room for ``capacity`` particles and keep those there are.

        Raises:
            RuntimeError: There is no memory for as many; the state stays as it was.
        """
        names = 'particle', 'cell', 'rank', *self._carried, *self._of_step
        kept = {name: getattr(self, name) for name in names}
        count = min(self.capacity, capacity)
        try:
            self._allocate(capacity)
        except RuntimeError as error:
            forget_failure(self.device)
            raise RuntimeError(f'room for {capacity} particles: {error}') from error
        # nobody waits for how many there are
        for name, values in kept.items():
            wp.copy(getattr(self, name), values, count=count)
        self.write_count(FULL, 0)

    @property
    def _carried(self) -> list[str]:
        """Names of the arrays that particles take along from step to step, each with a twin."""
        names = ['remainder'] if self.has_remainder else []
        names += [name for name, array in self.effects.arrays.items() if array.is_carried]
        return names + (['age'] if self.has_age else [])

    @property
    def _of_step(self) -> tuple[str, ...]:
        """Names of those that they take along from stage to stage of a step."""
        names = ('base', 'drift') if self.is_staged else ()
        return (*names, 'mean_temperature') if self.has_mean else names

    def _put(self, name: str, values: np.ndarray) -> None:
        """Replace the first items of an array."""
        # a count of 0 would copy all
        if len(values):
            array = getattr(self, name)
            rows = wp.array(values, dtype=array.dtype, device=self.device)
            wp.copy(array, rows, count=len(values))

    def write_target(self, time: float, limit: float | None = None) -> None:
        """Replace the target time of ``clock`` and, if given, ``limit_time`` [s].

        Stages that have been launched already still have the former ones.
        """
        self._target.fill_(time)
        if limit is not None:
            self.limit_time.fill_(limit)

    def write_count(self, place: int, value: int) -> None:
        """Replace one of the ``counts``."""
        self.counts[place : place + 1].fill_(value)

    @property
    def count(self) -> int:
        """Number of particles (read back from the device)."""
        return count_in(self.read_clock()[1])

    def write_particles(self, values: np.ndarray) -> None:
        """Replace all particles by rows of (x, y from the centre, volume, temperature), float64.

        The first of them are the particles that there were: they keep their velocity and age.
        """
        count = min(self.count, len(values))
        kept = {name: getattr(self, name).numpy()[:count].copy() for name in self._carried}
        if self.has_remainder:
            kept['remainder'] = values[:, :2] - values[:, :2].astype(np.float32)
        if len(values) > FULLEST * self.capacity:
            self._allocate(room_for(len(values)))
        self._put('particle', values)
        for name in self._carried:
            getattr(self, name).zero_()
        for name, former in kept.items():
            self._put(name, former)
        self.write_count(PARTICLES, len(values))
        self.write_count(NEWCOMERS, 0)

    def take_over(self, former: 'State') -> None:
        """Go on from another state, of other effects: what both have is kept."""
        self.write_particles(former.read_particles())
        count = former.count
        for name in set(self._carried) & set(former._carried):
            if count:
                wp.copy(getattr(self, name), getattr(former, name), count=count)
        arrays = self.effects.arrays
        totals = [name for name in arrays if arrays[name].is_total and hasattr(former, name)]
        for name in ('clock', 'counts', 'top', 'left', *totals):
            wp.copy(getattr(self, name), getattr(former, name))

    def save(self) -> dict[str, np.ndarray]:
        """Copy everything that the next step starts from, between two steps, by name."""
        count = self.count
        arrays = {
            name: getattr(self, name).numpy()[:count].copy()
            for name in ('particle', *self._carried)
        }
        return arrays | {name: getattr(self, name).numpy().copy() for name in self._sums}

    def load(self, arrays: Mapping[str, np.ndarray], capacity: int) -> None:
        """Go on from what ``save`` has copied, with room for as many particles as there was.

        Raises:
            LavaError: An array is missing, or is not of the kind that this state needs.
        """
        count = len(arrays['particle'])
        self._allocate(capacity)
        for name in ('particle', *self._carried, *self._sums):
            template = getattr(self, name).numpy()
            shape = template.shape if name in self._sums else (count, *template.shape[1:])
            values = fitting(f'state.{name}', arrays.get(name), shape, template.dtype)
            self._put(name, values)
        _, counts = self.read_clock()
        if (counts[PARTICLES], counts[NEWCOMERS], counts[STAGE]) != (count, 0, 0):
            right = f'{count} particles, between two steps'
            raise LavaError('checkpoint.state.counts', counts.tolist(), right)

    @property
    def _sums(self) -> list[str]:
        """Names of the arrays that do not depend on the number of particles."""
        items = self.effects.arrays.items()
        kept = [name for name, array in items if array.is_total or array.is_saved]
        return ['clock', 'counts', 'rates', 'stage', 'top', 'left', *kept]

    def take_order(self, *, within_step: bool = False) -> None:
        """Let the ordered particles be the particles, between the stages of a step as well."""
        wp.copy(self.particle, self.ordered)
        for name in (*self._carried, *(self._of_step if within_step else ())):
            wp.copy(getattr(self, name), getattr(self, f'ordered_{name}'))

    def read_particles(self) -> np.ndarray:
        """Rows of (x, y, volume, temperature), float64, x and y from the centre."""
        count = self.count
        if not count:
            return np.empty((0, 4))
        rows = read(self.particle[:count]).astype(np.float64)
        if self.has_remainder:
            rows[:, :2] += read(self.remainder[:count])
        return rows


def count_in(counts: np.ndarray) -> int:
    """Particles that there are by a copy of ``State.counts``."""
    return int(counts[PARTICLES] + counts[NEWCOMERS])


def room_for(count: int) -> int:
    """Capacity to take for some particles: whole blocks of threads, a third of them to spare."""
    return 256 * math.ceil(max(4 * count / 3, 1) / 256)


def centre_of(terrain: Terrain) -> np.ndarray:
    """Map position [m] that particle positions are relative to: the middle of the terrain."""
    x0, y0, x1, y1 = terrain.extent
    return np.array([0.5 * (x0 + x1), 0.5 * (y0 + y1)])
