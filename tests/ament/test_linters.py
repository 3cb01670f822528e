# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS's own linters, for `colcon test` where they are installed: they are not on PyPI.

Elsewhere ruff (`make lint`) and tests/test_style.py check the same rules.
"""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CODE = [str(ROOT / name) for name in ('lava_ros', 'launch', 'examples', 'setup.py')]

#: Rules that ruff's `convention = "google"` leaves out as well.
IGNORED = ['D100', 'D104', 'D105', 'D107', 'D203', 'D204', 'D212', 'D213', 'D215']
IGNORED += ['D400', 'D401', 'D402', 'D403', 'D404', 'D406', 'D407', 'D408', 'D409', 'D413']

#: Arguments of each linter; flake8.ini leaves other rules to ruff.
ARGUMENTS = {
    'flake8': ['--config', str(Path(__file__).with_name('flake8.ini')), *CODE],
    'pep257': ['--ignore', *IGNORED, '--', *CODE],
    'xmllint': [str(ROOT / 'package.xml')],
}


@pytest.mark.linter
@pytest.mark.parametrize('name', [
    pytest.param(name, marks=getattr(pytest.mark, name))
    for name in ARGUMENTS
    if find_spec(f'ament_{name}')
])
def test_code_passes_the_linter(name: str) -> None:
    assert import_module(f'ament_{name}.main').main(argv=ARGUMENTS[name]) == 0
