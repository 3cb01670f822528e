# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Members of an ensemble: one value drawn of each quantity that is uncertain.

Values are points of a Sobol sequence, shifted bit by bit with the seed. They fill the space of the
quantities more evenly than random ones, member k is the same however many there are, and more can
be drawn later. The arithmetic depends on no library's random generator, and what is left of
rounding is rounded away, so that member k is the same on every machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.forecast.susceptibility import Susceptibility
from lava_ros.scene import Scene
from lava_ros.uncertainty import Distribution, Uncertainty

#: What the coordinates of a point stand for; a new one goes to the end, so that others stay.
COORDINATES = (
    'discharge', 'temperature', 'viscosity', 'yield_strength', 'x', 'y', 'place_x', 'place_y',
)

#: Most members an ensemble can have.
MOST_MEMBERS = 1 << 20

#: Bits of a coordinate.
_BITS = 30

#: Significant digits of a value: the last ones depend on the machine's logarithm.
_DIGITS = 9


@dataclass(frozen=True)
class Member:
    """What is different in one member.

    Attributes:
        index: Its number, from 0.
        discharge: Factor on the discharge of all vents.
        temperature: What is added to the temperature of all vents [K].
        viscosity: Factor on the lava's viscosity.
        yield_strength: Factor on the lava's yield strength.
        displacement: What is added to the position of all vents (x, y) [m].
        place: Where the vent is instead of where the scene has it (x, y) [m]; None: there.
        seed: Numbers that the errors of its terrain are drawn from.
    """

    index: int
    discharge: float = 1.0
    temperature: float = 0.0
    viscosity: float = 1.0
    yield_strength: float = 1.0
    displacement: tuple[float, float] = (0.0, 0.0)
    place: tuple[float, float] | None = None
    seed: tuple[int, ...] = (0,)


def draw_members(
    scene: Scene,
    count: int,
    *,
    seed: int = 0,
    susceptibility: Susceptibility | None = None,
) -> tuple[Member, ...]:
    """Draw the first members of the ensemble that a scene and a seed stand for.

    Args:
        scene: The scene; its ``uncertainty`` says what is drawn.
        count: How many.
        seed: Another one gives other members.
        susceptibility: Where the vent may be, in place of where the scene has it.

    Raises:
        LavaError: An argument is not usable, or nothing is uncertain.
    """
    count = _whole('members', count, 1, MOST_MEMBERS)
    seed = _whole('seed', seed, 0, 2**32 - 1)
    uncertainty = scene.uncertainty
    if count > 1 and uncertainty == Uncertainty() and susceptibility is None:
        raise LavaError(
            'scene.uncertainty', {}, 'a quantity that is uncertain: all members would be the same'
        )
    points = _points(count, seed)
    return tuple(
        _member(index, dict(zip(COORDINATES, point, strict=True)), uncertainty, seed,
                susceptibility)
        for index, point in enumerate(points.tolist())
    )


def prepare_sampling() -> None:
    """Load what drawing members needs: a second or more, which some have no time for later.

    Raises:
        LavaError: scipy is not installed.
    """
    _qmc(1)


def _member(
    index: int,
    point: dict[str, float],
    uncertainty: Uncertainty,
    seed: int,
    susceptibility: Susceptibility | None,
) -> Member:
    def value(name: str, certain: float) -> float:
        distribution: Distribution | None = getattr(uncertainty, name)
        return certain if distribution is None else _rounded(distribution.quantile(point[name]))

    shift = (0.0, 0.0)
    if uncertainty.position is not None:
        x, y = uncertainty.position.quantile(point['x'], point['y'])
        shift = (_rounded(x), _rounded(y))
    place = None
    if susceptibility is not None:
        x, y = susceptibility.place(point['place_x'], point['place_y'])
        place = (_rounded(x), _rounded(y))
    return Member(
        index,
        discharge=value('discharge', 1.0),
        temperature=value('temperature', 0.0),
        viscosity=value('viscosity', 1.0),
        yield_strength=value('yield_strength', 1.0),
        displacement=shift,
        place=place,
        seed=(seed, index),
    )


def _points(count: int, seed: int) -> np.ndarray:
    """Shifted points of the sequence in the open unit cube, shape [count, coordinates]."""
    qmc = _qmc(count)
    sequence = qmc.Sobol(len(COORDINATES), scramble=False, bits=_BITS)
    # whole powers of two are what the sequence is even in
    points = sequence.random_base2((count - 1).bit_length())[:count]
    cells = np.round(points * 2**_BITS).astype(np.int64)
    shift = np.random.SeedSequence(seed).generate_state(len(COORDINATES)) >> (32 - _BITS)
    return ((cells ^ shift.astype(np.int64)) + 0.5) / 2**_BITS


def _qmc(count: int) -> Any:
    try:
        from scipy.stats import qmc
    except ImportError as error:
        raise LavaError('members', count, "scipy: pip install 'lava_ros[ensemble]'") from error
    return qmc


def _rounded(value: float) -> float:
    return float(f'{value:.{_DIGITS}g}')


def _whole(name: str, value: object, least: int, most: int) -> int:
    number = validation.number(name, value, at_least=least, at_most=most)
    if number != int(number):
        raise LavaError(name, value, 'a whole number')
    return int(number)


def table_of(members: Sequence[Member]) -> dict[str, list[float]]:
    """The values of the members, by name: for reports."""
    names = ('discharge', 'temperature', 'viscosity', 'yield_strength')
    table = {name: [getattr(member, name) for member in members] for name in names}
    for axis, name in enumerate(('x', 'y')):
        table[f'displacement_{name}'] = [member.displacement[axis] for member in members]
        if members and members[0].place is not None:
            table[f'place_{name}'] = [
                member.place[axis] for member in members if member.place is not None
            ]
    return table
