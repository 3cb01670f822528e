# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava run CASE`, `lava calibrate`, `lava barrier` and `lava materials`."""

import json
from pkgutil import resolve_name
import re

import numpy as np
import pytest
import rasterio

from command_line import done, lava, refused
from eruption import CELL, CORNER, footprint, SHAPE, VENT, write_case, write_case_in_degrees
from lava_ros.bag import BagReader
from lava_ros.bag.recorded_node import described_node, RecordedNode
from lava_ros.errors import LavaError
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.page import _constants, FALSE_ALARM, HIT, MISS
from lava_ros.hindcast.run import INTEGRATOR
from lava_ros.layers.recording import Recording
from lava_ros.scene.materials import material_named

LAVA = 'title: A valley <b>\nepsg: 32633\nlava: {viscosity: 2.0e+4, yield_strength: 200}\n'


@pytest.fixture
def valley(tmp_path):
    """Write a case; return the first words of a short hindcast of it."""
    case = write_case(tmp_path / 'valley', hours=0.5, yaml=LAVA)
    words = ['run', case, '-o', tmp_path / 'out', '--preset', 'draft', '--spacing', '20']
    return [*words, '--device', 'cpu', '--maps', '1']


def test_hindcast_writes_numbers_maps_page_and_bag(tmp_path):
    case, out = write_case(tmp_path / 'valley', hours=1, yaml=LAVA), tmp_path / 'out'
    words = ['run', case, '--preset', 'draft', '--spacing', '16', '--device', 'cpu']
    done(*words, '--maps', '3', '-o', out, '--json', tmp_path / 'out.json')
    data = json.loads((tmp_path / 'out.json').read_text())
    record = json.loads((out / 'run.json').read_text())
    assert {name: data[name] for name in record} == record
    assert data.keys() - record.keys() == {'folder'}
    names = ('case', 'material', 'preset')
    assert [data[name] for name in names] == ['valley', 'etna_basalt', 'draft']
    score = data['score']
    assert score['precision'] > 0.9 and score['recall'] > 0.2
    assert data['volume_error'] < 1e-5
    assert data['simulated_time_s'] == pytest.approx(3600.0)
    assert data['scene']['lava']['viscosity'] == 2e4
    assert data['particles_emitted'] > 20
    assert not (out / 'checkpoint').exists()

    # GeoTIFFs lie on the elevation, and the comparison has the counts of the score
    grids = {}
    for name in (
        'thickness', 'peak_thickness', 'arrival', 'inundated', 'temperature', 'comparison',
    ):
        with rasterio.open(out / f'{name}.tif') as file:
            assert file.crs.to_epsg() == 32633
            assert file.shape == SHAPE
            assert (file.transform.c, file.transform.a) == (CORNER[0], CELL)
            assert file.transform.f == CORNER[1] + SHAPE[0] * CELL
            grids[name] = file.read(1, masked=True)[::-1]
            # exports use the same no-data value
            assert file.nodata == -9999 and (out / f'{name}.qml').exists()
            tags = file.tags()
            assert (tags['scene'], tags['preset']) == ('valley', 'draft') and tags['effects']
    codes = grids['comparison']
    for code, name in ((HIT, 'hits'), (MISS, 'misses'), (FALSE_ALARM, 'false_alarms')):
        assert (codes == code).sum() == score[name]
    np.testing.assert_array_equal((codes == HIT) | (codes == MISS), footprint() > 0.0)
    assert grids['thickness'].sum() * CELL**2 == pytest.approx(score['volume_on_map_m3'], rel=1e-5)
    assert grids['temperature'].max() < 1100.0

    # the page has the score and the sources of constants, and escapes markup
    text = (out / 'hindcast.html').read_text()
    usual = material_named('etna_basalt').constants['viscosity']
    for part in ('A valley &lt;b&gt;', f'case.yaml, in place of {usual.value:g}', 'SCIARA-fv2',
                 f'{score["jaccard"]:.3f}', 'data:image/png;base64,'):
        # a comparison of the texts would take minutes
        assert text.count(part), part
    assert not text.count('<b>')
    # no number is broken over lines, and each has its unit
    row = re.search('<th scope="row">viscosity</th>(.*?)</tr>', text)
    assert row is not None
    cells = re.findall('<td class="(.*?)">(.*?)</td>', row[1])
    assert cells[:2] == [('number', '20000'), ('number', 'Pa s')]
    assert re.fullmatch(r'35000 to 560000 \[\d\]', cells[2][1])
    assert '.number { white-space: nowrap;' in text
    assert (out / 'comparison.png').stat().st_size > 10_000

    # the bag has a frame for each map, at the end of the step in which it was due
    bag = BagReader(out)
    assert len(list(bag.messages(['/height']))) == 3
    assert described_node(bag.custom_data) == RecordedNode(
        '/lava', '/', {topic.removeprefix('/'): topic for topic in bag.topics}
    )
    assert done('bag', 'info', out).count('nodes      /lava\n') == 1
    times = [frame.time for frame in Recording(out).frames()]
    dues = (1200, 2400, 3600)
    late = np.subtract(times, dues)
    assert late.min() >= 0.0 and late.max() <= data['accuracy']['longest_step']
    frame = Recording(out).frame_at()
    assert frame.time == times[-1] == pytest.approx(3600.0)
    assert frame.scene['lava']['viscosity'] == 2e4
    assert Recording(out).frame_at(times[1]).time == times[1]
    # the folder as version 0.1.0 named its parts
    (out / 'run.json').rename(out / 'hindcast.json')
    (out / 'maps').rename(out / 'bag')
    assert Recording(out).frame_at().time == times[-1]


