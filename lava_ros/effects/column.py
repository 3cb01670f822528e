# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A column of lava: its state at one place, of which every law of flow and of heat is a function.

Thickness h is vertical and speed u horizontal, as on a map. On ground of slope b the lava is

    d = h cos b

thick across the flow. Heat leaves through its surface and its base, which are 1 / cos b times as
large as the column's area on the map, so rho c d dT/dt = -q with the heat flux q per area of the
surface. The stress at the base of a sheet is rho g d sin b. Without ``steep`` d is h.

Particles and estimates use the same columns: on the device a Warp struct, on the host a
namespace with the same attributes.
"""

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from lava_ros.effects import Effects

#: Attributes: thickness h and thickness across the flow d [m]; slope s of the surface, the sine of
#: its angle along the flow with ``steep``, otherwise rise over run; temperature [K]; age, the time
#: since emission [s]; drop, the height that the column falls per time [m/s]; speed u [m/s].
ATTRIBUTES = (
    'thickness', 'normal_thickness', 'slope', 'temperature', 'age', 'drop', 'speed',
)


@lru_cache
def column_type(real: Any) -> Any:
    """Return the type of a column: a Warp struct of scalars, or a namespace for ``float``."""
    return SimpleNamespace if real is float else structure('Column', ATTRIBUTES, real)


def normal_thickness(
    thickness: np.ndarray, ground_slope: np.ndarray, effects: Effects
) -> np.ndarray:
    """Return the thickness across the flow [m] of columns by thickness and slope of the ground.

    The slope is rise over run; without an effect that accounts for it, the two are equal.
    """
    cosine = effects.function('cosine', ground_slope)
    return thickness if cosine is None else thickness * cosine


def summed(
    wp: Any, result: Any, constants_type: Any, column_type: Any, one: Any, other: Any
) -> Any:
    """Return the sum, of type ``result``, of two functions of constants and a column."""

    @wp.func
    def both(constants: constants_type, column: column_type) -> result:
        return one(constants, column) + other(constants, column)

    return both


@lru_cache
def structure(name: str, names: tuple[str, ...], real: Any) -> Any:
    """Return a Warp struct of scalars of these names."""
    import warp as wp

    body = {'__annotations__': dict.fromkeys(names, real), '__module__': __name__}
    return wp.struct(type(name, (), body))
