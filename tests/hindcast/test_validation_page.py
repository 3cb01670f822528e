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

"""The tables of docs/VALIDATION.md are those of the measurements beside it."""

import importlib.util
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / 'docs/benchmarks/validation.py'


def test_tables_are_those_of_the_measurements() -> None:
    """The page says what its CSV files say: python docs/benchmarks/validation.py writes it."""
    spec = importlib.util.spec_from_file_location('validation_page', SCRIPT)
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    page = script.PAGE.read_text(encoding='utf-8')
    assert script.written(page) == page
    assert '| etna_basalt | 2001 |' in page