def test_target_of_a_mapped_eruption_chooses_its_spacing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / 'valley', hours=0.3, yaml=LAVA)
    words = 'run', 'valley', '--device', 'cpu', '--maps', '1', '--error', '60%'
    done(*words)
    record = json.loads((tmp_path / 'runs/valley/run.json').read_text())
    assert record['settings']['error'] == 0.6 and record['settings']['spacing_m'] is None
    assert record['numerical_error']['inundated']['total'] < 0.6
    assert record['accuracy']['integrator'] == INTEGRATOR
    for more in (('--preset', 'fine'), ('--spacing', '9'), ('--within', '9s')):
        assert f'{more[0]} exclude each other' in refused(*words, *more).replace(
            f'{more[0]} and --error', f'--error and {more[0]}'
        )


def test_vents_of_the_command_replace_those_of_the_case(valley, tmp_path):
    (tmp_path / 'vents.csv').write_text(
        f'x,y,x_end,y_end,name\n{VENT[0] - 60},{VENT[1]},{VENT[0] + 60},{VENT[1]},fissure\n'
        f'{VENT[0]},{VENT[1] - 60},,,cone\n'
    )
    found = []
    for more in (
        ['--vents', tmp_path / 'vents.csv'],
        ['--vent', f'{VENT[0]},{VENT[1]}', '--discharge', '12'],
    ):
        done(*valley, '-o', tmp_path / more[0], '--json', tmp_path / 'out.json', *more)
        found.append(json.loads((tmp_path / 'out.json').read_text()))
    fissure, cone = found[0]['scene']['vents']
    assert (fissure['name'], cone['name']) == ('fissure', 'cone')
    assert fissure['end'] is not None and cone.get('end') is None
    emitted = [item['volume_emitted_m3'] for item in found]
    assert emitted == pytest.approx([15.0 * 1800, 12.0 * 1800])
    refused(*valley, '--vent', '1,2')


@pytest.mark.parametrize(('rate', 'rates'), [
    (None, [(0.0, 12.0), (1800.0, 0.0)]), (6.0, [(0.0, 6.0), (1800.0, 0.0)]),
])
def test_vents_of_a_case_keep_their_rates_unless_another_is_given(rate, rates, tmp_path):
    folder = write_case(tmp_path / 'valley', hours=0.5, yaml='epsg: 32633')
    (folder / 'vent.csv').unlink()
    crest = [[VENT[0] + away, VENT[1]] for away in (-60, 0, 60)]
    feature = {'type': 'Feature', 'properties': {'effusion_rate': 12},
               'crs': {'type': 'name', 'properties': {'name': 'EPSG:32633'}},
               'geometry': {'type': 'LineString', 'coordinates': crest}}
    (folder / 'vent.geojson').write_text(json.dumps(feature))
    case = load_case(folder, effusion_rate=rate)
    assert [vent.series for vent in case.scene.vents] == [
        tuple((time, 0.5 * rate) for time, rate in rates)
    ] * 2


