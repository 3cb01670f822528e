# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The date of simulated time 0 in scenes, from files and options to checkpoints."""

from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from command_line import refused
from geodata import write_scene
from lava_ros.cli.pages import dates_of
from lava_ros.cli.parser import parse_command_line
from lava_ros.cli.scenes import scene_from_arguments
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, scene_from_dict, scene_from_yaml, scene_to_dict, Terrain
from lava_ros.scene.from_outline import time_of_outline
from lava_ros.scene.onset import Onset
from lava_ros.simulation import Simulation
from lava_ros.simulation.output.checkpoint import from_bytes

DATED = 'start,end,effusion_rate\n2026-11-27T05:30Z,2026-11-27T06:30Z,5\n'
PLAIN = 'start,end,effusion_rate\n0,3600,5\n'
ONSET = datetime(2026, 11, 27, 5, 30, tzinfo=timezone.utc)
START = '2026-11-27T05:30:00Z'


def write(folder, rates, table=DATED, **more):
    (folder / 'rates.csv').write_text(table)
    vents = [
        {'position': [200.0 + 50.0 * index, 200.0], 'effusion_rate': rate}
        for index, rate in enumerate(rates)
    ]
    return write_scene(folder, np.zeros((40, 40)), 10.0, {'vents': vents, **more})


@pytest.mark.parametrize(('rates', 'table', 'more'), [
    ([{'file': 'rates.csv', 'start': START}], DATED, {}),
    ([{'file': 'rates.csv'}], DATED, {}),
    ([{'file': 'rates.csv'}], DATED, {'onset': '2026-11-27T06:30:00+01:00'}),
    ([{'file': 'rates.csv', 'start': START}], PLAIN, {}),
    ([5.0], PLAIN, {'onset': START}),
    ([5.0, {'file': 'rates.csv', 'start': START}, {'file': 'rates.csv'}], DATED, {}),
])
def test_scene_keeps_the_date_of_its_start(rates, table, more, tmp_path):
    scene = scene_from_yaml(write(tmp_path, rates, table, **more))
    assert scene.onset == ONSET
    again = scene_from_dict(scene_to_dict(scene), scene.terrain)
    assert again.onset == ONSET


def test_scene_without_a_date_has_no_onset(tmp_path):
    scene = scene_from_yaml(write(tmp_path, [{'file': 'rates.csv'}], PLAIN))
    assert scene.onset is None and 'onset' not in scene_to_dict(scene)


def test_tables_with_different_starts_are_refused(tmp_path):
    other = {'file': 'rates.csv', 'start': '2026-11-27T05:00:00Z'}
    path = write(tmp_path, [{'file': 'rates.csv', 'start': START}, other])
    with pytest.raises(LavaError) as caught:
        scene_from_yaml(path)
    assert str(caught.value) == (
        "vents[1].effusion_rate.start is '2026-11-27T05:00:00Z', expected 2026-11-27T05:30:00Z, "
        'the time 0 of vents[0].effusion_rate'
    )


@pytest.mark.parametrize('onset', ['2026-11-27', datetime(2026, 11, 27), 5])
def test_onset_without_a_time_zone_is_refused(onset):
    with pytest.raises(LavaError, match=r'scene\.onset is .*with a time zone'):
        Scene(Terrain(np.zeros((4, 4)), 10.0), onset=onset)


@pytest.mark.parametrize(('words', 'rates'), [
    (['--start', START, '--effusion-rate', '5'], [3.0]),
    (['--start', START], [3.0]),
    (['--effusion-rate', 'rates.csv'], [3.0]),
    (['--effusion-rate', 'rates.csv', '--start', START], [3.0]),
    ([], [{'file': 'rates.csv'}]),
    (['--start', START], [{'file': 'rates.csv'}]),
    (['--vent', '200,200', '--start', START], [{'file': 'rates.csv', 'start': '2026-11-27'}]),
])
def test_options_of_a_scene_give_its_onset(words, rates, tmp_path):
    path = write(tmp_path, rates)
    words = [str(tmp_path / word) if word == 'rates.csv' else word for word in words]
    args = parse_command_line(['effects', str(path), *words])
    assert scene_from_arguments(args).onset == ONSET


