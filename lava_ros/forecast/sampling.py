# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Members of an ensemble: a value drawn of each quantity that is uncertain.

Values are points of a Sobol sequence, shifted bit by bit with the seed: they fill the space of the
quantities more evenly than random ones, and member k is the same however many there are. The
arithmetic depends on no library's random generator and rounds the last digits away, so that member
k is the same on every machine. Errors of the ground are random fields.
"""

from dataclasses import dataclass, replace
import hashlib
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.files.optional import require
from lava_ros.scene import Scene, Terrain
from lava_ros.scene.uncertainty import CONSTANTS, Distribution, Roughness, Uncertainty

#: Quantity of each coordinate of a point; a new one goes to the end, so that others stay.
COORDINATES = (
    'discharge', 'temperature', 'viscosity', 'yield_strength', 'x', 'y', 'place_x', 'place_y',
)

#: Further coordinates, after those of the constants, if there are classes of eruptions.
ERUPTION = ('eruption', 'duration', 'volume')

#: Most members an ensemble can have.
MOST_MEMBERS = 1 << 20

#: Share of a cell's side that places keep from its border, so that rounding does not cross it.
_MARGIN = 1e-3

#: Correlation lengths by which a field exceeds the terrain, so that opposite borders differ.
_BEYOND = 3.0

#: Steps of a field [1/m], which rounds the error of the Fourier transform away.
_STEPS = 1024.0

#: Bits of a coordinate, and digits of a value: the last ones depend on the machine's logarithm.
_BITS, _DIGITS = 30, 9


@dataclass(frozen=True)
class Member:
    """What distinguishes one member from the scene.

    Attributes:
        index: Its number, from 0.
        discharge: Factor on the discharge of all vents.
        temperature: Offset of the temperature of all vents [K].
        viscosity: Factor on the lava's viscosity.
        yield_strength: Factor on the lava's yield strength.
        displacement: Displacement of all vents (x, y) [m].
        place: Position of the vent (x, y) [m], in place of the scene's; None leaves it there.
        seed: Seed of the random errors of its terrain.
        constants: Values of other constants of the lava, by name.
        eruption: Duration [s] and volume [m3] of the eruption; None for those of the scene.
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


