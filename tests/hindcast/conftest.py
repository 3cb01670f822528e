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

"""A case that several files run."""

import pytest

from eruption import LAVA, write_case
from lava_ros.hindcast.case import Case, load_case


@pytest.fixture(scope='module')
def valley(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A valley down which lava flows for an hour."""
    return load_case(write_case(tmp_path_factory.mktemp('run') / 'valley', hours=1, yaml=LAVA))
