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

"""The chart: a panel for each case with a cost."""

import math

from matplotlib.image import imread
import pytest

from lava_ros.errors import LavaError
from lava_ros.verification.chart import draw
from lava_ros.verification.settings import all_settings


@pytest.mark.parametrize('count', [1, 4])
def test_chart_is_drawn(tmp_path, count, fake_case, measured):
    """A picture with as many panels as cases, which is not blank."""
    cases = [fake_case(f'case{index}') for index in range(count)]
    rows = measured(cases, all_settings(quick=True))
    draw(rows, {case.name: case.title for case in cases}, tmp_path / 'a.png')
    picture = imread(tmp_path / 'a.png')
    assert picture.shape[0] > 400
    assert (picture[..., :3].min(axis=2) < 0.5).mean() > 0.005


@pytest.fixture
def panels(monkeypatch):
    """Catch the panels as they are drawn."""
    from matplotlib.figure import Figure

    drawn = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_: drawn.append(figure))

    def axes(rows, path):
        draw(rows, {}, path)
        return drawn[-1].axes

    return axes


def test_only_what_takes_time_is_charted(tmp_path, row, panels):
    """A case that looks at the velocity alone has no panel, nor has a report of it alone."""
    still = row(case='lateral', wall_s_per_simulated_hour=math.nan)
    assert len(panels([row(), still], tmp_path / 'a.png')) == 1
    assert len(panels([still], tmp_path / 'a.png')) == 0


def test_a_preset_without_a_result_is_shown_where_it_is_at_least(tmp_path, row, panels):
    """A NaN in one quantity does not hide the preset; other settings are left out."""
    rows = [
        row(setting='p', preset='as-published', error=2.5),
        row(setting='p', preset='as-published', quantity='edge', error=math.nan),
        row(setting='good'),
        row(setting='euler', error=math.nan),
    ]
    (axes,) = panels(rows, tmp_path / 'a.png')
    others, preset = (item.get_offsets() for item in axes.collections)
    assert [place[1] for place in others] == [0.01]
    assert [place[1] for place in preset] == [2.5]


def test_a_picture_that_cannot_be_written(tmp_path, row):
    """A folder that is not there is an error that names the file."""
    with pytest.raises(LavaError, match=r'none/a\.png'):
        draw([row()], {}, tmp_path / 'none/a.png')