def test_page_and_numbers_list_the_oxides_of_a_composition(tmp_path):
    oxides = {'SiO2': 50.4, 'Al2O3': 15.0, 'FeO': 10.1, 'MgO': 7.7, 'CaO': 11.4, 'Na2O': 2.8}
    lava_yaml = json.dumps({'lava': {'composition': oxides, 'vft_a': -2.0}})
    case = load_case(write_case(tmp_path / 'valley', hours=0.5, yaml=lava_yaml))
    rows, sources = _constants(case, case.material)
    assert rows[:6] == [
        (name, f'{value:g}', 'wt%', '', 'case.yaml') for name, value in oxides.items()
    ]
    by_name = {row[0]: row for row in rows}
    assert by_name['vft_a'][1::3] == ('-2', 'case.yaml, in place of -4.55')
    # the page cites the law, of which the composition is the input
    number = by_name['vft_b'][4].strip('[]')
    assert 'Giordano' in sources[int(number) - 1]
    assert by_name['vft_b'][1] == f'{case.scene.lava.vft_b:g}'
    words = ['--preset', 'draft', '--spacing', '40', '--device', 'cpu', '--maps', '1']
    output = done('run', tmp_path / 'valley', '-o', tmp_path / 'out', *words)
    expected = r'lava +basalt \(changed: vft_a, vft_b, vft_c\); at the vent .* \(1442 K\)'
    assert re.search(expected, output)
    data = json.loads((tmp_path / 'out/run.json').read_text())
    assert data['composition_percent'] == oxides


def test_hindcast_replicates_give_a_spread_and_a_majority(valley, tmp_path):
    refused(*valley, '--runs', '0')
    done(*valley, '--runs', '2')
    runs = json.loads((tmp_path / 'out/run.json').read_text())['runs']
    assert runs['count'] == len(runs['jaccard']) == 2
    assert runs['lowest'] <= runs['mean'] <= runs['highest']
    with rasterio.open(tmp_path / 'out/runs.tif') as file:
        percent = file.read(1)
    assert set(np.unique(percent)) <= {0.0, 50.0, 100.0}
    area = (percent >= 50.0).sum() * CELL**2
    assert area == pytest.approx(runs['majority']['inundated_area_m2'])
    page = (tmp_path / 'out/hindcast.html').read_text()
    assert f'{runs["majority"]["jaccard"]:.3f} (where at least half' in page
    assert not (tmp_path / 'out/replicates').exists()


def test_runs_of_a_hindcast_are_drawn_once(valley, tmp_path, monkeypatch):
    """The first of them is the run of the case, and only this one makes maps before its end."""
    drawn, simulated, mapped = [], [], []
    for name, calls, of in (
        ('lava_ros.hindcast.page.draw_sheet', drawn, lambda panels, output, **_: output),
        (
            'lava_ros.hindcast.run.Result.of', simulated,
            lambda simulation, snapshot, *_: snapshot.terrain.shape,
        ),
        ('lava_ros.runs.sinks.valid_snapshot', mapped, lambda simulation, _: simulation.time),
    ):
        monkeypatch.setattr(name, _counted(name, calls, of))
    done(*valley[:-1], '3', '--runs', '3')
    assert drawn == [tmp_path / 'out/comparison.png']
    # the case, and two replicates of which one is rotated by 90 degrees
    assert sorted(simulated) == sorted([SHAPE, SHAPE, SHAPE[::-1]])
    # three maps of the case, and one of each other run
    assert len(mapped) == 3 + 2


def _counted(name, calls, of):
    """Return a function that notes calls of another one, given by its full name."""
    function = resolve_name(name)

    def counted(*args, **named):
        calls.append(of(*args, **named))
        return function(*args, **named)

    return counted


def test_refuses_unusable_cases_and_folders_of_others(tmp_path):
    case, out = write_case(tmp_path / 'valley'), tmp_path / 'out'
    out.mkdir()
    (out / 'thesis.txt').write_text('mine')
    assert 'new, empty, or of an interrupted run' in refused('run', case, '-o', out)
    assert 'new, empty or of a calibration' in refused('calibrate', case, '-o', out)
    (case / 'vent.csv').unlink()
    for command in ('run', 'calibrate'):
        output = refused(command, case, '-o', tmp_path / 'new')
        assert output.startswith(f'lava {command}: case is') and output.count('\n') == 1
        assert 'also contains vent.csv' in output and not (tmp_path / 'new').exists()
    assert [path.name for path in out.iterdir()] == ['thesis.txt']


