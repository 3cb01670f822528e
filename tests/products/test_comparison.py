# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The table of places without and with barriers."""

import pytest

from lava_ros.products.comparison import place_texts


def row(name: str, percent: float | None, *times: float | None) -> dict[str, object]:
    """Return a place with one probability, and its arrival times without and with barriers."""
    cases = ('without', 'with')
    return {
        'name': name, **{f'probability_percent_{case}': percent for case in cases},
        **{f'arrival_p50_s_{case}': time for case, time in zip(cases, times, strict=True)},
    }


ROWS = row('hut', 100.0, 2400.0, None), row('camp', None, None, None)


@pytest.mark.parametrize(('is_ensemble', 'expected'), [
    (False, [
        ('place', 'arrival without', 'with'),
        ('hut', '40 min', 'not reached'), ('camp', 'off the map', 'off the map'),
    ]),
    (True, [
        ('place', 'probability without', 'with', 'arrival (50 %) without', 'with'),
        ('hut', '100 %', '100 %', '40 min', '-'),
        ('camp', 'off the map', 'off the map', '-', '-'),
    ]),
], ids=['run', 'ensemble'])
def test_single_runs_have_no_probability(is_ensemble, expected):
    assert place_texts(ROWS, is_ensemble=is_ensemble) == expected
