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

"""ROS's own linters, for `colcon test` in an installation that has them.

They are not on PyPI: where one is missing its test is not collected. The same rules hold
everywhere through ruff (`make lint`) and tests/test_style.py.
"""

from importlib.util import find_spec

LINTERS = ('copyright', 'flake8', 'pep257', 'xmllint')

collect_ignore = [f'test_{name}.py' for name in LINTERS if find_spec(f'ament_{name}') is None]
