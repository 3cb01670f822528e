# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lavas by name, with the reference of each constant."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from importlib import resources
import logging
import math
from typing import Any

from lava_ros import validation
from lava_ros.effects import drop_superseded, EFFECTS, possible
from lava_ros.errors import LavaError
from lava_ros.scene.composition import vft_constants
from lava_ros.scene.lava import constant_units, default_of_lava, Lava
from lava_ros.scene.plausibility import SILICIC

_LOG = logging.getLogger(__name__)

#: File of the package with the materials.
FILE = 'materials.yaml'

#: Name of the default material in scene files, commands, the node and the Python API.
DEFAULT = 'etna_basalt'

#: Units in which constants are often given by mistake, and the conversion to that of ``Lava``.
#: Values in both units are credible; ``plausibility.RANGES`` has the constants of which one is.
_OTHER_UNITS: Mapping[str, tuple[str, Callable[[float], float]]] = {
    'viscosity': ('log10 Pa s', lambda value: 10.0 ** min(value, 100.0)),
    **dict.fromkeys(
        ('reference_temperature', 'liquidus', 'solidus', 'crust_temperature'),
        ('Celsius', lambda value: value + 273.15),
    ),
}

#: Maximum ratio of a constant in another unit to the usual one.
MAX_RATIO = 1e3

#: Half of the range of ``vft_a`` by a composition: a standard deviation of 0.40, uniform.
VFT_A_ERROR = 0.69

#: Name of the material that has the other constants of a melt given by its composition.
ANY_BASALT = 'basalt'


@dataclass(frozen=True)
class Constant:
    """A number, or the name of a law, with its reference.

    ``range`` has the minimum and the maximum published value, if both are known. ``follows`` is
    that of the constant's distribution (``distributions.Distribution``).
    """

    value: float | str
    source: str
    range: tuple[float, float] | None = None
    range_source: str = ''
    follows: str = ''


@dataclass(frozen=True)
class Material:
    """A lava with a name in scene and case files, and its eruption temperature [K].

    ``constants`` are the fields of ``Lava`` with a source; the others are those of ``Lava.paper``.
    ``composition`` is that of the melt in wt% of oxides, if it is the source of the viscosity;
    its numbers have no source if a scene or case file gives them.
    """

    name: str
    title: str
    vent_temperature: Constant
    constants: Mapping[str, Constant]
    composition: Mapping[str, Constant] = field(default_factory=dict)

    @property
    def lava(self) -> Lava:
        """Constants for a simulation."""
        return self.lava_with({})

    def lava_with(self, overrides: Mapping[str, Any]) -> Lava:
        """Return the lava with some fields of ``Lava`` replaced; raise LavaError for a bad one."""
        names = [item.name for item in fields(Lava)]
        overrides = validation.keys('lava', overrides, allowed=names)
        # constants of an effect that was deleted have no field
        values = {name: item.value for name, item in self.constants.items() if name in names}
        # laws that need no reference temperature leave it to vents without a temperature
        usual = {'reference_temperature': self.vent_temperature.value}
        return Lava.paper(**{**usual, **values, **overrides})


@cache
def materials() -> dict[str, Material]:
    """Return all materials by name."""
    from lava_ros.files.yaml import parse_yaml

    text = resources.files('lava_ros.scene').joinpath(FILE).read_text(encoding='utf-8')
    data = parse_yaml(FILE, text)
    return {
        name: _material(name, item, data['sources']) for name, item in data['materials'].items()
    }


def material_named(name: object) -> Material:
    """Return the material of a name; raise LavaError for an unknown name."""
    known = materials()
    return known[validation.choice('lava.material', name, known)]


@default_of_lava
def default_lava() -> Lava:
    """Return the lava of a scene without a material, ``DEFAULT``."""
    return material_named(DEFAULT).lava