@pytest.mark.parametrize(('rates', 'more', 'words', 'opening'), [
    # an hour before the first date of the table
    ([3.0], {'onset': '2026-11-27T04:30:00Z'}, [], 3600.0),
    ([{'file': 'own.csv'}], {}, [], 3600.0),
    ([3.0], {'onset': '2026-11-27T04:30:00Z'}, ['--start', START], 0.0),
    ([3.0], {}, [], 0.0),
])
def test_table_of_the_command_has_the_time_0_of_the_scene(tmp_path, rates, more, words, opening):
    path = write(tmp_path, rates, **more)
    (tmp_path / 'own.csv').write_text(DATED.replace('T05:30Z,', 'T04:30Z,'))
    table = ['--effusion-rate', str(tmp_path / 'rates.csv'), *words]
    scene = scene_from_arguments(parse_command_line(['effects', str(path), *table]))
    (vent,) = scene.vents
    assert vent.next_opening(0.0) == opening
    assert scene.onset + timedelta(seconds=opening) == ONSET


def test_start_that_contradicts_the_rates_of_the_file_is_refused(tmp_path):
    path = write(tmp_path, [{'file': 'rates.csv'}])
    error = refused('effects', path, '--start', '2026-11-27T00:00Z')
    assert '--start is ' in error
    assert 'expected 2026-11-27T05:30:00Z, the time 0 of the effusion rates of' in error


@pytest.mark.parametrize('text', ['2026-11-27T05:30', '2026-11-27 05:30:00', '27 November'])
@pytest.mark.parametrize('where', [
    'scene file', 'table', 'start of a table', '--start of a run', '--start of a page', 'outline',
])
def test_every_date_without_a_time_zone_is_in_utc(where, text, tmp_path):
    def read() -> datetime:
        if where == '--start of a page':
            args = parse_command_line(['map', 'run', '-o', 'map.png', '--start', text])
            return dates_of(args)['onset'].start
        if where == 'outline':
            seconds = time_of_outline('time', text, 0.0, Onset(ONSET - timedelta(hours=1)))
            return ONSET + timedelta(seconds=seconds - 3600.0)
        if where == '--start of a run':
            path = write(tmp_path, [5.0])
            args = parse_command_line(['effects', str(path), '--start', text])
            return scene_from_arguments(args).onset
        rates, table, more = [5.0], PLAIN, {'onset': text}
        if where == 'table':
            rates, table, more = [{'file': 'rates.csv'}], DATED.replace(START[:-4] + 'Z', text), {}
        elif where == 'start of a table':
            rates, more = [{'file': 'rates.csv', 'start': text}], {}
        return scene_from_yaml(write(tmp_path, rates, table, **more)).onset

    if text == '27 November':
        with pytest.raises(LavaError) as caught:
            read()
        assert (caught.value.value, caught.value.expected.rpartition('or ')[2]) == (
            text, 'a date such as 2021-09-19T14:10:00Z, in UTC unless it has a time zone'
        )
    else:
        assert read() == ONSET


@pytest.mark.parametrize('text', ['0001-01-01T00:00Z', '9999-12-31T23:59Z'])
def test_dates_at_the_limits_of_the_calendar_are_refused(text):
    with pytest.raises(LavaError, match='expected a date such as'):
        Onset.from_text(text)


def test_checkpoint_keeps_the_onset():
    scene = Scene(Terrain(np.zeros((20, 20)), 10.0), onset=ONSET)
    stored = Simulation(scene, device='cpu').checkpoint().to_bytes()
    assert from_bytes(stored).scene.onset == ONSET
