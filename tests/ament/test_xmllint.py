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

"""package.xml is valid by its schema."""

from pathlib import Path

from ament_xmllint.main import main
import pytest

ROOT = Path(__file__).parents[2]
PATHS = [str(ROOT / name) for name in ('package.xml',)]


@pytest.mark.xmllint
@pytest.mark.linter
def test_xmllint() -> None:
    """package.xml is valid by its schema."""
    assert main(argv=PATHS) == 0
