# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Tables of effusion rates: the same eruption in every format of observatories."""

import math
from pathlib import Path
import re
from typing import Any

import numpy as np
import pytest

from geodata import write_scene
from lava_ros.errors import LavaError
from lava_ros.scene import scene_from_yaml
from lava_ros.scene.effusion_rates import (
    error_of_rates,
    Options,
    read_effusion_rates,
    series_of_rates,
)

#: Intervals of a day with 20 m3/s and a day with 10 m3/s.
DAYS = ((0.0, 86400.0, 20.0), (86400.0, 172800.0, 10.0))

WHOLE = {
    'seconds': 'start_s,end_s,discharge_m3_per_s\n0,86400,20\n86400,172800,10\n',
    'hours, tabs and a mark': '\ufeffstart_h\tend_h\tTADR\r\n0\t24\t20\r\n24\t48\t10\r\n',
    'days and comments': (
        '# of the observatory\nStart (days);End (days);Effusion rate (m3/s)\n'
        '# the first day\n0;1;20,0 # by satellite\n1;2;10,0\n'
    ),
    'dates': (
        'start,end,rate\n2021-09-19,2021-09-20,20\n2021-09-20T00:00:00Z,2021-09-21 00:00,10\n'
    ),
    'dates of a time zone': (
        'start,end,rate\n2021-09-19T01:00:00+01:00,2021-09-20,20\n2021-09-20,2021-09-21,10\n'
    ),
    'volumes': 'from_d,to_d,volume (10^6 m3)\n0,1,1.728\n1,2,0.864\n',
    'cumulative volume': 'time_h,cumulative volume [m3]\n0,0\n24,1728000\n48,2592000\n',
    'cumulative volume and dates': (
        'date,volume (km3)\n2021-09-19,0\n2021-09-20,0.001728\n2021-09-21,0.002592\n'
    ),
    'rates of a day': 'start_d end_d rate_m3_per_d\n0 1 1728000\n1 2 864000\n',
    'instants': 'days,q\n0,25\n1,15\n2,5\n',
}


def read(folder: Path, text: str, **options: Any) -> Any:
    (folder / 'rates.csv').write_text(text, encoding='utf-8')
    return read_effusion_rates(
        '--effusion-rate', folder / 'rates.csv', Options(**options)
    ).intervals


@pytest.mark.parametrize('name', WHOLE)
def test_formats_of_one_eruption_give_the_same_intervals(name, tmp_path):
    found = read(tmp_path, WHOLE[name])
    intervals = [(item.start, item.end, item.discharge) for item in found]
    np.testing.assert_allclose(intervals, DAYS, rtol=1e-12)
    series = [(0.0, 20.0), (86400.0, 10.0), (172800.0, 0.0)]
    np.testing.assert_allclose(series_of_rates(found), series, rtol=1e-12)


def test_time_0_is_the_given_start_or_the_first_date(tmp_path, caplog):
    found = read(tmp_path, WHOLE['dates'], start='2021-09-18T12:00:00Z')
    assert (found[0].start, found[-1].end) == (43200.0, 216000.0)
    assert not caplog.messages
    read(tmp_path, WHOLE['dates'])
    assert 'the eruption is taken to start with the first date, 2021-09-19' in caplog.text


@pytest.mark.parametrize(('start', 'lost'), [
    ('2021-09-19', ''), ('2021-09-19T12:00:00', '8.64e+05 of 2.59e+06 m3 before'),
    ('2021-09-19T12:00:00-12:00', '1.73e+06 of 2.59e+06 m3 before'),
    ('2021-09-22', 'All lava of vents[0].effusion_rate comes out before the start'),
])
def test_lava_before_the_start_is_left_out_with_a_warning(start, lost, tmp_path, caplog):
    (tmp_path / 'days.csv').write_text(WHOLE['dates'])
    rate = f'{{file: days.csv, start: {start}}}'
    text = f'vents: [{{position: [300.0, 300.0], effusion_rate: {rate}}}]'
    path = write_scene(tmp_path, np.zeros((60, 60)), 10.0, text)
    if start == '2021-09-22':
        with pytest.raises(LavaError, match=re.escape(lost)):
            scene_from_yaml(path)
        return
    scene_from_yaml(path)
    warned = [record.getMessage() for record in caplog.records if 'left out' in record.message]
    assert len(warned) == bool(lost) and all(lost in text for text in warned)


