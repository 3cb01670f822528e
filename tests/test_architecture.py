# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The rooms of the package: what imports what, held against docs/ARCHITECTURE.md."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / 'docs/ARCHITECTURE.md').read_text(encoding='utf-8')
MODULES = {
    '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__'): path
    for path in (ROOT / 'lava_ros').rglob('*.py')
}


def imports_of(module: str) -> set[str]:
    """Modules of the package that one imports when it runs, at once or later."""
    found = set()
    waiting: list[ast.AST] = [ast.parse(MODULES[module].read_text(encoding='utf-8'))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and 'TYPE_CHECKING' in ast.unparse(node.test):
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f'{node.module}.{alias.name}' for alias in node.names}
            found |= {name if name in MODULES else node.module for name in names}
        waiting += ast.iter_child_nodes(node)
    return {name for name in found if name in MODULES} - {module, 'lava_ros'}


ARROWS = {module: imports_of(module) for module in MODULES}


def room_of(module: str) -> str:
    """The room that a module is in; what an effect runs on the device is the solver's."""
    parts = module.split('.')
    if parts[1:2] == ['effects'] and parts[-1] == 'device':
        return 'simulation'
    return parts[1] if len(parts) > 1 else 'errors'


def test_arrows_run_one_way():
    """No room knows of one behind it, and the page names them all."""
    (line,) = re.findall(r'^    (errors .*)$', PAGE, re.MULTILINE)
    order = line.split()
    assert {room_of(module) for module in MODULES} == set(order)
    back = [
        (module, other)
        for module, others in ARROWS.items()
        for other in others
        if order.index(room_of(other)) > order.index(room_of(module))
    ]
    assert not back


def test_there_is_no_circle():
    """Modules can be put in an order in which each comes after what it imports."""
    TopologicalSorter(ARROWS).prepare()


def test_nothing_is_loose_at_the_top():
    """Beside rooms there are only errors and validation."""
    loose = {path.name for path in (ROOT / 'lava_ros').glob('*.py')}
    assert loose == {'__init__.py', 'errors.py', 'validation.py'}


@pytest.mark.parametrize(('title', 'most'), [('A vent', 15), ('A viscosity', 11)])
def test_journeys_are_as_listed(title, most):
    """Each file of a journey exists, and imports another one or is imported by one."""
    section = PAGE.partition(f'\n## {title}, from its ')[2].partition('\n## ')[0]
    paths = re.findall(r'^\d+\. `(\S+)\.py`', section, re.MULTILINE)
    names = ['lava_ros.' + path.replace('/', '.') for path in paths]
    assert 5 < len(names) <= most
    for name in names:
        assert any(knows(name, other) or knows(other, name) for other in names), name


def knows(module: str, other: str) -> bool:
    """Whether a module imports another one, or the room that passes its names on."""
    rooms = {item for item in ARROWS[module] if MODULES[item].name == '__init__.py'}
    return other in ARROWS[module] or other.rpartition('.')[0] in rooms
