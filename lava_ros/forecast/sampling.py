# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Members of an ensemble: draws of all uncertain quantities.

Values are points of a Sobol sequence with a digital shift by the seed. They fill the space of the
quantities more evenly than random points, and member k does not depend on the number of members.
The arithmetic uses no library's random generator and rounds the last digits, so that member k is
the same on every machine. Errors of the terrain are random fields. After an observation, members
are drawn near those that agree with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import hashlib
from importlib import import_module
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import effective_members
from lava_ros.scene import Scene, Terrain
from lava_ros.scene.distributions import Distribution, Roughness
from lava_ros.scene.ranges import with_ranges
from lava_ros.scene.uncertainty import CONSTANTS, Uncertainty

#: Quantity of each coordinate of a point; add new quantities at the end, so that the existing ones
#: keep their coordinates.
COORDINATES = (
    'discharge', 'temperature', 'viscosity', 'yield_strength', 'x', 'y', 'place_x', 'place_y',
)

#: Further coordinates, after those of the constants, if there are classes of eruptions.
ERUPTION = ('eruption', 'duration', 'volume')

#: Maximum number of members of an ensemble.
MAX_MEMBERS = 1 << 20

#: Minimum distance of places from the border of a cell, as a fraction of its side, for rounding.
_MARGIN = 1e-3

#: Extension of a field beyond the terrain in correlation lengths, so that opposite borders differ.
_BEYOND = 3.0

#: Number of noise cells per correlation length of a field: waves that are shorter than these cells
#: have at most 1e-4 of the amplitude.
_FINE = 3.0

#: Steps of a field [1/m]: rounding to them removes the error of the Fourier transform.
_STEPS = 1024.0

#: Variance added around weighted members, as a fraction of the variance before the observation,
#: because a single member with weight has none.
MIN_VARIANCE = 0.01

#: Bits of a coordinate, and digits of a value: further digits depend on the machine's logarithm.
_BITS, _DIGITS = 30, 9


@dataclass(frozen=True)
class Member:
    """The differences of one member from the scene.

    Attributes:
        index: Its number, from 0.
        discharge: Factor on the discharge of all vents.
        temperature: Offset of the temperature of all vents [K].
        viscosity: Factor on the lava's viscosity.
        yield_strength: Factor on the lava's yield strength.
        displacement: Displacement of all vents (x, y) [m].
        place: Position of the vent (x, y) [m]; None for the position in the scene.
        seed: Seed of the random errors of its terrain.
        constants: Values of other constants of the lava, by name.
        eruption: Duration [s] and volume [m3] of the eruption; None for the values of the scene.
        point: Its point in the unit cube of the quantities, from which the values follow.
    """

    index: int
    discharge: float = 1.0
    temperature: float = 0.0
    viscosity: float = 1.0
    yield_strength: float = 1.0
    displacement: tuple[float, float] = (0.0, 0.0)
    place: tuple[float, float] | None = None
    seed: tuple[int, ...] = (0,)
    constants: tuple[tuple[str, float], ...] = ()
    eruption: tuple[float, float] | None = None
    point: tuple[float, ...] = field(default=(), compare=False)


