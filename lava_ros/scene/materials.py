# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0


"""Lavas by name, with the source of each number."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from importlib import resources
import logging
from typing import Any

from lava_ros import validation
from lava_ros.errors import LavaError
from lava_ros.scene.lava import Lava

_LOG = logging.getLogger(__name__)

#: The file of the package that holds them.
FILE = 'materials.yaml'

#: What a lava is that nobody names: in files, commands, the node and Python's scenes.
DEFAULT = 'etna_basalt'


@dataclass(frozen=True)
class Constant:
    """A number, or the name of a law, with its reference.

    ``range`` has the smallest and the largest published value, where both are known.
    """

    value: float | str
    source: str
    range: tuple[float, float] | None = None
    range_source: str = ''


@dataclass(frozen=True)
class Material:
    """A lava, by its name in scene and case files, and the temperature [K] at its vent.

    ``constants`` are the fields of ``Lava`` that have a source; the others keep their defaults.
    """

    name: str
    title: str
    vent_temperature: Constant
    constants: Mapping[str, Constant]

    @property
    def lava(self) -> Lava:
        """The constants as the simulation takes them."""
        return self.lava_with({})

    def lava_with(self, overrides: Mapping[str, Any]) -> Lava:
        """The lava with other values of some fields of ``Lava``; LavaError names a wrong one."""
        names = [item.name for item in fields(Lava)]
        overrides = validation.keys('lava', overrides, allowed=names)
        # constants of an effect that was deleted have no field
        values = {name: item.value for name, item in self.constants.items() if name in names}
        return Lava(**{**values, **overrides})


@cache
def materials() -> dict[str, Material]:
    """All lavas, by name."""
    from lava_ros.files.yaml import parse_yaml

    text = resources.files('lava_ros.scene').joinpath(FILE).read_text(encoding='utf-8')
    data = parse_yaml(FILE, text)
    return {
        name: Material(
            name,
            item['title'],
            _constant(item['vent_temperature'], data['sources']),
            {key: _constant(value, data['sources']) for key, value in item['constants'].items()},
        )
        for name, item in data['materials'].items()
    }


def material_named(name: object) -> Material:
    """The lava of a name; LavaError lists the names where it is none."""
    known = materials()
    return known[validation.choice('lava.material', name, known)]


def default_lava() -> Lava:
    """The lava of scenes that name none, ``DEFAULT``."""
    return material_named(DEFAULT).lava


def lava_from_dict(
    label: str, data: object, replacement: str | None = None
) -> tuple[Lava, Material]:
    """Build a lava from the plain data of a YAML file, and return it with its material.

    The data are a mapping with the fields of ``Lava``; ``material`` names the lava whose constants
    they replace, ``DEFAULT`` where it is absent. ``replacement`` is the name of a material to take
    instead. A LavaError calls the data ``label``.
    """
    names = [item.name for item in fields(Lava)]
    given = validation.keys(label, data, allowed=['material', *names])
    name = given.pop('material', DEFAULT)
    material = material_named(name if replacement is None else replacement)
    return material.lava_with(given), material


def with_material_in_lava(label: str, data: Mapping[str, Any]) -> dict[str, Any]:
    """Move ``material`` beside ``lava``, where case files had it, into ``lava``, with a warning.

    Args:
        label: What messages call the file.
        data: The mapping of a scene or case file.

    Returns:
        The mapping without ``material``.

    Raises:
        LavaError: ``lava`` is not a mapping, or names a material too.
    """
    data = dict(data)
    if 'material' in data:
        name, lava = data.pop('material'), data.get('lava', {})
        if not isinstance(lava, Mapping):
            raise LavaError(f'{label}.lava', lava, 'a mapping of constants')
        if 'material' in lava:
            raise LavaError(f'{label}.material', name, 'absent beside lava.material')
        _LOG.warning(f'{label}.material: its place is lava: {{material: {name}}}')
        data['lava'] = {'material': name, **lava}
    return data


def _constant(item: Mapping[str, Any], sources: Mapping[str, str]) -> Constant:
    low_high = item.get('range')
    return Constant(
        item['value'],
        sources[item['source']],
        None if low_high is None else (float(low_high[0]), float(low_high[1])),
        sources[item['range_source']] if low_high else '',
    )
