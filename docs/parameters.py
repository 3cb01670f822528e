# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Write the parameters into docs/ROS.md and params/lava.yaml: `python docs/parameters.py`."""

from collections.abc import Iterator
import json
from pathlib import Path
import re
from textwrap import wrap

import yaml

from lava_ros.ros import parameters
from lava_ros.scene import constants_of

PAGE = Path(__file__).with_name('ROS.md')
FILE = PAGE.parents[1] / 'params/lava.yaml'
BEGIN, END = '<!-- parameters: begin -->\n', '<!-- parameters: end -->\n'
HEAD = '| parameter | type | default | range | unit | may change | meaning |'

#: The file from which lava.launch.py declares its arguments.
LAUNCH = PAGE.parents[1] / 'launch/lava_parameters.yaml'

#: Part of the descriptions of parameters that are read at each reset.
LATER = 'from the next start or reset'


def launch_arguments() -> str:
    """Return the default and the description of each parameter as YAML, for lava.launch.py."""
    listed = {
        spec.name: {'default': spec.default, 'description': spec.description} for spec in specs()
    }
    text = yaml.safe_dump(listed, sort_keys=False, width=98)
    return f'# Parameters of the node. Written by docs/parameters.py.\n{text}'


def specs() -> Iterator[parameters.ParameterSpec]:
    """Yield all parameters of the node."""
    yield from parameters.LIFECYCLE
    yield from parameters.SOURCES
    yield from parameters.PARAMETERS
    yield from parameters.constant_parameters(constants_of(None))


def default(spec: parameters.ParameterSpec) -> str:
    """Return the default of a parameter as YAML."""
    # ROS tools read 7e-07 as a string
    return re.sub(r'^(-?\d+)e', r'\1.0e', json.dumps(spec.default))


def change(spec: parameters.ParameterSpec) -> str:
    """Return when a parameter may change: no, at a reset, or yes."""
    return 'no' if spec.read_only else 'at a reset' if LATER in spec.description else 'yes'


def row(spec: parameters.ParameterSpec) -> str:
    """Return the row of a parameter in the table."""
    unit = re.search(r'\[([^\]]+)\]', spec.description)
    cells = (
        f'`{spec.name}`',
        spec.type_name,
        f'`{default(spec)}`',
        spec.range_text,
        unit.group(1) if unit else '',
        change(spec),
        spec.description.replace('<', r'\<').replace('*', r'\*'),
    )
    return f'| {" | ".join(cells)} |'


def table() -> str:
    """Return the table."""
    rule = '|'.join(['---'] * (HEAD.count('|') - 1))
    return '\n'.join([HEAD, f'|{rule}|', *map(row, specs()), ''])


def page(old: str) -> str:
    """Return the page with its table up to date."""
    before, _, rest = old.partition(BEGIN)
    return f'{before}{BEGIN}\n{table()}\n{END}{rest.partition(END)[2]}'


#: Beginning of the parameter file.
FILE_HEAD = """\
# yaml-language-server: $schema=../schemas/parameters.schema.json
# Parameters of the node with their defaults: a file to copy and to change, for
#     ros2 launch lava_ros lava.launch.py params_file:=my.yaml
#     lava ros node --ros-args --params-file my.yaml
# Arguments of the launch file take precedence over this file. The value of a parameter that is not
# an integer needs a decimal point (5.0). Written by docs/parameters.py.
/**:
  ros__parameters:
"""

#: Text above the parameters whose defaults come from the scene.
OF_SCENE = """
    # Lava and surroundings. Without a value here they come from the scene file. The values below
    # are those without a scene file.
"""


def entry(spec: parameters.ParameterSpec, *, is_set: bool) -> str:
    """Return the entry of a parameter with its meaning; commented out unless ``is_set``."""
    when = {'no': 'read when the node is configured', 'yes': 'may change while the node runs'}
    facts = '; '.join(filter(None, (spec.range_text, when.get(change(spec)))))
    lines = wrap(f'{spec.description} ({facts})'.removesuffix(' ()'), 93)
    comment = ''.join(f'    # {line}\n' for line in lines)
    return f'{comment}    {"# " * (not is_set)}{spec.name}: {default(spec)}\n'


def file() -> str:
    """Return the parameter file."""
    constants = [spec.name for spec in parameters.constant_parameters(constants_of(None))]
    own = [entry(spec, is_set=True) for spec in specs() if spec.name not in constants]
    of_scene = [entry(spec, is_set=False) for spec in specs() if spec.name in constants]
    return ''.join([FILE_HEAD, *own, OF_SCENE, *of_scene])


if __name__ == '__main__':
    LAUNCH.write_text(launch_arguments(), encoding='utf-8')
    PAGE.write_text(page(PAGE.read_text(encoding='utf-8')), encoding='utf-8')
    FILE.write_text(file(), encoding='utf-8')
