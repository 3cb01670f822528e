# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Markdown tables."""

from lava_ros.layers.numbers import table


def test_table_has_a_cell_for_each_title() -> None:
    assert table(('a', 'b'), [('1', '2')]) == ['| a | b |', '|---|---|', '| 1 | 2 |']
