# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava as it leaves the vents: its material, temperature and viscosity, as numbers and as text."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
import math
from typing import Any

from lava_ros.errors import LavaError
from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import DEFAULT, material_named, materials
from lava_ros.scene.plausibility import KELVIN
from lava_ros.scene.scene import Scene

#: Maximum number of constants that may differ from those of a material that still has its name.
MAX_CHANGED = 4


@dataclass(frozen=True)
class EruptingLava:
    """Lava as it leaves the vents of a scene.

    Attributes:
        material: Name of the material with the same constants, except for ``changed``, which is
            that of the scene if possible; None for lava that is like no material.
        changed: Names of the constants that differ from those of the material.
        vents: Name, temperature [K] and viscosity [Pa s] of the lava of each vent.
    """

    material: str | None
    changed: tuple[str, ...]
    vents: tuple[tuple[str, float, float], ...]

    @classmethod
    def of(cls, scene: Scene) -> 'EruptingLava':
        """Return the erupting lava of a scene."""
        return cls(*material_of(scene.lava, scene.uncertainty.material), tuple(
            (vent.name, vent.temperature, scene.lava.viscosity_at(vent.temperature))
            for vent in scene.vents
            if vent.temperature is not None
        ))

    @classmethod
    def described(cls, known: Mapping[str, Any] | None) -> 'EruptingLava | None':
        """Return the lava in the description of a scene, by ``scene_to_dict``; None if invalid."""
        if not known:
            return None
        try:
            lava = material_named(DEFAULT).lava_with(known.get('lava') or {})
            hot = lava.reference_temperature
            named = str((known.get('uncertainty') or {}).get('material', ''))
            vents = [
                (str(vent.get('name', '')), float(vent.get('temperature') or hot))
                for vent in known.get('vents') or ()
            ]
        except (LavaError, AttributeError, TypeError, ValueError):
            return None
        return cls(*material_of(lava, named), tuple(
            (name, temperature, lava.viscosity_at(temperature)) for name, temperature in vents
        ))

    def as_dict(self) -> dict[str, Any]:
        """Return the lava as plain data for JSON."""
        return {
            'material': self.material,
            'changed_constants': list(self.changed),
            'vents': [
                {'name': name, 'temperature_k': temperature, 'viscosity_pa_s': viscosity}
                for name, temperature, viscosity in self.vents
            ],
        }

    def text(self) -> str:
        """Format the lava as one line for people."""
        words = 'lava like no known material' if self.material is None else self.material
        if self.changed:
            words += f' (changed: {", ".join(self.changed)})'
        if not self.vents:
            return words
        temperatures = sorted({temperature for _, temperature, _ in self.vents})
        viscosities = sorted({viscosity for _, _, viscosity in self.vents})
        celsius = _span([f'{value - KELVIN:.0f}' for value in temperatures])
        kelvin = _span([f'{value:.0f}' for value in temperatures])
        stiff = _span([_rounded(value) for value in viscosities])
        return (
            f'{words}; at the vent{"s" * (len(self.vents) > 1)} {celsius} °C ({kelvin} K) and '
            f'{stiff} Pa s'
        )


def material_of(lava: Lava, named: str = '') -> tuple[str | None, tuple[str, ...]]:
    """Return the name of the material of a lava, and the constants that differ from it.

    Args:
        lava: The lava.
        named: Material that the user has named. It precedes materials that are more similar, but
            not one with the same constants.

    Returns:
        Name and constants; None and no constants if more than ``MAX_CHANGED`` differ from each.
    """
    own = asdict(lava)

    def changed(name: str) -> tuple[str, ...]:
        usual = asdict(materials()[name].lava)
        return tuple(key for key, value in own.items() if not _is_same(value, usual[key]))

    found = {name: changed(name) for name in materials()}
    near = {name: keys for name, keys in found.items() if len(keys) <= MAX_CHANGED}
    if not near:
        return None, ()
    best = min(near, key=lambda name: (len(near[name]) > 0, name != named, len(near[name])))
    return best, near[best]


def _is_same(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9)
    return one == other


def _rounded(value: float) -> str:
    """Format a viscosity with three digits: 5,890, 0.02, 3.16e+08."""
    rounded = float(f'{value:.3g}')
    return f'{rounded:,.0f}' if 100.0 <= rounded < 1e7 else f'{rounded:g}'


def _span(texts: list[str]) -> str:
    return texts[0] if texts[0] == texts[-1] else f'{texts[0]} to {texts[-1]}'