def test_calibration_reports_near_best_sets(valley, tmp_path):
    words = ['calibrate', valley[1], '--device', 'cpu', '--spacing', '40', '--runs', '5']
    words += ['--unknown', 'viscosity=1e3:1e5', '--unknown', 'crust_cover']
    words += ['-o', tmp_path / 'out', '--directions']
    output = done(*words, '2')
    assert 'sets are within' in output
    # five sets are too few for that
    assert 'does not depend' not in output
    assert 'viscosity: 1000 to 100000 Pa s, given by the user' in output
    table = (tmp_path / 'out/runs.csv').read_text()
    assert len(table.splitlines()) == 6
    result = json.loads((tmp_path / 'out/calibration.json').read_text())
    assert result['runs'] == 5
    best, usual = (result[name]['numbers']['valley']['jaccard'] for name in ('best', 'usual'))
    assert best >= usual
    assert result['leave_one_out'] == []
    assert {item['unknown']['name'] for item in result['unknowns']} == {'viscosity', 'crust_cover'}
    _, _, said = lava(*words, '2')
    assert (tmp_path / 'out/runs.csv').read_text() == table
    assert f'continuing with the 5 sets in {tmp_path / "out/runs.csv"}' in said
    assert 'will be replaced' not in said
    output = refused(*words, '4')
    assert '--directions' in output and '2 as in' in output
    for more, named in (
        (['--spacing', '50'], '--spacing is 50'), (['--preset', 'fine'], "--preset is 'fine'"),
        (['--low-pass', '30'], '--low-pass is 30'), ([], 'The case valley has changed'),
    ):
        if not more:
            (valley[1] / 'case.yaml').write_text(LAVA.replace('200', '300'))
        output = refused(*words, '2', *more)
        assert named in output and 'the runs in' in output
    assert (tmp_path / 'out/runs.csv').read_text() == table


@pytest.mark.parametrize('name', ['runs.csv', 'calibration.json', 'posterior.csv'])
def test_calibration_checks_its_outputs_before_a_run(valley, tmp_path, name):
    (tmp_path / 'out' / name).mkdir(parents=True)
    (tmp_path / 'out/settings.json').write_text('{}')
    error = refused('calibrate', valley[1], '--runs', '4', '-o', tmp_path / 'out')
    assert f"--output is '{tmp_path / 'out' / name}', expected a writable file" in error


@pytest.mark.parametrize(('option', 'value'), [('--spacing', '1e9'), ('--device', 'cuda:99')])
def test_refused_calibration_leaves_no_folder(valley, tmp_path, option, value):
    words = ['--runs', '4', '-o', tmp_path / 'out', option, value]
    assert f'{option} is ' in refused('calibrate', valley[1], *words)
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize('other', [['--seed', '7'], ['--runs', '8'], ['--runs', '4']])
def test_calibration_keeps_the_runs_of_another_search(valley, tmp_path, other):
    words = ['calibrate', valley[1], '--device', 'cpu', '--spacing', '40', '-o', tmp_path / 'out']
    words += ['--unknown', 'viscosity=1e3:1e5', '--unknown', 'crust_cover']

    def rows() -> list[str]:
        return (tmp_path / 'out/runs.csv').read_text().splitlines()[1:]

    done(*words, '--runs', '6')
    first = rows()
    done(*words, '--runs', '6', *other)
    both = rows()
    assert {*first} <= {*both} and len({*both}) == len(both)
    # neither search runs a set again
    done(*words, '--runs', '6')
    assert {*rows()} == {*both} and rows()[:6] == first