@dataclass(frozen=True, eq=False)
class Posterior:
    """Weighted members as a distribution from which new members are drawn.

    A new member has a parent, chosen by weight, and a normal kernel around it. With the scores
    that are normal before the observation, the kernel shrinks towards the weighted mean, so that
    it adds no variance (West 1993; Liu and West 2001, in Sequential Monte Carlo Methods in
    Practice). Its width is Silverman's for the effective number of members. The class of the
    eruption and the errors of the terrain are those of the parent.

    Attributes:
        parents: The members.
        weights: Their relative weights, float64 or int64, shape [parents].
        generation: Number of the draw in a sequence of observations, from 1.
    """

    parents: tuple[Member, ...]
    weights: np.ndarray
    generation: int = 1

    @property
    def effective_members(self) -> float:
        """Effective number of parents."""
        return effective_members(self.weights)

    def near(
        self, points: np.ndarray, is_drawn: np.ndarray
    ) -> tuple[np.ndarray, list[Member]]:
        """Convert uniform points to points near the parents.

        Args:
            points: Points of the unit cube, shape [members, coordinates + 1]; the last coordinate
                chooses the parent.
            is_drawn: True for coordinates that a kernel changes, bool, shape [coordinates].

        Returns:
            The new points, shape [members, coordinates], and their parents.
        """
        from scipy.special import ndtr, ndtri

        known, weights = np.array([parent.point for parent in self.parents]), self.weights
        sums = np.cumsum(weights)
        places = [_cell(sums, share)[0] for share in points[:, -1].tolist()]
        scores, size = ndtri(known[:, is_drawn]), int(is_drawn.sum())
        mean = weights @ scores / weights.sum()
        spread = (weights * (scores - mean).T) @ (scores - mean) / weights.sum()
        spread += MIN_VARIANCE * np.eye(size)
        width = (4.0 / ((size + 2.0) * self.effective_members)) ** (1.0 / (size + 4.0))
        width = min(width, 1.0)
        noise = ndtri(points[:, :-1][:, is_drawn]) @ np.linalg.cholesky(spread).T
        moved = np.sqrt(1.0 - width**2) * (scores[places] - mean) + width * noise
        result = known[places]
        result[:, is_drawn] = _middle_of_step(ndtr(mean + moved))
        return result, [self.parents[place] for place in places]


def parents_digest(parents: Sequence[Member], *reasons: np.ndarray) -> str:
    """Return a hash of members and of the arrays that decide their weights, in hex digits."""
    digest = hashlib.blake2b(digest_size=16)
    for values in (np.array([parent.point for parent in parents]), *reasons):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


class Susceptibility:
    """A map of likelihood that converts two fractions between 0 and 1 to a place."""

    def __init__(self, terrain: Terrain, likelihood: np.ndarray) -> None:
        """Initialize from relative likelihoods >= 0; NaN and cells without data count as 0.

        Raises:
            LavaError: If the shapes differ, a value is negative, or no value is above 0.
        """
        values = np.asarray(likelihood, dtype=np.float64)
        if values.shape != terrain.shape:
            raise LavaError('susceptibility', values.shape, f'a map of {terrain.shape} cells')
        values = np.where(np.isnan(values) | ~terrain.has_data, 0.0, values)
        if not np.isfinite(values).all() or (values < 0.0).any():
            worst = float(values[~(values >= 0.0) | np.isinf(values)][0])
            raise LavaError('susceptibility', worst, 'finite likelihoods of at least 0')
        if not values.any():
            raise LavaError('susceptibility', 0.0, 'a cell of the terrain with a likelihood')
        self._terrain, self._values = terrain, values
        self._rows = np.cumsum(values.sum(axis=1))

    @property
    def digest(self) -> str:
        """Return a hash of the map, in hexadecimal digits."""
        return hashlib.blake2b(self._values.tobytes(), digest_size=16).hexdigest()

    def place(self, first: float, second: float) -> tuple[float, float]:
        """Return the place (x, y) [m] for two fractions between 0 and 1.

        ``second`` sets the row and the position in it along y, ``first`` the column and x.
        """
        row, up = _cell(self._rows, second)
        column, along = _cell(np.cumsum(self._values[row]), first)
        (x, y), cell = self._terrain.origin, self._terrain.resolution
        return (x + (column + along) * cell, y + (row + up) * cell)


def _cell(sums: np.ndarray, share: float) -> tuple[int, float]:
    """Return the interval of cumulative sums that contains a fraction, and the position in it."""
    target = share * sums[-1]
    index = int(np.searchsorted(sums, target, side='right'))
    # the last cell with a likelihood above 0
    index = min(index, int(np.searchsorted(sums, sums[-1])))
    before = float(sums[index - 1]) if index else 0.0
    inside = (target - before) / (float(sums[index]) - before)
    return index, min(max(inside, _MARGIN), 1.0 - _MARGIN)


