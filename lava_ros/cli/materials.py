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

"""List the lavas that have a name, with their constants and sources.

A scene file names one with lava: {material: NAME}, and a case with material: NAME.
"""

import argparse
from dataclasses import asdict, fields
import json

from lava_ros.scene.lava import Lava
from lava_ros.scene.materials import Constant, material_named, materials


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('name', nargs='?', metavar='NAME', help='list only this lava')
    parser.add_argument('--json', action='store_true', help='print JSON')


def run(args: argparse.Namespace) -> int:
    """Print the list."""
    chosen = [material_named(args.name)] if args.name else list(materials().values())
    if args.json:
        print(json.dumps([asdict(item) for item in chosen], indent=1))
        return 0
    units = {item.name: item.metadata.get('unit', '') for item in fields(Lava)}
    sources: dict[str, int] = {}
    for material in chosen:
        print(f'{material.name}: {material.title}')
        constants = {'vent_temperature': material.vent_temperature, **material.constants}
        for name, constant in constants.items():
            unit = 'K' if name == 'vent_temperature' else units[name]
            print(f'  {name:22} {_value(constant.value):>16} {unit:9} {_cited(constant, sources)}')
        print()
    for source, number in sources.items():
        print(f'[{number}] {source}')
    return 0


def _cited(constant: Constant, sources: dict[str, int]) -> str:
    """Numbers of the references of a constant and of its range."""
    text = f'[{sources.setdefault(constant.source, len(sources) + 1)}]'
    if constant.range is not None:
        number = sources.setdefault(constant.range_source, len(sources) + 1)
        text += f'  published: {constant.range[0]:g} to {constant.range[1]:g} [{number}]'
    return text


def _value(value: float | str) -> str:
    return value if isinstance(value, str) else f'{value:g}'
