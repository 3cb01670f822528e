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

"""The report as Markdown."""

import math

from lava_ros.accuracy import Accuracy
from lava_ros.verification.report import markdown
from lava_ros.verification.settings import Setting


def test_presets_and_front_are_named(fake_case, measured):
    """The table of presets has their error and cost; settings on the front are bold."""
    settings = [
        Setting('coarse', Accuracy(refinement=0.5)),
        Setting('chosen', Accuracy(refinement=1.0), preset='standard'),
    ]
    text = markdown(measured([fake_case()], settings), {'fake': 'A title'}, stem='cpu')
    assert '| case | standard |' in text
    assert '| A title | 0.33 % in 61 ms |' in text
    assert '**standard: chosen**' in text
    assert '![' in text
    assert 'cpu.csv' in text
    assert text.endswith('|\n')


def test_no_result_is_said(row):
    """NaN is named, and never bold."""
    text = markdown([row(setting='broken', error=math.nan), row()], {}, stem='cpu')
    assert '| broken | none |' in text
    assert '| **a** | 1 % |' in text


def test_cases_without_presets_are_not_among_them(row):
    """The table of presets has no empty lines, and is left out when it would be empty."""
    text = markdown([row(preset='draft'), row(case='other')], {}, stem='cpu')
    assert text.split('## fixed_volume')[0].count('other') == 0
    assert '## Presets' not in markdown([row(case='other')], {}, stem='cpu')