def draw_members(
    scene: Scene,
    count: int,
    *,
    seed: int = 0,
    susceptibility: Susceptibility | None = None,
    posterior: Posterior | None = None,
) -> tuple[Member, ...]:
    """Draw the first members of the ensemble of a scene and a seed.

    Quantities that the scene leaves open have their usual ranges (``ranges.with_ranges``).
    ``susceptibility`` is the distribution of the vent's position, in place of the scene's.
    ``posterior`` is the distribution after observations; its parents are of the same scene.

    Raises:
        LavaError: If an argument is not valid, or nothing is uncertain.
    """
    count = validation.whole('members', count, at_least=1, at_most=MAX_MEMBERS)
    seed = validation.whole('seed', seed, at_least=0, at_most=2**32 - 1)
    uncertainty = with_ranges(scene).uncertainty
    is_uncertain = bool(uncertainty.drawn or uncertainty.eruption or susceptibility)
    if count > 1 and not is_uncertain:
        raise LavaError(
            'scene.uncertainty', {}, 'an uncertain quantity; otherwise all members would be equal'
        )
    constants = _constants_of(uncertainty)
    names = _names(uncertainty)
    sums = np.cumsum([item.probability for item in uncertainty.eruption])
    seeds: list[tuple[int, ...]] = [(seed, index) for index in range(count)]
    if posterior is None:
        points = _points(count, (seed,), len(names))
    else:
        drawn_names = {*COORDINATES[:4], *constants}
        uncertain = {name for name in drawn_names if is_independent(uncertainty, name)}
        uncertain |= {*ERUPTION[1:]}
        uncertain |= {'x', 'y'} if uncertainty.position else set()
        uncertain |= {'place_x', 'place_y'} if susceptibility else set()
        cube = _points(count, (seed, posterior.generation), len(names) + 1)
        points, parents = posterior.near(cube, np.array([name in uncertain for name in names]))
        seeds = [parent.seed for parent in parents]

    def member(index: int, numbers: list[float]) -> Member:
        point = dict(zip(names, numbers, strict=True))

        def drawn(name: str, distribution: Distribution) -> float:
            leader = distribution.follows.removeprefix('-') or name
            share = point['discharge' if leader == 'effusion_rate' else leader]
            return _rounded(
                distribution.quantile(1.0 - share if distribution.follows[:1] == '-' else share)
            )

        values: dict[str, Any] = {
            name: drawn(name, distribution)
            for name in COORDINATES[:4]
            if (distribution := getattr(uncertainty, name)) is not None
        }
        if uncertainty.position is not None:
            shift = uncertainty.position.quantile(point['x'], point['y'])
            values['displacement'] = tuple(map(_rounded, shift))
        if susceptibility is not None:
            place = susceptibility.place(point['place_x'], point['place_y'])
            values['place'] = tuple(map(_rounded, place))
        if uncertainty.eruption:
            kind = uncertainty.eruption[_cell(sums, point['eruption'])[0]]
            values['eruption'] = tuple(drawn(key, getattr(kind, key)) for key in ERUPTION[1:])
        known = tuple((name, drawn(name, uncertainty.constants[name])) for name in constants)
        return Member(
            index, seed=seeds[index], constants=known, point=tuple(numbers), **values
        )

    return tuple(member(index, numbers) for index, numbers in enumerate(points.tolist()))


def coordinates_of(scene: Scene) -> tuple[str, ...]:
    """Return the names of the coordinates of ``Member.point`` of a scene."""
    return _names(with_ranges(scene).uncertainty)


def _names(uncertainty: Uncertainty) -> tuple[str, ...]:
    eruption = ERUPTION if uncertainty.eruption else ()
    return (*COORDINATES, *_constants_of(uncertainty), *eruption)


def _constants_of(uncertainty: Uncertainty) -> list[str]:
    # in the order of Lava, which does not depend on the order in a file
    return [name for name in CONSTANTS if name in uncertainty.constants]