def lava_from_dict(label: str, data: object) -> tuple[Lava, Material]:
    """Build a lava from the plain data of a YAML file, and return it with its material.

    If the data have a composition, the material has it, without a source, and its constants.

    Args:
        label: Name of the data in errors.
        data: Mapping with fields of ``Lava``, and optionally ``material``, the name of the
            material whose constants they replace, and ``composition``, that of the melt in wt% of
            oxides, which gives the constants of the VFT law. The material is by default
            ``DEFAULT``, or ``ANY_BASALT`` with a composition.

    Raises:
        LavaError: If a name or a value is not valid.
    """
    names = [item.name for item in fields(Lava)]
    given = validation.keys(label, data, allowed=['material', 'composition', *names])
    melt: Any = given.pop('composition', None)
    material = material_named(given.pop('material', DEFAULT if melt is None else ANY_BASALT))
    if melt is not None:
        law = vft_constants(f'{label}.composition', melt)
        known = material_named(ANY_BASALT).constants
        material = replace(
            material,
            composition={oxide: Constant(float(value), '') for oxide, value in melt.items()},
            constants=dict(material.constants)
            | {key: replace(known[key], value=value) for key, value in law.items()},
        )
        given = law | given
    lava = material.lava_with(given)
    for text in _doubts(given, lava, material.lava):
        _LOG.warning(f'{label}.{text}')
    return lava, material


def _doubts(given: Iterable[str], lava: Lava, usual: Lava) -> Iterator[str]:
    """Describe given constants that have no effect, or are probably in another unit.

    In the other unit they would be closer to those of the ``usual`` lava, as a ratio.
    """
    owners = {key: name for name, effect in EFFECTS.items() for key in effect.constants}
    if lava.is_vft:
        owners |= dict.fromkeys(('viscosity', 'arrhenius'), 'arrhenius')
    active = drop_superseded(possible(lava))
    defaults, units = {item.name: item.default for item in fields(Lava)}, constant_units()
    for name in given:
        value = getattr(lava, name)
        if value == defaults[name]:
            continue
        if name in owners and owners[name] not in active:
            yield f'{name} is {value}, but has no effect: ' + (
                'the VFT law of this lava gives its viscosity' if owners[name] == 'arrhenius' else
                f'the lava lacks other constants of the effect {owners[name]}'
            )
        elif name in _OTHER_UNITS and value > 0.0 < getattr(usual, name):
            other, convert = _OTHER_UNITS[name]
            expected, read = getattr(usual, name), convert(value)
            away = abs(math.log(read / expected))
            # silicic lava is colder
            if other == 'Celsius' and lava.viscosity_at(lava.reference_temperature) >= SILICIC:
                continue
            if away < min(abs(math.log(value / expected)), math.log(MAX_RATIO)):
                yield (
                    f'{name} is {value:g} {units[name]}: {value:g} {other} would be {read:g} '
                    f'{units[name]}, closer to the usual {expected:g} {units[name]}'
                )


def with_material_in_lava(label: str, data: Mapping[str, Any]) -> dict[str, Any]:
    """Move a top-level ``material``, as in old case files, into ``lava``, with a warning.

    Args:
        label: Name of the file in messages.
        data: Mapping of a scene or case file.

    Returns:
        Mapping without a top-level ``material``.

    Raises:
        LavaError: If ``lava`` is not a mapping, or also has a material.
    """
    data = dict(data)
    if 'material' in data:
        name, lava = data.pop('material'), data.get('lava', {})
        if not isinstance(lava, Mapping):
            raise LavaError(f'{label}.lava', lava, 'a mapping of constants')
        if 'material' in lava:
            raise validation.conflict(f'{label}.material', f'{label}.lava.material')
        _LOG.warning(f'{label}.material: its place is lava: {{material: {name}}}')
        data['lava'] = {'material': name, **lava}
    return data


def _material(name: str, item: Mapping[str, Any], sources: Mapping[str, str]) -> Material:
    constants = {key: _constant(value, sources) for key, value in item['constants'].items()}
    oxides: dict[str, Constant] = {}
    if 'composition' in item:
        melt, cited = item['composition']['value'], sources[item['composition']['source']]
        oxides = {oxide: Constant(value, cited) for oxide, value in melt.items()}
        law = vft_constants(f'{FILE}.{name}.composition', melt)
        by_melt = {key: Constant(value, sources['giordano2008']) for key, value in law.items()}
        low_high = law['vft_a'] - VFT_A_ERROR, law['vft_a'] + VFT_A_ERROR
        by_melt['vft_a'] = replace(
            by_melt['vft_a'], range=low_high, range_source=sources['giordano2008_error']
        )
        constants = {**by_melt, **constants}
    hot = _constant(item['vent_temperature'], sources)
    return Material(name, item['title'], hot, constants, oxides)


def _constant(item: Mapping[str, Any], sources: Mapping[str, str]) -> Constant:
    low_high = item.get('range')
    return Constant(
        item['value'],
        sources[item['source']],
        None if low_high is None else (float(low_high[0]), float(low_high[1])),
        sources[item['range_source']] if low_high else '',
        item.get('follows', ''),
    )
