# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The metadata of the package, as pyproject.toml has it, and its imports."""

import ast
from functools import cache
from pathlib import Path

from packaging.requirements import Requirement

try:
    import tomllib
except ImportError:  # Python 3.10, where pytest brings it
    import tomli as tomllib

ROOT = Path(__file__).parents[1]

_CONTENT = tomllib.loads((ROOT / 'pyproject.toml').read_text(encoding='utf-8'))

PROJECT = _CONTENT['project']
TOOLS = _CONTENT['tool']
GROUPS: dict[str, list[str]] = _CONTENT['dependency-groups']

#: Requirements of each extra; ``all`` has those of the extras that it names.
EXTRAS: dict[str, list[str]] = dict(PROJECT['optional-dependencies'])
(_everything,) = EXTRAS['all']
EXTRAS['all'] = [
    item for extra in sorted(Requirement(_everything).extras) for item in EXTRAS[extra]
]

#: Files of the package by module.
MODULES = {
    '.'.join(path.relative_to(ROOT).with_suffix('').parts).removesuffix('.__init__'): path
    for path in (ROOT / 'lava_ros').rglob('*.py')
}


@cache
def imported_names() -> dict[str, set[str]]:
    """Return the names that each module imports, at once, later or for types."""
    found: dict[str, set[str]] = {}
    for module, path in MODULES.items():
        names = found[module] = set()
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names.update(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.update(f'{node.module}.{alias.name}' for alias in node.names)
    return found
