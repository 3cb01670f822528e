# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The metadata of the package, as pyproject.toml has it."""

from pathlib import Path

from packaging.requirements import Requirement

try:
    import tomllib
except ImportError:  # Python 3.10, where pytest brings it
    import tomli as tomllib

_CONTENT = tomllib.loads(
    (Path(__file__).parents[1] / 'pyproject.toml').read_text(encoding='utf-8')
)

PROJECT = _CONTENT['project']
TOOLS = _CONTENT['tool']

#: Requirements of each extra; ``all`` has those of the extras that it names.
EXTRAS: dict[str, list[str]] = dict(PROJECT['optional-dependencies'])
(_everything,) = EXTRAS['all']
EXTRAS['all'] = [
    item for extra in sorted(Requirement(_everything).extras) for item in EXTRAS[extra]
]
