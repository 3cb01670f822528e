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

"""Curves as SVG."""

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from lava_ros.pages.report.charts import (
    Chart,
    Curve,
    HEIGHT,
    LEFT,
    MOST_POINTS,
    svg,
    thinned,
    ticks,
    time_unit,
    TOP,
    WIDTH,
)


def drawn(chart: Chart, start: float, end: float) -> ElementTree.Element:
    """The chart as a tree, which needs well-formed text."""
    return ElementTree.fromstring(svg(chart, start, end))


def test_a_curve_is_where_its_values_are():
    """The first point is at the lower left, the last at the upper right, a gap lifts the pen."""
    curve = Curve('a', [0.0, 3600.0, 7200.0, 10800.0], [0.0, 1.0, math.nan, 4.0])
    tree = drawn(Chart('area', 'Area', 'm²', 1.0, [curve]), 0.0, 10800.0)
    (path,) = [item.get('d') for item in tree.iter('path')]
    assert path is not None
    pens = re.findall('[ML]', path)
    points = [tuple(map(float, item.split())) for item in re.split('[ML]', path)[1:]]
    assert pens == ['M', 'L', 'M']
    assert points[0] == (LEFT, HEIGHT - 34.0)
    assert points[-1] == (WIDTH - 12.0, TOP)
    texts = [item.text for item in tree.iter('text')]
    assert 'simulated time [h]' in texts
    assert {'0', '1', '2', '3', '4'} <= set(texts)


def test_hostile_words_are_escaped():
    """Labels are text."""
    name = '"><script>'
    tree = drawn(Chart(name, name, name, 1.0, [Curve(name, [0.0, 1.0], [1.0, 2.0])]), 0.0, 1.0)
    assert [item.tag for item in tree.iter() if 'script' in item.tag] == []
    assert name in (tree.get('aria-label') or '')


@pytest.mark.parametrize('values', [[0.0, 0.0], [math.nan, math.nan], [5.0, 5.0]])
def test_curves_without_height(values):
    """What does not change, or is not there, is drawn without dividing by zero."""
    assert len(drawn(Chart('a', 'A', 'm', 1.0, [Curve('a', [0.0, 1.0], values)]), 0.0, 1.0)) > 3
    assert len(drawn(Chart('a', 'A', 'm', 1.0, [Curve('a', [0.0], [1.0])]), 0.0, 0.0)) > 3


@pytest.mark.parametrize(
    ('low', 'high', 'expected'),
    [
        (0.0, 2.8, [0.0, 1.0, 2.0]),
        (0.0, 100.0, [0.0, 25.0, 50.0, 75.0, 100.0]),
        (1100.0, 1200.0, [1100.0, 1125.0, 1150.0, 1175.0, 1200.0]),
        (3.0, 3.0, [3.0]),
    ],
)
def test_ticks(low, high, expected):
    """Round numbers between the ends."""
    assert ticks(low, high, 4) == expected


def test_long_curves_are_thinned():
    """Their ends stay."""
    times = np.arange(5000.0).tolist()
    few = thinned(Curve('a', times, times))
    assert len(few.times) <= MOST_POINTS
    assert (few.times[0], few.times[-1]) == (0.0, 4999.0)


@pytest.mark.parametrize(
    ('span', 'name'), [(60.0, 's'), (600.0, 'min'), (7200.0, 'h'), (300_000.0, 'd')]
)
def test_time_units(span, name):
    """Spans are said in the unit people would use."""
    assert time_unit(span)[1] == name