class Susceptibility:
    """Places by their likelihood: two shares between 0 and 1 give a place."""

    def __init__(self, terrain: Terrain, likelihood: np.ndarray) -> None:
        """Take the relative likelihood of each cell, at least 0; NaN, and no data, count as 0.

        Raises:
            LavaError: The shapes differ, a value is negative, or nowhere is one above 0.
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
        """What tells one map from another, in hexadecimal digits."""
        return hashlib.blake2b(self._values.tobytes(), digest_size=16).hexdigest()

    def place(self, first: float, second: float) -> tuple[float, float]:
        """The place (x, y) [m] that two shares between 0 and 1 give.

        ``second`` chooses the row and the place within it, ``first`` the same along the row.
        """
        row, up = _cell(self._rows, second)
        column, along = _cell(np.cumsum(self._values[row]), first)
        (x, y), cell = self._terrain.origin, self._terrain.resolution
        return (x + (column + along) * cell, y + (row + up) * cell)


def _cell(sums: np.ndarray, share: float) -> tuple[int, float]:
    """The interval of cumulative sums that a share falls into, and where in it."""
    target = share * sums[-1]
    index = int(np.searchsorted(sums, target, side='right'))
    # the last of them with a likelihood
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
) -> tuple[Member, ...]:
    """Draw the first members of the ensemble of a scene and a seed.

    ``susceptibility`` says where the vent may be, in place of where the scene has it.

    Raises:
        LavaError: An argument is not usable, or nothing is uncertain.
    """
    count = validation.whole('members', count, at_least=1, at_most=MOST_MEMBERS)
    seed = validation.whole('seed', seed, at_least=0, at_most=2**32 - 1)
    uncertainty = scene.uncertainty
    if count > 1 and uncertainty == Uncertainty() and susceptibility is None:
        raise LavaError(
            'scene.uncertainty', {}, 'a quantity that is uncertain: all members would be the same'
        )
    # in the order of Lava, whatever that of a file is
    constants = [name for name in CONSTANTS if name in uncertainty.constants]
    names = (*COORDINATES, *constants, *(ERUPTION if uncertainty.eruption else ()))
    sums = np.cumsum([item.probability for item in uncertainty.eruption])

    def member(index: int, point: dict[str, float]) -> Member:
        def drawn(name: str, distribution: Distribution) -> float:
            return _rounded(distribution.quantile(point[name]))

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
        return Member(index, seed=(seed, index), constants=known, **values)

    points = _points(count, seed, len(names)).tolist()
    return tuple(
        member(index, dict(zip(names, point, strict=True))) for index, point in enumerate(points)
    )


def prepare_sampling() -> None:
    """Load the libraries that drawing members needs, which takes a second or more.

    Raises:
        LavaError: scipy is not installed.
    """
    _qmc(1)


def _points(count: int, seed: int, coordinates: int) -> np.ndarray:
    """Shifted points of the sequence in the open unit cube, shape [count, coordinates]."""
    sequence = _qmc(count).Sobol(coordinates, scramble=False, bits=_BITS)
    # the sequence is even in whole powers of two
    points = sequence.random_base2((count - 1).bit_length())[:count]
    cells = np.round(points * 2**_BITS).astype(np.int64)
    shift = np.random.SeedSequence(seed).generate_state(coordinates) >> (32 - _BITS)
    return ((cells ^ shift.astype(np.int64)) + 0.5) / 2**_BITS


def _qmc(count: int) -> Any:
    require('scipy.stats', 'members', count)
    from scipy.stats import qmc

    return qmc


def _rounded(value: float) -> float:
    return float(f'{value:.{_DIGITS}g}')


def rough_terrain(terrain: Terrain, roughness: Roughness, seed: tuple[int, ...]) -> Terrain:
    """Add a random field, drawn with ``seed``, to a terrain; cells without data stay without."""
    field = random_field(terrain.shape, terrain.resolution, roughness, seed)
    return replace(terrain, elevation=terrain.elevation + field)


def random_field(
    shape: tuple[int, int], resolution: float, roughness: Roughness, seed: tuple[int, ...]
) -> np.ndarray:
    """Draw a Gaussian field [m] with covariance s^2 exp(-(r / L)^2), float32.

    White noise is convolved with a Gaussian of deviation L / 2, whose own convolution is the
    correlation. s and L are the deviation and the correlation of ``roughness`` [m].

    Raises:
        LavaError: scipy is not installed.
    """
    require('scipy.special', 'uncertainty.terrain', roughness)
    from scipy.special import ndtri

    beyond = int(np.ceil(_BEYOND * roughness.correlation / resolution))
    # a field that hardly changes over the terrain need not go on for longer than it
    rows, columns = (side + min(beyond, 4 * max(shape)) for side in shape)
    # the generator's raw bits stay the same from version to version, its normal numbers may not
    bits = np.random.PCG64(np.random.SeedSequence(seed)).random_raw(rows * columns)
    noise = ndtri(((bits >> np.uint64(11)) + 0.5) * 2.0**-53).reshape(rows, columns)
    waves_y = np.fft.fftfreq(rows, resolution)[:, None]
    waves_x = np.fft.rfftfreq(columns, resolution)
    width = 0.5 * roughness.correlation
    gain = np.exp(-2.0 * (np.pi * width) ** 2 * (waves_y**2 + waves_x**2))
    kernel = np.fft.irfft2(gain, (rows, columns))
    scale = roughness.deviation / np.sqrt((kernel**2).sum())
    field = scale * np.fft.irfft2(gain * np.fft.rfft2(noise), (rows, columns))
    field = np.rint(field[: shape[0], : shape[1]] * _STEPS) / _STEPS
    return field.astype(np.float32)
