# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava`: parser, output and exit status."""

import json
import math
import os
from pathlib import Path
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest

from command_line import done, lava, refused
import lava_ros
from lava_ros.cli import main as cli
from lava_ros.cli import map as drawing
from lava_ros.cli import options, scene_options
from lava_ros.cli.console import Progress
from lava_ros.cli.parser import command_of, COMMANDS, parse_command_line, RENAMED
from lava_ros.cli.scenes import scene_from_arguments
from lava_ros.errors import LavaError
from lava_ros.layers import layer
from lava_ros.products import export, run_page
from lava_ros.scene import effusion_rates, emplaced, materials, measurements, Scene
from lava_ros.scene.materials import material_named
from lava_ros.simulation import presets, resolution
from lava_ros.simulation.setup.defaults import device_of

ROOT = Path(__file__).parents[2]

#: Error for text that is not a time.
TIME = "is '1 hour', expected a number with a unit, s, min, h, d: 6h, 90min"


@pytest.mark.parametrize(('line', 'named'), [
    ('map none -o a.png', 'bag is'),
    ('bag info none', 'bag is'),
    # YAML's message of several lines becomes one
    ('effects file', "scene is 'file', expected"),
    ('ros feed --terrain none', 'none'),
    ('ros demo --until -1', '--until is'),
    ('ros demo --max-speed 0', '--max-speed is'),
    ('ros demo --domain 500', '--domain is'),
    ('ros demo --members 8 --forecast', '--forecast is gone: run examples/narrow_forecast.py'),
    ('check accuracy --case none', '--case is'),
    ('check accuracy --repetitions 0', '--repetitions is'),
    ('check accuracy --output file/folder', '--output is'),
    ('check solver --preset as-published', '--preset is'),
    ('check solver --case sheet none', '--case is'),
    ('check solver --device tpu', '--device is'),
    ('check speed effects --repetitions 0', '--repetitions is'),
    ('check speed effects --json .', '--json is'),
    ('check speed steps --device cpu --particles 400 3', '--particles is'),
    ('watch --port 70000', '--port is 70000'),
    ('watch bag --namespace /etna', '--namespace and a bag or an ensemble exclude each other'),
    ('watch --namespace "/no good"', '--namespace is'),
    # all commands parse times alike
    ('ros demo --until "1 hour"', TIME),
    ('plan --within 9s --until "1 hour"', TIME),
    ('map bag -o a.png --at "1 hour"', TIME),
    ('ros replay bag --start-offset "1 hour"', TIME),
])
def test_errors_are_one_sentence(line, named, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').write_text('terrain: {file: a\nvents: [')
    words = shlex.split(line)
    # Warp logs once in a process that it has found no GPU
    device_of('cpu')
    output = refused(*words)
    assert output.startswith(f'lava {command_of(words)}: ') and named in output
    assert output.count('\n') == 1
    assert [path.name for path in tmp_path.iterdir()] == ['file']


def test_ros_arguments_reach_the_node(monkeypatch):
    received: list[list[str]] = []
    monkeypatch.setattr('lava_ros.ros.node.main', lambda args: received.append(args) or 7)
    words = ['--ros-args', '-p', 'time_scale:=5.0', '-r', '__ns:=/etna', '--log-level', 'debug']
    for more in (words, ['--resume', 'bags/my "old" bag: #1', *words], []):
        assert lava('ros', 'node', *more)[0] == 7
    resume = ['--ros-args', '-p', r'resume:="bags/my \"old\" bag: #1"']
    assert received == [words, [*words, *resume], []]


def test_ros_arguments_reach_a_replay(monkeypatch):
    received: list[tuple[float, list[str]]] = []
    monkeypatch.setattr(
        'lava_ros.clients.player.play',
        lambda bag, **given: received.append((given['rate'], given['ros_arguments'])) or 0,
    )
    words = ['--ros-args', '-r', '__ns:=/etna', '-r', 'hazard:=/map']
    sample = str(ROOT / 'bags/sample')
    for more in (words, []):
        assert lava('ros', 'replay', sample, '--rate', '2', *more)[0] == 0
    assert received == [(2.0, words), (2.0, [])]


@pytest.mark.parametrize('words', [['ros feed'], ['ros replay', str(ROOT / 'bags/sample')]])
@pytest.mark.parametrize('wrong', [['-r', '__ns:=no slash'], ['--nope']])
def test_refuses_invalid_ros_arguments(words, wrong):
    assert wrong[-1] in refused(*words, '--ros-args', *wrong)


def test_terrain_without_vents_gets_one_on_its_summit(tmp_path):
    elevation = np.zeros((40, 50))
    elevation[0, 0] = 500.0
    elevation[25, 30] = 300.0
    elevation[20:22, 20:22] = np.nan
    np.savez(tmp_path / 'a.npz', elevation=elevation, resolution=10.0)
    scene = scene_of('--terrain', str(tmp_path / 'a.npz'))
    (vent,) = scene.vents
    assert (vent.position, vent.temperature) == ((305.0, 255.0), 1360.0)
    assert scene.lava == material_named('etna_basalt').lava


def scene_of(*words: str) -> Scene:
    """Return the scene that `lava plan` makes of its arguments."""
    return scene_from_arguments(parse_command_line(['plan', '--within', '9s', *words]))


@pytest.fixture
def island(tmp_path):
    """Write a terrain at Piton de la Fournaise, 1 km wide."""
    ground = {'elevation': 200.0 + np.zeros((100, 100)), 'resolution': 10.0, 'epsg': 32740}
    np.savez(tmp_path / 'a.npz', **ground, offset=(365_000.0, 7_650_000.0))
    return str(tmp_path / 'a.npz')


def test_vents_of_a_file_open_and_close(island, tmp_path):
    rows = (('', ''), ('60', ''), ('', '90'), ('60', '90'))
    lines = [f'{365_300 + 50 * n},7650400,9,{start},{end}' for n, (start, end) in enumerate(rows)]
    lines += ['365600,7650500,,,']
    (tmp_path / 'vents.csv').write_text('\n'.join(['x,y,q,start_s,end_s', *lines]))
    words = ('--terrain', island, '--vents', str(tmp_path / 'vents.csv'))
    *vents, usual = scene_of(*words).vents
    assert [vent.series for vent in vents] == [
        ((-math.inf, 9.0),), ((60.0, 9.0),), ((0.0, 9.0), (90.0, 0.0)), ((60.0, 9.0), (90.0, 0.0)),
    ]
    assert (usual.position, usual.discharge) == ((600.0, 500.0), 50.0)
    with pytest.raises(LavaError, match='--vent and --vents exclude each other'):
        scene_of(*words, '--vent', '365300,7650400')


def test_effusion_rates_of_a_table_are_divided_among_vents(island, tmp_path):
    (tmp_path / 'rates.csv').write_text('date;TADR;error\n2021-09-19;20;5\n2021-09-20;40;10\n')
    (tmp_path / 'vents.csv').write_text('X,Y,share\n365300,7650400,1\n365500,7650400,2\n')
    words = ('--terrain', island, '--effusion-rate', str(tmp_path / 'rates.csv'))
    start = ('--start', '2021-09-18T23:00:00Z', '--porosity', '0.25')
    scene = scene_of(*words, *start, '--vents', str(tmp_path / 'vents.csv'))
    first, second = scene.vents
    assert first.series[:2] == ((3600.0, pytest.approx(40.0 / 3.0)), (90000.0, 0.0))
    assert second.peak == pytest.approx(80.0 / 3.0)
    assert scene.uncertainty.discharge is not None
    for rate in ((), ('--effusion-rate', '5')):
        with pytest.raises(LavaError, match='share of .vent 1. has no effect without a table'):
            scene_of('--terrain', island, '--vents', str(tmp_path / 'vents.csv'), *rate)
    (summit,) = scene_of(*words).vents
    assert summit.discharge == ((0.0, 30.0), (86400.0, 0.0))
    error = refused('effects', *words, '--effusion-rate', '7', '--gaps', 'zero')
    assert '--gaps has no effect without a table' in error


@pytest.mark.parametrize(
    'place', ['365300,7650400', '55.7018,-21.2430', '55°42\'6.5"E,21°14\'34.8"S',
              '21 14 34.8 S, 55 42 6.5 E'],
)
def test_options_set_vent_discharge_and_material(place, island, caplog):
    caplog.set_level('INFO')
    words = ('--terrain', island, '--vent', place, '--discharge', '7', '--material')
    scene = scene_of(*words, 'reunion_basalt')
    (vent,) = scene.vents
    np.testing.assert_allclose(vent.position, (300.0, 400.0), atol=20.0)
    assert (vent.discharge, vent.temperature) == (7.0, 1387.15)
    assert scene.lava == material_named('reunion_basalt').lava
    sentence = r'vent 0: easting 365\d+.*, northing 7650\d+.*, 200 m high, 7 m3'
    assert re.search(sentence, caplog.text)


RATES = 'start,end,q,error\n0,3600,{0},{1}\n'


@pytest.mark.parametrize(('words', 'peak', 'has_error', 'emissivity', 'place'), [
    ('', 4.0, True, 0.4, (300.0, 400.0)),
    ('--effusion-rate 7', 7.0, False, 0.4, (300.0, 400.0)),
    ('--effusion-rate exact.csv', 9.0, False, 0.4, (300.0, 400.0)),
    ('--vent 365500,7650500', 50.0, False, 0.4, (600.0, 600.0)),
    ('--material etna_basalt', 4.0, True, 0.9, (300.0, 400.0)),
    ('--terrain wider.npz', 4.0, True, 0.4, (300.0, 400.0)),
])
def test_options_replace_all_of_what_a_scene_says(
    words, peak, has_error, emissivity, place, island, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    wider = {'elevation': np.full((150, 150), 100.0), 'resolution': 10.0, 'epsg': 32740}
    np.savez('wider.npz', **wider, offset=(364_800.0, 7_649_800.0))
    Path('rates.csv').write_text(RATES.format(4, 1))
    Path('exact.csv').write_text(RATES.format(9, ''))
    Path('scene.yaml').write_text(
        'terrain: {file: a.npz, offset: [364900.0, 7649900.0]}\nlava: {emissivity: 0.4}\n'
        'vents: [{position: [300.0, 400.0], effusion_rate: {file: rates.csv}}]\n'
    )
    scene = scene_of('scene.yaml', *words.split())
    (vent,) = scene.vents
    assert (vent.peak, scene.lava.emissivity) == (peak, emissivity)
    assert (scene.uncertainty.discharge is not None) == has_error
    assert scene.terrain.offset == (364_900.0, 7_649_900.0)
    assert vent.position == pytest.approx(place)


def test_warns_of_positions_on_another_terrain(island, tmp_path, caplog):
    path = tmp_path / 'scene.yaml'
    text = 'terrain: {{file: a.npz}}\nvents: [{{{}, effusion_rate: 1}}]'
    for place, words in (
        ('position: [300.0, 400.0]', 'counted from the lower-left corner of a.npz'),
        ('projected: [365300.0, 7650400.0]', ''),
    ):
        caplog.clear()
        path.write_text(text.format(place))
        scene_of(str(path), '--terrain', island)
        assert words in caplog.text and bool(caplog.records) == bool(words)


@pytest.mark.parametrize(('words', 'text'), [
    ('effects', 'because'), ('map {sample} -o map.png', 'drawn to map.png'),
    ('places {sample} hut.csv', 'lava at least 0.1 m thick'),
])
def test_stdout_has_only_json_when_it_is_asked_for(words, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path('hut.csv').write_text('name,x,y\nhut,0,0\n')
    status, out, err = lava(*words.format(sample=ROOT / 'bags/sample').split(), '--json', '-')
    assert status == 0, err
    assert json.loads(out) and text in err


def test_broken_pipe_ends_quietly(monkeypatch):
    def run(path: str) -> None:
        raise BrokenPipeError

    monkeypatch.setattr('lava_ros.bag.reader.BagReader', run)
    replaced: list[tuple[int, int]] = []
    monkeypatch.setattr(cli.os, 'dup2', lambda a, b: replaced.append((a, b)))
    monkeypatch.setattr(sys.stdout, 'fileno', lambda: 1, raising=False)
    assert cli.main(['bag', 'info', 'bag']) == 141
    assert replaced


def test_help_lists_every_command():
    assert done('--version') == f'lava_ros {lava_ros.__version__}\n'
    page = done('--help')
    for name in COMMANDS:
        assert re.search(rf'^  {name}\s+[a-z]\w+ ', page, re.MULTILINE), name
        assert done(name, '--help').startswith(f'usage: lava {name} ')


@pytest.mark.parametrize(('words', 'sentence'), [
    ((), 'lava: COMMAND is missing, expected one of run, '),
    (('dance',), "lava: COMMAND is 'dance', expected one of run, "),
    (('ros replay',), 'lava ros replay: bag is missing, expected folder of a run, '),
    (('ros replay', 'b', '--rate', 'x'), "lava ros replay: --rate is 'x', expected a finite "),
    (('ros replay', 'b', '--rte', '2'), 'lava ros replay: --rte: unknown option; did you mean '),
    (('bag info', 'a', '\x1b[31m'), "lava bag info: unexpected argument '\\x1b[31m'; "),
    (('bag info', '\udcff'), "lava: an argument is '\\udcff', expected text in UTF-8; "),
    (('ros demo', '--preset', 'none'), "lava ros demo: --preset is 'none', expected one of "),
])
def test_wrong_usage_is_one_line(words, sentence):
    output = refused(*words)
    assert output.count('\n') == 1
    assert output.startswith(sentence)
    assert output.endswith("--help' lists the arguments\n")


@pytest.mark.parametrize('name', RENAMED)
def test_old_name_of_a_command_names_the_new_one(name):
    line = RENAMED[name]
    assert refused(name, 'x', '-o', 'y') == f'lava: lava {name} is now lava {line}\n'
    assert command_of(line.split()) in COMMANDS


#: Packages that are too slow to import for `lava COMMAND --help`.
HEAVY = {
    'dask', 'distributed', 'matplotlib', 'mcap', 'numpy', 'pyogrio', 'rasterio', 'rclpy', 'rich',
    'scipy', 'trimesh', 'viser', 'warp', 'yaml',
}

#: Prints the modules imported by the help of each command.
HELPS = """
from contextlib import redirect_stdout, suppress
from io import StringIO
import sys
from lava_ros.cli.main import main
from lava_ros.cli.parser import COMMANDS
for words in ([], *(name.split() for name in COMMANDS)):
    with suppress(SystemExit), redirect_stdout(StringIO()):
        main([*words, '--help'])
    print('lava', *words, *(name for name in sys.modules if '.' not in name))
"""


def test_help_imports_nothing_heavy():
    run = [sys.executable, '-c', HELPS]
    lines = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(lines) == 1 + len(COMMANDS)
    for line in lines:
        assert not HEAVY & set(line.split()), line


@pytest.mark.parametrize(('declared', 'known'), [
    (options.PRESETS, tuple(presets.PRESETS)),
    (options.DEFAULT_PRESET, presets.DEFAULT),
    (options.seconds_of('', options.HORIZON), resolution.HORIZON),
    (options.MAPS, export.MAPS),
    (options.SOURCES, layer.SOURCES),
    (options.FORMATS, export.FORMATS),
    (drawing.DRAWN, tuple(dict.fromkeys((*layer.SOURCES, 'arrival', *run_page.ENSEMBLE_MAPS)))),
    (scene_options.GAPS, effusion_rates.GAPS),
    (scene_options.RATE_METHODS, tuple(measurements.RATE_ERRORS)),
    (scene_options.EMPLACED_KINDS, emplaced.KINDS),
    (scene_options.DEFAULT_MATERIAL, materials.DEFAULT),
])
def test_constants_of_the_parser_equal_those_of_the_package(declared, known):
    assert declared == known


@pytest.mark.parametrize(('line', 'words'), [
    ('lava mat', {'materials'}), ('lava check in', {'install'}),
    ('lava ros demo --preset dr', {'draft'}),
    ('lava effects et', {'etna.yaml'}),
])
def test_shell_completes_commands_options_choices_and_files(line, words, tmp_path):
    (tmp_path / 'etna.yaml').write_text('')
    run = [sys.executable, '-m', 'lava_ros.cli.main']
    env = {
        '_ARGCOMPLETE': '1', '_ARGCOMPLETE_SHELL': 'bash', '_ARGCOMPLETE_IFS': ' ',
        '_ARGCOMPLETE_STDOUT_FILENAME': str(tmp_path / 'words'),
        'COMP_LINE': line, 'COMP_POINT': str(len(line)), 'PYTHONPATH': str(ROOT),
    }
    subprocess.run(run, env=os.environ | env, cwd=tmp_path, timeout=120, check=True)
    assert set((tmp_path / 'words').read_text().split()) == words


PROGRAM = """
from lava_ros.cli.console import Progress
with Progress(has_lines=False) as progress:
    for part in range(11):
        progress.show('counting', part / 10)
print('done')
"""


def test_progress_without_a_terminal_prints_each_tenth_once(capsys):
    with Progress() as progress:
        for part in range(101):
            progress.show('counting', part / 100)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 11
    assert lines[0] == '  0 %  counting'
    assert lines[5].startswith(' 50 %  counting, ') and lines[5].endswith(' s left')
    assert lines[10] == '100 %  counting'
    with Progress(has_lines=False) as progress:
        progress.show('counting', 0.5)
    assert capsys.readouterr().out == ''


def test_progress_on_a_terminal_is_a_bar():
    outside, inside = os.openpty()
    process = subprocess.Popen(
        [sys.executable, '-c', PROGRAM], stdin=inside, stdout=inside, stderr=inside,
        cwd=ROOT, env=os.environ | {'TERM': 'xterm-256color'},
    )
    os.close(inside)
    received = b''
    try:
        while chunk := os.read(outside, 4096):
            received += chunk
    except OSError:
        # a terminal raises this when its last program ends
        pass
    os.close(outside)
    assert process.wait(120.0) == 0, received
    text = received.decode()
    assert '\x1b[' in text
    assert 'counting' in text
    assert 'done' in text
