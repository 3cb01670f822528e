# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Imports between the rooms of the package, compared with docs/ARCHITECTURE.md."""

import ast
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
import re

import pytest

from project import imported_names, MODULES

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / 'docs/ARCHITECTURE.md').read_text(encoding='utf-8')
(LINE,) = re.findall(r'^    (errors .*)$', PAGE, re.MULTILINE)
ORDER = LINE.split()


@cache
def imports() -> dict[str, set[str]]:
    """Return the modules of the package that each module imports."""
    found = {}
    for module, names in imported_names().items():
        owners = {name if name in MODULES else name.rpartition('.')[0] for name in names}
        found[module] = owners & MODULES.keys() - {module, 'lava_ros'}
    return found


def room_of(module: str) -> str:
    """Return the room of a module."""
    parts = module.split('.')
    return parts[1] if len(parts) > 1 else 'errors'


def test_imports_follow_the_order_of_rooms():
    assert {room_of(module) for module in MODULES} == set(ORDER)
    back = [
        (module, other)
        for module, others in imports().items()
        for other in others
        if ORDER.index(room_of(other)) > ORDER.index(room_of(module))
    ]
    assert not back


def test_rooms_before_the_node_import_no_rclpy():
    order = ORDER[: ORDER.index('ros')]
    for module, path in MODULES.items():
        if room_of(module) in order:
            assert not re.search(
                r'^\s*(from|import) (rclpy|\w+_(msgs|srvs|interfaces))\b',
                path.read_text(encoding='utf-8'), re.MULTILINE,
            ), module


def test_one_loop_runs_simulations_without_a_clock():
    found = set()
    for module, path in MODULES.items():
        if room_of(module) not in ('simulation', 'live'):
            tree = ast.parse(path.read_text(encoding='utf-8'))
            found |= {
                module for node in ast.walk(tree)
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
                and (node.func.attr == 'advancing' or ast.unparse(node.func).endswith(
                    'simulation.advance'
                ))
            }
    assert found == {'lava_ros.runs.drive'}


def test_imports_are_not_circular():
    TopologicalSorter(imports()).prepare()


def test_chains_of_imports_in_the_solver_have_at_most_8_files():
    length = dict.fromkeys(MODULES, 0)
    for module in TopologicalSorter(imports()).static_order():
        if room_of(module) == 'simulation':
            length[module] = 1 + max((length[other] for other in imports()[module]), default=0)
    assert 4 < max(length.values()) <= 8


def test_only_errors_and_validation_are_outside_of_rooms():
    loose = {path.name for path in (ROOT / 'lava_ros').glob('*.py')}
    assert loose == {'__init__.py', 'errors.py', 'validation.py'}


@pytest.mark.parametrize(('title', 'max_length'), [('A vent', 15), ('A viscosity', 10)])
def test_files_of_a_journey_import_each_other(title, max_length):
    section = PAGE.partition(f'\n## {title}, from its ')[2].partition('\n## ')[0]
    paths = re.findall(r'^\d+\. `(\S+)\.py`', section, re.MULTILINE)
    names = ['lava_ros.' + path.replace('/', '.') for path in paths]
    assert 5 < len(names) <= max_length
    for name in names:
        assert any(has_import(name, other) or has_import(other, name) for other in names), name


def has_import(module: str, other: str) -> bool:
    """Return True if a module imports another one, or the room that re-exports its names."""
    rooms = {item for item in imports()[module] if MODULES[item].name == '__init__.py'}
    return other in imports()[module] or other.rpartition('.')[0] in rooms
