# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Markdown tables."""

import pytest

from lava_ros.layers.numbers import area_words, table


def test_table_has_a_cell_for_each_title() -> None:
    assert table(('a', 'b'), [('1', '2')]) == ['| a | b |', '|---|---|', '| 1 | 2 |']


@pytest.mark.parametrize(('area', 'expected'), [
    (0.0, '0 m²'), (0.0071, '0.0071 m²'), (9.4, '9.4 m²'), (9.6, '10 m²'), (7380.0, '7380 m²'),
    (99_999.0, '99999 m²'), (100_000.0, '0.10 km²'),
])
def test_area_has_digits_at_every_size(area, expected):
    assert area_words(area) == expected
