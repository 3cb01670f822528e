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

"""The page of file formats."""

from pathlib import Path

from lava_ros.files.columns import COLUMNS
from lava_ros.files.rasters import FORMATS
from scripts import load_script

PAGE = Path(__file__).parents[2] / 'docs/FORMATS.md'


def test_page_of_formats_is_up_to_date() -> None:
    """docs/formats.py would write the page as it is, and has every format and column."""
    script, text = load_script(PAGE.with_name('formats.py')), PAGE.read_text(encoding='utf-8')
    assert script.page(text) == text, 'run python docs/formats.py'
    assert all(item.name in text for item in FORMATS)
    assert set(script.MEANINGS) == set(COLUMNS)
