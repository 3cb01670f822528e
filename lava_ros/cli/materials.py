# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava materials`: the named lavas."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, TYPE_CHECKING

from lava_ros.cli.console import write_json
from lava_ros.cli.options import argument, command

if TYPE_CHECKING:
    from lava_ros.scene.materials import Constant, Material


@command(
    argument('name', 'NAME', 'list only this lava', nargs='?'),
    '--json',
)
def materials(args: argparse.Namespace) -> int:
    """List the named lavas, with their constants and sources.

    A scene file and the case.yaml of a case name one with lava: {material: NAME}, or give the
    composition of the melt with lava: {composition: {SiO2: 50.4, ...}}, in wt%.
    """
    from lava_ros.scene.composition import MOLAR_MASSES
    from lava_ros.scene.lava import constant_units
    from lava_ros.scene.materials import material_named
    from lava_ros.scene.materials import materials as known_materials

    chosen = [material_named(args.name)] if args.name else list(known_materials().values())
    units = {**constant_units(), **dict.fromkeys(MOLAR_MASSES, 'wt%')}
    if args.json:
        write_json({'materials': [_as_dict(item, units) for item in chosen]}, args.json)
        return 0
    sources: dict[str, int] = {}
    for material in chosen:
        print(f'{material.name}: {material.title}')
        for name, constant in _constants(material).items():
            value = constant.value
            shown = value if isinstance(value, str) else f'{value:g}'
            print(f'  {name:22} {shown:>16} {units[name]:9} {_cited(constant, sources)}')
        print()
    for source, number in sources.items():
        print(f'[{number}] {source}')
    return 0


def _constants(material: Material) -> dict[str, Constant]:
    temperature = {'vent_temperature': material.vent_temperature}
    return {**temperature, **material.composition, **material.constants}


def _as_dict(material: Material, units: Mapping[str, str]) -> dict[str, Any]:
    """Return a material as plain data, with the unit of each constant."""
    constants = [
        {'name': name, 'unit': units[name], **asdict(constant)}
        for name, constant in _constants(material).items()
    ]
    return {'name': material.name, 'title': material.title, 'constants': constants}


def _cited(constant: Constant, sources: dict[str, int]) -> str:
    text = f'[{sources.setdefault(constant.source, len(sources) + 1)}]'
    if constant.range is not None:
        number = sources.setdefault(constant.range_source, len(sources) + 1)
        text += f'  published: {constant.range[0]:g} to {constant.range[1]:g} [{number}]'
    return text
