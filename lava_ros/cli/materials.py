# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava materials`: the named lavas."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from lava_ros.cli.console import write_json
from lava_ros.cli.options import argument, command

if TYPE_CHECKING:
    from lava_ros.scene.materials import Constant


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
    if args.json:
        write_json([asdict(item) for item in chosen], args.json)
        return 0
    units = {**constant_units(), **dict.fromkeys(MOLAR_MASSES, 'wt%')}
    sources: dict[str, int] = {}
    for material in chosen:
        print(f'{material.name}: {material.title}')
        constants = {
            'vent_temperature': material.vent_temperature,
            **material.composition,
            **material.constants,
        }
        for name, constant in constants.items():
            value = constant.value
            shown = value if isinstance(value, str) else f'{value:g}'
            print(f'  {name:22} {shown:>16} {units[name]:9} {_cited(constant, sources)}')
        print()
    for source, number in sources.items():
        print(f'[{number}] {source}')
    return 0


def _cited(constant: Constant, sources: dict[str, int]) -> str:
    text = f'[{sources.setdefault(constant.source, len(sources) + 1)}]'
    if constant.range is not None:
        number = sources.setdefault(constant.range_source, len(sources) + 1)
        text += f'  published: {constant.range[0]:g} to {constant.range[1]:g} [{number}]'
    return text
