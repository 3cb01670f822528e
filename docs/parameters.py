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

"""Write the table of parameters in docs/ROS.md: `python docs/parameters.py`."""

from collections.abc import Iterator
import json
from pathlib import Path
import re

import yaml

from lava_ros.ros import parameters
from lava_ros.scene import constants_of

PAGE = Path(__file__).with_name('ROS.md')
BEGIN, END = '<!-- parameters: begin -->\n', '<!-- parameters: end -->\n'
HEAD = '| parameter | type | default | range | unit | may change | meaning |'

#: The file from which lava.launch.py declares its arguments.
LAUNCH = PAGE.parents[1] / 'launch/lava_parameters.yaml'

#: What stands in the description of a parameter that is looked at again by a reset.
LATER = 'from the next start or reset on'


def launch_arguments() -> str:
    """The default and the description of each parameter, for lava.launch.py."""
    listed = {
        spec.name: {'default': spec.default, 'description': spec.description} for spec in specs()
    }
    text = yaml.safe_dump(listed, sort_keys=False, width=98)
    return f'# Parameters of the node. Written by docs/parameters.py.\n{text}'


def specs() -> Iterator[parameters.ParameterSpec]:
    """Every parameter that the node declares."""
    yield from parameters.LIFECYCLE
    yield from parameters.SOURCES
    yield from parameters.PARAMETERS
    yield from parameters.constant_parameters(constants_of(None))


def limits(spec: parameters.ParameterSpec) -> str:
    """The range of a number."""
    style = '.12g' if isinstance(spec.default, float) else '.0f'
    return ' to '.join(format(limit, style) for limit in spec.limits or ())


def row(spec: parameters.ParameterSpec) -> str:
    """A parameter's row of the table."""
    types = {bool: 'bool', int: 'integer', float: 'double', str: 'string', list: 'string_array'}
    # ROS's tools take 7e-07 for a text
    default = re.sub(r'^(-?\d+)e', r'\1.0e', json.dumps(spec.default))
    unit = re.search(r'\[([^\]]+)\]', spec.description)
    cells = (
        f'`{spec.name}`',
        types[type(spec.default)],
        f'`{default}`',
        limits(spec),
        unit.group(1) if unit else '',
        'no' if spec.read_only else 'at a reset' if LATER in spec.description else 'yes',
        spec.description.replace('<', r'\<').replace('*', r'\*'),
    )
    return f'| {" | ".join(cells)} |'


def table() -> str:
    """The table."""
    rule = '|'.join(['---'] * (HEAD.count('|') - 1))
    return '\n'.join([HEAD, f'|{rule}|', *map(row, specs()), ''])


def page(old: str) -> str:
    """The page with the table as it should be."""
    before, _, rest = old.partition(BEGIN)
    return f'{before}{BEGIN}\n{table()}\n{END}{rest.partition(END)[2]}'


if __name__ == '__main__':
    LAUNCH.write_text(launch_arguments(), encoding='utf-8')
    PAGE.write_text(page(PAGE.read_text(encoding='utf-8')), encoding='utf-8')