@pytest.mark.parametrize(('words', 'moved', 'kept'), [
    ([], {'crust_cover'}, {'viscosity', 'vent_temperature', 'reference_temperature'}),
    (['--unknown', 'viscosity', '--unknown', 'vent_temperature'],
     {'viscosity', 'vent_temperature'}, {'reference_temperature'}),
])
def test_calibration_keeps_what_the_case_states(words, moved, kept, tmp_path):
    stated = 'lava: {viscosity: 3.0e4, reference_temperature: 1360}\nvent_temperature: 1413\n'
    case = write_case(tmp_path / 'valley', hours=0.5, yaml=stated)
    output = done(
        'calibrate', case, '--device', 'cpu', '--spacing', '40', '--runs', '4', *words,
        '-o', tmp_path / 'out',
    )
    result = json.loads((tmp_path / 'out/calibration.json').read_text())
    assert moved <= set(result['moved']) and kept <= set(result['kept'])
    assert not set(result['moved']) & set(result['kept'])
    assert f'kept as stated: {", ".join(result["kept"])}' in output
    assert f'moved: {", ".join(result["moved"])}' in output
    asked = 'stated, but moved by --unknown: vent_temperature, viscosity'
    assert (asked in output) is bool(words)
    # the first set are the values of the case, also outside the published ranges
    usual = result['usual']['values']
    if words:
        assert usual == {'viscosity': 3e4, 'vent_temperature': 1413.0}
        assert '3e+04' in output and '1413' in output
    else:
        best = result['erupting_lava']['valley']
        assert best['vents'][0]['temperature_k'] == 1413.0
        assert best['vents'][0]['viscosity_pa_s'] == pytest.approx(5918.0, abs=30.0)


def test_barrier_raises_the_elevation_along_a_line(tmp_path):
    case = write_case(tmp_path / 'valley')
    x, y = VENT
    line = [f'{x - 100},{y - 200}', f'{x + 100},{y - 200}']
    words = ['barrier', case / 'elevation.asc', '-o', tmp_path / 'new.tif', '--line', *line]
    output = done(*words, '--height', '8', '--width', '30', '--epsg', '32633')
    # 200 m of 8 m x 38 m, and a truncated cone
    ends = np.pi * 8.0 * (23.0**2 + 23.0 * 15.0 + 15.0**2) / 3.0
    assert f'{200.0 * 8.0 * 38.0 + ends:.0f} m3 of earth' in output and 'widened' not in output
    with (
        rasterio.open(case / 'elevation.asc') as before,
        rasterio.open(tmp_path / 'new.tif') as after,
    ):
        assert after.crs.to_epsg() == 32633
        assert after.transform == before.transform
        added = after.read(1) - before.read(1)
    assert added.max() == pytest.approx(8.0, abs=1e-3)
    assert (added > 0.0).sum() < 120
    output = done(*words, '--height', '8', '--width', '2', '--epsg', '32633')
    assert 'with the crest widened to ' in output
    lines = tmp_path / 'lines.csv'
    lines.write_text(f'x,y,x_end,y_end,height\n{x - 100},{y},{x + 100},{y},10\n'
                     f'{x},{y - 100},{x},{y + 100},\n')
    words = [*words[:4], '--lines', lines]
    assert 'raised by up to 10.0 m' in done(*words, '--height', '4')
    assert 'height is missing' in refused(*words)


@pytest.mark.parametrize(('words', 'named'), [
    (['--line', '1,2'], '--height'),
    (['--line', '1;2', '3;4', '--height', '5'], 'easting,northing'),
    (['--line', '1,2', '3,4', '--height', '5'], 'a line on the terrain'),
    ([], '--low-pass'),
])
def test_refuses_unusable_barriers(words, named, tmp_path):
    case = write_case(tmp_path / 'valley')
    assert named in refused('barrier', case / 'elevation.asc', '-o', tmp_path / 'new.tif', *words)
    assert not (tmp_path / 'new.tif').exists()


def test_materials_are_listed():
    output = done('materials')
    for part in ('etna_basalt: Etna basalt', '1143 K', '[1] Kedadry', 'SiO2', '50.41 wt%'):
        assert part in output
    for name, constant, value, unit in (
        ('reunion_basalt', 'vft_b', 5558.0, 'K'), ('basalt', 'MgO', 7.69, 'wt%')
    ):
        (one,) = json.loads(done('materials', name, '--json'))['materials']
        found = {item['name']: item for item in one['constants']}
        assert (found[constant]['value'], found[constant]['unit']) == (value, unit)
        assert ('MgO' in found) == (name == 'basalt')
    assert 'etna_basalt' in refused('materials', 'obsidian')


