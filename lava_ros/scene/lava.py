# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Material constants of lava."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import Any, TYPE_CHECKING

from lava_ros.effects import EFFECTS, laws, possible
from lava_ros.effects.effect import check_fields, join_names, number, with_fields
from lava_ros.errors import LavaError


@dataclass(frozen=True)
@with_fields(partial(join_names, 'constants', EFFECTS))
class Lava:
    """Material constants; each field declares its description, unit and limits.

    As in a scene file, constants that are not given are those of the default material
    (``materials.DEFAULT``): ``Lava(viscosity=1e4)`` is the lava of ``lava: {viscosity: 1e4}``.
    ``Lava.paper`` takes the others from the paper of the method.

    A constant that only one effect uses is declared in the file of the effect, except for
    ``arrhenius``, which is not 0 in the paper. The values here are those of table 3.1 in the
    paper; constants that the table lacks are 0, which switches their physics off.
    """

    density: float = number(2500.0, 'Density', 1.0, 1e5, 'kg/m3')
    specific_heat: float = number(1150.0, 'Specific heat capacity', 1.0, 1e5, 'J/(kg K)')

    viscosity: float = number(
        100.0, 'Dynamic viscosity (consistency, Pa s^n) at reference_temperature', 1e-6, 1e15,
        'Pa s',
    )
    reference_temperature: float = number(
        1423.0, 'Temperature at which viscosity and yield_strength hold', 1.0, 5000.0, 'K'
    )
    # 8e-3 is the paper's value, 0.04 is usual in the field (Dragoni 1989)
    arrhenius: float = number(
        8e-3, 'Rate of the Arrhenius law of viscosity; 0: constant', 0.0, 1.0, '1/K'
    )
    liquidus: float = number(
        1473.0, 'Temperature above which there are no crystals', 1.0, 5000.0, 'K'
    )
    solidus: float = number(
        0.0, 'Temperature below which lava is solid; 0: never', 0.0, 5000.0, 'K'
    )
    emissivity: float = number(0.9, 'Emissivity of the surface; 0: no radiation', 0.0, 1.0)
    convection: float = number(50.0, 'Heat transfer to the air; 0: none', 0.0, 1e5, 'W/(m2 K)')
    conductivity: float = number(
        0.0, 'Thermal conductivity of lava, along the flow and of its crust; 0: none', 0.0, 1e3,
        'W/(m K)',
    )

    if TYPE_CHECKING:

        def __init__(self, **constants: Any) -> None: ...  # noqa: D107

        def __getattr__(self, name: str) -> Any: ...  # noqa: D105

    def __post_init__(self) -> None:
        """Validate all fields and their combinations; raise LavaError for an invalid one."""
        check_fields('lava', self)
        if self.solidus >= self.liquidus:
            expected = f'below lava.liquidus, {self.liquidus:g} K'
            raise LavaError('lava.solidus', self.solidus, expected)
        for effect in EFFECTS.values():
            effect.check(self)

    @classmethod
    def paper(cls, **constants: Any) -> Lava:
        """Return the lava of the paper, with the given constants in place of its own.

        Args:
            constants: Constants by name; all others are those of table 3.1 or 0, which switches
                their physics off.

        Raises:
            LavaError: If a constant is not valid.
        """
        return cls(**{item.name: item.default for item in fields(cls)} | constants)

    @property
    def is_vft(self) -> bool:
        """True if the viscosity follows the VFT law."""
        return 'vft' in possible(self)

    @property
    def radiates(self) -> bool:
        """True if the lava loses heat to the air."""
        return self.emissivity > 0.0 or self.convection > 0.0

    def viscosity_at(self, temperature: float) -> float:
        """Return the viscosity [Pa s] at a temperature [K], including the effect of crystals."""
        return laws.rheology_of(self).viscosity_at(temperature)

    def yield_strength_at(self, temperature: float) -> float:
        """Return the yield strength [Pa] at a temperature [K]."""
        return laws.rheology_of(self).strength_at(temperature)


_set_all = Lava.__init__

#: Returns the default lava; set by its module, because materials are lavas, too.
_default: list[Callable[[], Lava]] = []


def default_of_lava(function: Callable[[], Lava]) -> Callable[[], Lava]:
    """Register the function that returns the default lava."""
    _default.append(function)
    return function


def _initialize(self: Lava, **constants: Any) -> None:
    """Initialize from constants by name; those of the default material are used for others."""
    if len(constants) < len(fields(Lava)):
        constants = asdict(_default[0]()) | constants
    _set_all(self, **constants)


Lava.__init__ = _initialize  # type: ignore[method-assign]


def constant_units() -> dict[str, str]:
    """Return the unit of each constant of a lava and of the vent temperature by name."""
    units = {item.name: item.metadata.get('unit') or '' for item in fields(Lava)}
    return {'vent_temperature': 'K', **units}
