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

"""The account of the volume: complete, the same to diagnostics and back, and plain to people."""

import math

import pytest

from lava_ros.simulation.budget import VolumeBudget

#: A hole that has taken most of an eruption, as it is at its end.
SWALLOWED = VolumeBudget(324_000.0, 18_398.0, 0.4, 305_602.0, in_holes=305_500.0)


def test_parts_add_up_to_what_was_emitted():
    """Each cubic metre is told in one place, late ones in two."""
    budget = VolumeBudget(100.0, 40.0, 10.0, 25.0, frozen=35.0, late=8.0, in_holes=20.0)
    told = {name: value.removesuffix(' m3') for name, value in budget.rows()}
    assert told == {
        'emitted': '100',
        'flowing': '30',
        'frozen': '35',
        'left over the border': '5',
        'left into cells without data': '20',
        'waiting in the vents': '10',
        'of that late': '8',
        'unaccounted for': 'below 1e-15',
    }
    parts = [float(told[name]) for name in list(told)[1:6]]
    assert sum(parts) == 100.0


def test_lava_that_is_gone_is_told_and_warned_of():
    """An error of 0 says that it is accounted for, not that it is on the map."""
    assert SWALLOWED.error == 0.0
    assert 'left into cells without data 305,500.0 m3' in SWALLOWED.text()
    (warning,) = SWALLOWED.warnings()
    assert warning.startswith('94.3 % of the lava has left into cells without data')
    frozen = VolumeBudget(300_000.0, 15_395.0, 1.0, 0.0, frozen=284_605.0)
    assert 'flowing 15,394.0 m3, frozen 284,605.0 m3' in frozen.text()
    assert frozen.warnings() == []


@pytest.mark.parametrize(
    ('budget', 'phrase'),
    [
        (VolumeBudget(100.0, 99.0, 2.0, 1.0), '1 % of the lava has left over the border'),
        (VolumeBudget(100.0, 100.0, 2.0, 0.0, late=1.5), 'behind: 1.5 m3 of lava wait'),
        (VolumeBudget(100.0, 99.0, 2.0, 0.0), 'volume is not conserved: 1.0e-02'),
        (VolumeBudget(100.0, math.nan, 2.0, 0.0), 'volume is not conserved: nan'),
    ],
)
def test_warnings(budget, phrase):
    """Each thing that a reader has to know is one phrase."""
    (warning,) = budget.warnings()
    assert warning.startswith(phrase)


def test_there_and_back():
    """What diagnostics say is read as it was; what an older recording lacks counts as nothing."""
    assert VolumeBudget.from_texts(SWALLOWED.texts()) == SWALLOWED
    old = {f'volume_{name}_m3': '1.0' for name in ('emitted', 'held', 'left')}
    assert VolumeBudget.from_texts(old) == VolumeBudget(1.0, 1.0, 0.0, 1.0)
    assert VolumeBudget.from_texts({**old, 'volume_held_m3': 'much'}) is None
    assert VolumeBudget.from_texts({}) is None


def test_a_flow_of_any_size_is_told():
    """On a table it is litres."""
    assert VolumeBudget(8.17e-4, 8.17e-4, 0.0, 0.0).rows()[1] == ('flowing', '0.000817 m3')