def test_calibration_cross_validates_two_cases(tmp_path):
    cases = [write_case(tmp_path / name, hours=0.5, yaml=LAVA) for name in ('one', 'two')]
    words = ['--device', 'cpu', '--spacing', '40', '--runs', '4', '--unknown', 'crust_cover=0:1']
    words += ['-o', tmp_path / 'out']
    output = done('calibrate', *cases, *words)
    assert 'two: ' in output and 'with the set that is best for the others' in output
    rows = (tmp_path / 'out/runs.csv').read_text().splitlines()
    assert rows[0].startswith('crust_cover,case,jaccard,single')
    assert [row.split(',')[1] for row in rows[1:]] == ['one', 'two'] * 4
    result = json.loads((tmp_path / 'out/calibration.json').read_text())
    assert [item['case'] for item in result['leave_one_out']] == ['one', 'two']
    assert 'folders with different names' in refused('calibrate', cases[0], cases[0])
    output = refused('calibrate', cases[1], *words)
    assert 'a table of runs with crust_cover of two' in output


def test_a_case_in_degrees_runs_without_a_warning(tmp_path):
    folder, _ = write_case_in_degrees(tmp_path / 'degrees', hours=0.5)
    words = ['run', folder, '--preset', 'draft', '--device', 'cpu', '--maps', '1']
    status, out, err = lava(*words, '-o', tmp_path / 'out')
    output = [line for line in err.splitlines() if line.startswith('lava run: ')]
    ground, rates = output
    assert 'EPSG:4326 taken to EPSG:32633' in ground
    assert '2 intervals of mean rates, 0 to 1800 s, 2.7e+04 m3 in all' in rates
    assert status == 0 and 'area' in out


def test_effects_of_a_case_are_those_of_its_run(valley, tmp_path):
    case, report = valley[1], tmp_path / 'effects.json'
    done(*valley)
    done('effects', case, '--preset', 'draft', '--json', report)
    ran = json.loads((tmp_path / 'out/run.json').read_text())['decisions']
    found = json.loads(report.read_text())
    assert found['until_s'] == 1800.0
    names = ('effect', 'forced', 'number', 'value', 'threshold')
    expected, rows = ([{key: row[key] for key in names} for row in rows]
                      for rows in (ran, found['effects']))
    assert rows == expected
    assert {row['effect'] for row in rows if row['forced']} >= {'helmholtz', 'inertia'}


def test_effects_of_a_case_are_measured_on_the_cells_of_its_run(valley, monkeypatch):
    def measured(scene, *_):
        raise LavaError('cell', scene.terrain.resolution, 'the end')

    monkeypatch.setattr('lava_ros.cli.effects._measured', measured)
    monkeypatch.setattr('lava_ros.hindcast.run.Settings.coarseness', lambda *_: 2)
    error = refused('effects', valley[1], '--preset', 'draft', '--measure')
    assert f'cell is {2.0 * CELL}, expected the end' in error


@pytest.mark.parametrize('words', [
    'plan --error 60%', 'run', 'run --members 1 --workers 1',
    'calibrate --runs 4 --unknown density',
])
def test_every_command_chooses_the_method_of_a_case_for_the_effects_of_its_run(
    tmp_path, monkeypatch, words
):
    monkeypatch.chdir(tmp_path)
    # fluid lava would need inertia, which cells lack and runs of cases have switched off
    case = write_case(tmp_path / 'valley', hours=0.2, yaml='lava: {viscosity: 300}\n')
    command, *more = words.split()
    if command != 'plan':
        more += ['--preset', 'draft']
    output = done(command, case, '--method', 'auto', '--device', 'cpu', *more)
    assert 'method: cells, because the lava does not freeze' in output


@pytest.mark.parametrize('command', ['plan', 'effects'])
def test_plan_and_effects_of_a_case_have_its_end(tmp_path, command):
    case = write_case(tmp_path / 'valley', hours=0.5, yaml=LAVA)
    words = [command, case, '--device', 'cpu']
    words += ['--error', '60%'] * (command == 'plan')
    done(*words, '--json', tmp_path / 'found.json')
    assert json.loads((tmp_path / 'found.json').read_text())['until_s'] == 1800.0
    for option, value in (('--until', '2h'), ('--sea-level', '0'), ('--start', '2021-09-19')):
        assert f'{option} does not apply to {case}' in refused(*words, option, value)
    table = case / 'effusion_rate.csv'
    assert '--effusion-rate is' in refused(*words, '--effusion-rate', table)
