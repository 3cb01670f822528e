# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS's own linters, for `colcon test` in an installation that has them.

They are not on PyPI: those that are missing are left out. The same rules hold everywhere through
ruff (`make lint`) and tests/test_style.py.
"""

from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CODE = [str(ROOT / name) for name in ('lava_ros', 'launch', 'examples', 'setup.py')]

#: What Google's form of docstrings leaves out, as ruff's `convention = "google"` has it.
IGNORED = ['D100', 'D104', 'D105', 'D107', 'D203', 'D204', 'D212', 'D213', 'D215']
IGNORED += ['D400', 'D401', 'D402', 'D403', 'D404', 'D406', 'D407', 'D408', 'D409', 'D413']

#: What each linter is told; flake8.ini leaves the rest to ruff.
ARGUMENTS = {
    'flake8': ['--config', str(Path(__file__).with_name('flake8.ini')), *CODE],
    'pep257': ['--ignore', *IGNORED, '--', *CODE],
    'xmllint': [str(ROOT / 'package.xml')],
}


@pytest.mark.linter
@pytest.mark.parametrize(
    'name',
    [
        pytest.param(name, marks=getattr(pytest.mark, name))
        for name in ARGUMENTS
        if find_spec(f'ament_{name}')
    ],
)
def test_code_is_as_the_linter_asks(name: str) -> None:
    """Style, docstrings and package.xml: the linter says what is wrong."""
    assert import_module(f'ament_{name}.main').main(argv=ARGUMENTS[name]) == 0
