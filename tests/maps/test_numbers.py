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

"""Tables of Markdown, and numbers as people read them."""

import pytest

from lava_ros.maps.numbers import percent, seconds, table


def test_table():
    """A line for the titles, one of dashes, and one for each entry."""
    assert table(['a', 'b'], [['1', '2']]) == ['| a | b |', '|---|---|', '| 1 | 2 |']


@pytest.mark.parametrize(
    ('value', 'text'),
    [(0.0123, '12 ms'), (3.21, '3.2 s'), (59.6, '60 s'), (1800.0, '30 min'), (9000.0, '2.5 h')],
)
def test_seconds(value, text):
    """Times have two digits and the unit that suits them."""
    assert seconds(value) == text


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (0.0345, '3.5 %'),
        (0.25, '25 %'),
        (1.0, '100 %'),
        (2e-7, '2e-07'),
        (0.0, '0 %'),
        (float('nan'), 'none'),
    ],
)
def test_percent(value, text):
    """Shares have two digits; rounding errors are powers of ten."""
    assert percent(value) == text
