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

"""Docstrings are as ament_pep257 asks, in Google's form."""

from pathlib import Path

from ament_pep257.main import main
import pytest

ROOT = Path(__file__).parents[2]
PATHS = [str(ROOT / name) for name in ('lava_ros', 'launch', 'examples', 'setup.py')]

#: What Google's form of docstrings leaves out, as ruff's `convention = "google"` has it.
IGNORED = ['D100', 'D104', 'D105', 'D107', 'D203', 'D204', 'D212', 'D213', 'D215']
IGNORED += ['D400', 'D401', 'D402', 'D403', 'D404', 'D406', 'D407', 'D408', 'D409', 'D413']


@pytest.mark.pep257
@pytest.mark.linter
def test_pep257() -> None:
    """Docstrings are as ament_pep257 asks, in Google's form."""
    assert main(argv=['--ignore', *IGNORED, '--', *PATHS]) == 0