def is_independent(uncertainty: Uncertainty, name: str) -> bool:
    """Return True if a coordinate is drawn, and does not follow another quantity."""
    found = uncertainty.distribution_of('effusion_rate' if name == 'discharge' else name)
    return isinstance(found, Distribution) and not found.follows


def prepare_sampling() -> None:
    """Load the libraries for drawing members, which takes a second or more."""
    import_module('scipy.stats')


def _points(count: int, seed: Sequence[int], coordinates: int) -> np.ndarray:
    """Return shifted points of the sequence in the open unit cube, [count, coordinates]."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(coordinates, scramble=False, bits=_BITS)
    # the sequence is balanced for powers of two
    points = sequence.random_base2((count - 1).bit_length())[:count]
    cells = np.round(points * 2**_BITS).astype(np.int64)
    shift = np.random.SeedSequence(seed).generate_state(coordinates) >> (32 - _BITS)
    return ((cells ^ shift.astype(np.int64)) + 0.5) / 2**_BITS


def _middle_of_step(points: np.ndarray) -> np.ndarray:
    """Round coordinates to the middles of the steps of ``_points``, inside the open cube."""
    return (np.clip(np.floor(points * 2**_BITS), 0, 2**_BITS - 1) + 0.5) / 2**_BITS


def _rounded(value: float) -> float:
    return float(f'{value:.{_DIGITS}g}')


def rough_terrain(terrain: Terrain, roughness: Roughness, seed: tuple[int, ...]) -> Terrain:
    """Add a random field drawn with ``seed`` to a terrain; no-data cells are unchanged."""
    field = random_field(terrain.shape, terrain.resolution, roughness, seed)
    return replace(terrain, elevation=terrain.elevation + field)


def random_field(
    shape: tuple[int, int], resolution: float, roughness: Roughness, seed: tuple[int, ...]
) -> np.ndarray:
    """Draw a Gaussian field [m] with covariance s^2 exp(-(r / L)^2), float32.

    White noise is convolved with a Gaussian of standard deviation L / 2, which gives the field
    this covariance. s and L are ``deviation`` and ``correlation`` of ``roughness`` [m].
    """
    from scipy.fft import irfft2, next_fast_len, rfft2
    from scipy.special import ndtri

    # the coarser noise contains all waves of the field, and is interpolated by them
    step = max(int(roughness.correlation / (_FINE * resolution)), 1)
    beyond = int(np.ceil(_BEYOND * roughness.correlation / resolution))
    # limit the extension of a field that hardly changes over the terrain
    rows, columns = (
        next_fast_len(-(-(side + min(beyond, 4 * max(shape))) // step), real=True)
        for side in shape
    )
    # the raw bits of the generator are equal in all versions; its normal numbers may differ
    bits = np.random.PCG64(np.random.SeedSequence(seed)).random_raw(rows * columns)
    noise = ndtri(((bits >> np.uint64(11)) + 0.5) * 2.0**-53).reshape(rows, columns)
    width = 0.5 * roughness.correlation
    gain_y, gain_x = (
        np.exp(-2.0 * (np.pi * width * np.fft.fftfreq(side, step * resolution)) ** 2)
        for side in (rows, columns)
    )
    # the sum of the squares of the kernel equals the sum over its spectrum (Parseval)
    variance = (gain_y**2).mean() * (gain_x**2).mean()
    scale = step**2 * roughness.deviation / np.sqrt(variance)
    waves = rfft2(noise) * (scale * gain_y[:, None] * gain_x[: columns // 2 + 1])
    whole = np.zeros((rows * step, columns * step // 2 + 1), dtype=waves.dtype)
    half = (rows + 1) // 2
    whole[:half, : waves.shape[1]] = waves[:half]
    whole[half - rows :, : waves.shape[1]] = waves[half:]
    field = irfft2(whole, (rows * step, columns * step))
    field = np.rint(field[: shape[0], : shape[1]] * _STEPS) / _STEPS
    return field.astype(np.float32)