def test_rates_at_instants_have_the_volume_of_a_linear_change(tmp_path):
    found = read(tmp_path, 'time_s,rate\n0,0\n10,4\n40,1\n')
    assert sum(item.discharge * (item.end - item.start) for item in found) == 20.0 + 75.0


@pytest.mark.parametrize('amount', ['rate', 'cumulative_volume'])
def test_lava_before_the_start_is_that_of_the_change_up_to_it(amount, tmp_path):
    found = read(tmp_path, f'time_s,{amount}\n-1000,0\n1000,40\n2000,40\n')
    later = sum(item.discharge * (item.end - max(item.start, 0.0)) for item in found
                if item.end > 0.0)
    # a cumulative volume has one rate between two instants
    assert later == pytest.approx(70_000.0 if amount == 'rate' else 20.0)


def test_converts_dense_rock_to_bulk_rates_with_a_porosity(tmp_path):
    text = 'start_d,end_d,rate_dre\n0,1,15\n'
    (found,) = read(tmp_path, text, porosity=0.25)
    assert found.discharge == pytest.approx(20.0)
    with pytest.raises(LavaError, match='rate_dre is .dense-rock., expected a porosity'):
        read(tmp_path, text)
    with pytest.raises(LavaError, match='porosity does not apply because .* has bulk rates'):
        read(tmp_path, text.replace('dre', 'bulk'), porosity=0.25)


@pytest.mark.parametrize(('gaps', 'rate', 'words'), [
    (None, 0.0, 'from 100 to 200 s, taken to be 0 m3/s .gaps: zero or interpolate chooses'),
    ('zero', 0.0, 'from 100 to 200 s, taken to be 0 m3/s'),
    ('interpolate', 3.0, 'from 100 to 200 s, taken to be 3 m3/s'),
])
def test_fills_gaps_between_intervals_with_a_warning(gaps, rate, words, tmp_path, caplog):
    found = read(tmp_path, 'start,end,q\n0,100,2\n200,300,4\n', gaps=gaps)
    assert [(item.start, item.end, item.discharge) for item in found] == [
        (0.0, 100.0, 2.0), (100.0, 200.0, rate), (200.0, 300.0, 4.0),
    ]
    (message,) = caplog.messages
    assert all(word in message for word in words.split('.'))


@pytest.mark.parametrize('cell', ['', 'nan', '-', 'N/A'])
def test_rejects_cells_without_a_rate_unless_gaps_is_set(cell, tmp_path):
    text = f'start,end,q\n0,100,2\n100,200,{cell}\n200,300,4\n'
    with pytest.raises(LavaError, match=r'line 3, q is .*a finite number, or gaps: zero or'):
        read(tmp_path, text)
    for gaps, rate in (('zero', 0.0), ('interpolate', 3.0)):
        assert read(tmp_path, text, gaps=gaps)[1].discharge == rate
    with pytest.raises(LavaError, match='has no value. Give the rates at two or more times'):
        read(tmp_path, f'time,q\n0,{cell}\n100,{cell}\n', gaps='interpolate')
    text = f'time,q\n0,2\n100,{cell}\n300,4\n400,4\n'
    assert [item.discharge for item in read(tmp_path, text, gaps='zero')] == [0.0, 0.0, 4.0]
    assert [item.discharge for item in read(tmp_path, text, gaps='interpolate')] == [3.0, 4.0]


@pytest.mark.parametrize(
    ('header', 'cells'),
    [('error', ('5', '5')), ('Error (%)', ('25', '50')), ('sigma', ('10', ''))],
)
def test_uncertainty_is_the_relative_error_of_volume(header, cells, tmp_path):
    first, second = cells
    text = f'start_d,end_d,q,{header},remark\n0,1,20,{first},x\n1,2,10,{second},y\n'
    found = error_of_rates(read(tmp_path, text))
    assert found is not None and found.kind == 'lognormal'
    error = {'error': 1 / 3, 'Error (%)': 1 / 3, 'sigma': 1 / 2}[header]
    assert math.exp(math.log(found.numbers[1]) ** 2) == pytest.approx(1.0 + error**2)
    assert error_of_rates(read(tmp_path, WHOLE['seconds'])) is None
    # errors of dense-rock equivalents are those of bulk rates, as a fraction
    bulk = error_of_rates(read(tmp_path, text, porosity=0.5))
    assert bulk is not None and bulk.numbers == pytest.approx(found.numbers)


def test_warns_of_unknown_columns(tmp_path, caplog):
    read(tmp_path, 'start,end,q,satellite,remark\n0,1,2,MODIS,x\n')
    assert 'unknown columns are ignored: satellite, remark' in caplog.text


@pytest.mark.parametrize(('text', 'words'), [
    ('start,end,q\n0,100,-3\n', "line 2, q is -3, expected a finite number at least 0"),
    ('start,end,q\n100,0,3\n', 'line 2, end is 0, expected a time after its start, 100 s'),
    ('start,end,q\n0,100,3\n50,200,3\n', 'line 3, start is 50, expected at least 100 s'),
    ('start,end,q\n0,2021-09-19,3\n', "line 2, end is '2021-09-19', expected dates in all"),
    ('start,end,q\n2021-13-01,1,3\n', "start is '2021-13-01', expected a finite number, or"),
    ('time,q\n0,1\n', 'line 2 is the only row. Give the rates at two or more times'),
    ('time,q\n5,1\n5,2\n', 'line 3, time is 5, expected a time after the row before, 5 s'),
    ('date,q\n2021-09-19,1\n2021-09-18,2\n',
     "line 3, date is '2021-09-18', expected a time after the row before, 2021-09-19"),
    ('start,end,q\n2021-09-19,2021-09-18,2\n',
     "line 2, end is '2021-09-18', expected a time after its start, 2021-09-19"),
    ('start_h,end_h,q\n2,1,3\n', "line 2, end_h is 1, expected a time after its start, 2"),
    ('start_h,end_h,q\n0,2,3\n1,4,3\n', "line 3, start_h is 1, expected at least 2, where"),
    ('time,volume\n0,5\n5,2\n', 'line 3, volume is 2, expected at least that of the row'),
    ('time_fortnights,q\n0,1\n', 'first line is .time_fortnights,q., expected the columns'),
    ('time (fortnights),q\n0,1\n', "rates.csv is 'fortnights', expected a unit such as s"),
    ('start,end,q,volume\n0,1,2,3\n', 'expected the columns start, end and effusion_rate or'),
    ('start,end,q\n0,1,0\n', 'contains no effusion rate above 0'),
    ('time_s;q\n0;1.250\n60;12,5\n', 'line 3 is .12,5., expected the decimal mark of 1.250'),
    ('time_s;q\n0;1,250\n60;12.5\n', 'line 3 is .12.5., expected the decimal mark of 1,250'),
    *(
        (f'{header},q\n{cells},2\n', 'is .44458.59., expected a date such as 2021-09-19')
        for header, cells in (
            ('date', '44458.59'), ('timestamp', '44458.59'), ('Start date,end', '44458.59,44459'),
            ('time (UTC)', '44458.59'), ('dateTime', '44458.59'),
        )
    ),
    ('start,end,q\n0,1,1e9\n', r'line 2, q is 1e9, expected a rate of 0 to 1e\+08 m3/s'),
])
def test_rejects_invalid_tables(text, words, tmp_path):
    with pytest.raises(LavaError, match=words):
        read(tmp_path, text)


def scene(folder: Path, vent: str, rest: str = '') -> Any:
    """Read a scene file with a vent and a table."""
    (folder / 'rates.csv').write_text('date,q,error\n2021-09-19,4,1\n2021-09-20,8,2\n')
    text = f'vents: [{{position: [300.0, 300.0], {vent}}}]\n{rest}'
    return scene_from_yaml(write_scene(folder, np.zeros((60, 60)), 10.0, text))


def test_vent_in_a_scene_file_has_a_number_a_series_or_a_table(tmp_path):
    for word in ('discharge', 'effusion_rate'):
        (vent,) = scene(tmp_path, f'{word}: 5').vents
        assert vent.discharge == 5.0
        (vent,) = scene(tmp_path, f'{word}: [[0, 5], [60, 0]]').vents
        assert vent.discharge == ((0.0, 5.0), (60.0, 0.0))
    table = 'effusion_rate: {file: rates.csv, start: 2021-09-19, porosity: 0.5}'
    found = scene(tmp_path, table)
    assert found.vents[0].discharge == ((0.0, 12.0), (86400.0, 0.0))
    assert found.uncertainty.discharge is not None
    known = 'uncertainty: {effusion_rate: {distribution: uniform, low: 0.5, high: 2}}'
    assert scene(tmp_path, table, known).uncertainty.discharge.kind == 'uniform'
