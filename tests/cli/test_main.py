# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""`lava`: its parser and manual page, what it prints, and its status."""

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

from cli.calls import done, refused
from command_line import lava
import lava_ros
from lava_ros.cli import main as cli
from lava_ros.cli.manual import COMMANDS, GROUPS, parsed
from lava_ros.cli.output import Progress
from lava_ros.cli.scenes import DEMO_VENTS, scene_from_arguments
from lava_ros.errors import LavaError
from lava_ros.scene import Scene
from lava_ros.scene.materials import material_named

ROOT = Path(__file__).parents[2]

#: What is said of a time that is none.
TIME = "is '1 hour', expected a number with a unit, s, min, h, d: 6h, 90min"


@pytest.mark.parametrize(
    ('line', 'named'),
    [
        ('plot none -o a.png', 'bag is'),
        ('info none', 'bag is'),
        ('export none -o out', 'bag is'),
        ('animate none -o a.gif', 'bag is'),
        ('report none -o a.html', 'bag is'),
        # YAML explains itself over several lines; here it does so in one
        ('effects file', "scene is 'file', expected"),
        ('feed --terrain none', 'none'),
        ('feed --scene none', 'none'),
        ('demo --duration -1', '--duration is'),
        ('demo --max-speed 0', '--max-speed is'),
        ('demo --domain 500', '--domain is'),
        ('forecast-demo --members 1', '--members is 1'),
        ('forecast-demo --speed 0', '--speed is 0'),
        ('forecast-demo --domain 500', '--domain is 500'),
        ('forecast-demo --json missing/out.json', '--json is'),
        ('accuracy --case none', '--case is'),
        ('accuracy --device cuda:77', '--device is'),
        ('accuracy --repetitions 0', '--repetitions is'),
        ('accuracy --output file/folder', '--output is'),
        ('accuracy --json none/a.json', '--json is'),
        ('verify --preset perfect', '--preset is'),
        ('verify --preset as-published', '--preset is'),
        ('verify --case sheet none', '--case is'),
        ('verify --device tpu', '--device is'),
        ('verify --json /nowhere/at/all/a.json', '--json is'),
        ('bench effects --device cuda:77', '--device is'),
        ('bench effects --repetitions 0', '--repetitions is'),
        ('bench effects --output none/a.csv', '--output is'),
        ('bench effects --json .', '--json is'),
        ('bench effects --device cpu --particles 400 500', 'one number'),
        ('bench steps --device cpu --particles 400 3', '--particles is'),
        ('watch nothing.mcap', 'nothing.mcap'),
        ('watch --port 70000', '--port is 70000'),
        ('watch bag --namespace /etna', 'no --namespace together with a bag'),
        ('watch --namespace "/no good"', '--namespace is'),
        # a time has one spelling, whatever a command calls it
        ('demo --duration "1 hour"', TIME),
        ('effects --horizon "1 hour"', TIME),
        ('plan --within 9s --horizon "1 hour"', TIME),
        ('plot bag -o a.png --time "1 hour"', TIME),
        ('export bag -o out --at "1 hour"', TIME),
        ('animate bag -o a.gif --seconds "1 hour"', TIME),
        ('replay bag --start-offset "1 hour"', TIME),
        ('replay bag --wait-for-subscribers "1 hour"', TIME),
        ('accuracy --longest "1 hour"', TIME),
    ],
)
def test_errors_are_one_sentence(line, named, tmp_path, monkeypatch):
    """Input that cannot be used is one line on stderr and status 2, before anything is done."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').write_text('terrain: {file: a\nvents: [')
    words = shlex.split(line)
    said = refused(*words)
    assert said.startswith(f'lava {words[0]}: ') and named in said
    assert said.count('\n') == 1
    assert [path.name for path in tmp_path.iterdir()] == ['file']


def test_ros_arguments_reach_the_node(monkeypatch):
    """Everything from --ros-args on is ROS's, in its order; a bag to resume is a parameter."""
    seen: list[list[str]] = []
    monkeypatch.setattr('lava_ros.ros.node.main', lambda args: seen.append(args) or 7)
    words = ['--ros-args', '-p', 'time_scale:=5.0', '-r', '__ns:=/etna', '--log-level', 'debug']
    for more in (words, ['--resume', 'bags/my "old" bag: #1', *words], []):
        assert lava('node', *more)[0] == 7
    resume = ['--ros-args', '-p', r'resume:="bags/my \"old\" bag: #1"']
    assert seen == [words, [*words, *resume], []]


def test_ros_arguments_reach_a_replay(monkeypatch):
    """The command has its own words before --ros-args."""
    seen: list[tuple[float, list[str]]] = []
    monkeypatch.setattr(
        'lava_ros.ros.player.play',
        lambda bag, **given: seen.append((given['rate'], given['ros_arguments'])) or 0,
    )
    words = ['--ros-args', '-r', '__ns:=/etna', '-r', 'hazard:=/map']
    sample = str(ROOT / 'bags/sample')
    for more in (words, []):
        assert lava('replay', sample, '--rate', '2', *more)[0] == 0
    assert seen == [(2.0, words), (2.0, [])]


@pytest.mark.parametrize('words', [['feed'], ['replay', str(ROOT / 'bags/sample')]])
@pytest.mark.parametrize('wrong', [['-r', '__ns:=no slash'], ['--nope']])
def test_what_ros_cannot_read_is_refused(words, wrong):
    """In one sentence that names it."""
    assert wrong[-1] in refused(*words, '--ros-args', *wrong)


@pytest.mark.parametrize('command', ['node', 'feed', 'demo'])
def test_without_ros(command, monkeypatch):
    """Where ROS is missing the error says how to get it."""
    monkeypatch.setattr('lava_ros.cli.ros.find_spec', lambda name: None)
    assert "pip install 'lava_ros[ros]'" in refused(command)


def test_the_default_scene():
    """Without arguments the demo's vents lie high on the demo's terrain."""
    scene = scene_from_arguments(parsed(['feed']))
    assert len(scene.vents) == len(DEMO_VENTS)
    for vent in scene.vents:
        cell = scene.terrain.cell_at(*vent.position)
        assert cell is not None and scene.terrain.elevation[cell] > 800.0


def test_a_terrain_alone_gets_a_vent_on_its_summit(tmp_path):
    """On the highest cell that has data and is not at the border; its lava is that of Etna."""
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
    """The scene that `lava plan` makes of its arguments."""
    return scene_from_arguments(parsed(['plan', '--within', '9s', *words]))


@pytest.fixture
def island(tmp_path):
    """A terrain at Piton de la Fournaise, 1 km wide."""
    ground = {'elevation': 200.0 + np.zeros((100, 100)), 'resolution': 10.0, 'epsg': 32740}
    np.savez(tmp_path / 'a.npz', **ground, offset=(365_000.0, 7_650_000.0))
    return str(tmp_path / 'a.npz')


def test_vents_from_a_file(island, tmp_path):
    """Points and fissures; one with a bend becomes two that share its discharge by length."""
    crs = {'type': 'name', 'properties': {'name': 'EPSG:32740'}}
    line = [[365_300, 7_650_400], [365_300, 7_650_500], [365_600, 7_650_500]]
    shapes = [
        {'type': 'Feature', 'properties': {'name': 'bent', 'discharge': 8},
         'geometry': {'type': 'LineString', 'coordinates': line}},
        {'type': 'Feature', 'properties': {},
         'geometry': {'type': 'Point', 'coordinates': line[2]}},
    ]
    path = tmp_path / 'vents.geojson'
    path.write_text(json.dumps({'type': 'FeatureCollection', 'features': shapes, 'crs': crs}))
    words = ('--terrain', island, '--vents', str(path))
    first, second, point = scene_of(*words).vents
    assert (first.name, first.discharge, second.discharge) == ('bent', 2.0, 6.0)
    np.testing.assert_allclose([first.position, first.end], [[300, 400], [300, 500]], atol=1e-3)
    np.testing.assert_allclose(second.end, point.position)
    assert (point.end, point.discharge) == (None, 50.0)
    for more, named in (
        (('--discharge', '5'), '--effusion-rate is 5.0, expected no --effusion-rate, since'),
        (('--vent', '365300,7650400'), 'no --vent together with --vents'),
    ):
        with pytest.raises(LavaError, match=named):
            scene_of(*words, *more)
    path.write_text('{"type": "Point", "coordinates": [10.0, 20.0]}')
    with pytest.raises(LavaError, match=r'a vent of .* .vent 0. is .*a place on the terrain'):
        scene_of(*words)


@pytest.mark.parametrize(
    ('start', 'end', 'series'),
    [
        ('', '', ((-math.inf, 9.0),)),
        ('60', '', ((60.0, 9.0),)),
        ('', '90', ((0.0, 9.0), (90.0, 0.0))),
        ('60', '90', ((60.0, 9.0), (90.0, 0.0))),
    ],
)
def test_vents_of_a_file_open_and_close(start, end, series, island, tmp_path):
    """An effusion rate that is one number holds from the start to the end of the vent."""
    text = f'x,y,q,start_s,end_s\n365300,7650400,9,{start},{end}\n'
    (tmp_path / 'vents.csv').write_text(text)
    (vent,) = scene_of('--terrain', island, '--vents', str(tmp_path / 'vents.csv')).vents
    assert vent.series == series


def test_a_table_of_effusion_rates_of_the_command(island, tmp_path):
    """It is divided among the vents, given ones or those of the scene; its error is used."""
    (tmp_path / 'rates.csv').write_text('date;TADR;error\n2021-09-19;20;5\n2021-09-20;40;10\n')
    (tmp_path / 'vents.csv').write_text(
        'X,Y,share\n365300,7650400,1\n365500,7650400,2\n'
    )
    words = ('--terrain', island, '--effusion-rate', str(tmp_path / 'rates.csv'))
    start = ('--eruption-start', '2021-09-18T23:00:00Z', '--porosity', '0.25')
    scene = scene_of(*words, *start, '--vents', str(tmp_path / 'vents.csv'))
    first, second = scene.vents
    assert first.series[:2] == ((3600.0, pytest.approx(40.0 / 3.0)), (90000.0, 0.0))
    assert second.peak == pytest.approx(80.0 / 3.0)
    assert scene.uncertainty.discharge is not None
    for rate in ((), ('--effusion-rate', '5')):
        with pytest.raises(LavaError, match='share of .vent 1. is 2.0, expected none without a'):
            scene_of('--terrain', island, '--vents', str(tmp_path / 'vents.csv'), *rate)
    (summit,) = scene_of(*words).vents
    assert summit.discharge == ((0.0, 30.0), (86400.0, 0.0))
    for more, sentence in (
        (('--effusion-rate', '7', '--gaps', 'zero'), '--gaps is .zero., expected no --gaps with'),
        (('--gaps', 'none'), 'there are zero, interpolate'),
        (('--porosity', '2'), 'porosity is 2.0, expected at least 0 and below 1'),
        (('--eruption-start', 'now'), "start is 'now', expected a date such as 2021-09-19"),
        (('--effusion-rate', 'nowhere.csv'), '--effusion-rate is .nowhere.csv., expected a file'),
    ):
        assert re.search(sentence, refused('effects', *words, *more))


@pytest.mark.parametrize(
    'place', ['365300,7650400', '55.7018,-21.2430', '55°42\'6.5"E,21°14\'34.8"S',
              '21 14 34.8 S, 55 42 6.5 E'],
)
def test_vent_discharge_and_material_of_the_command(place, island, caplog):
    """A vent is placed on the map or on the globe; what is not typed is usual."""
    caplog.set_level('INFO')
    words = ('--terrain', island, '--vent', place, '--discharge', '7', '--material')
    scene = scene_of(*words, 'reunion_basalt')
    (vent,) = scene.vents
    np.testing.assert_allclose(vent.position, (300.0, 400.0), atol=20.0)
    assert (vent.discharge, vent.temperature) == (7.0, 1387.15)
    assert scene.lava == material_named('reunion_basalt').lava
    said = r'vent 0: easting 365\d+.*, northing 7650\d+.*, 200 m high, 7 m3'
    assert re.search(said, caplog.text)


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        (('--vent', '-155.2,19.4'), "--vent is '-155.2,19.4', expected"),
        (('--vent', '1,2,3'), "--vent is '1,2,3', expected longitude,latitude"),
        (('--vent', 'nan,1'), "--vent is 'nan,1', expected longitude,latitude"),
        (('--vent', '364000,7650400'), 'a place on the terrain, which covers easting 365000 to'),
        (('--discharge', '-3'), 'discharge is -3.0, expected a finite number at least 0'),
        (('--material', 'obsidian'), "lava.material is 'obsidian', expected one of"),
    ],
)
def test_wrong_vents_of_the_command(words, sentence, island):
    """What is wrong is shown as it was typed."""
    assert sentence in refused('effects', '--terrain', island, *words)


def test_a_broken_pipe_is_no_error(monkeypatch):
    """`lava info BAG | head -1` ends quietly."""

    def run(path: str) -> None:
        raise BrokenPipeError

    monkeypatch.setattr('lava_ros.cli.info.BagReader', run)
    replaced: list[tuple[int, int]] = []
    monkeypatch.setattr(cli.os, 'dup2', lambda a, b: replaced.append((a, b)))
    monkeypatch.setattr(sys.stdout, 'fileno', lambda: 1, raising=False)
    assert cli.main(['info', 'bag']) == 141
    assert replaced


def test_the_page_has_its_parts():
    """Name, synopsis, commands, examples, environment and exit status, within 88 columns.

    Commands are in the order of the groups, each once, with what it does; each example is a
    command with arguments that it takes.
    """
    assert done('--version') == f'lava_ros {lava_ros.__version__}\n'
    page = done('--help')
    for part in ('NAME', 'SYNOPSIS', 'COMMANDS', 'EXAMPLES', 'ENVIRONMENT', 'EXIT STATUS'):
        assert f'{part}\n' in page
    assert max(len(line) for line in page.splitlines()) <= 88
    listed = page[page.index('COMMANDS\n') : page.index('EXAMPLES')].splitlines()[1:]
    lines = [line for line in listed if line.strip() and line[4:5] != ' ']
    expected = []
    for heading, names in GROUPS.items():
        expected += [f'  {heading}', *(f'    {name}' for name in names)]
    assert [re.match(r' +[a-z-]+( up)?', line)[0] for line in lines] == expected
    assert all(line[19:].strip() for line in lines if line.startswith('    '))
    examples = page[page.index('EXAMPLES') : page.index('ENVIRONMENT')].splitlines()[1:]
    commands = [line.strip().split('  ')[0] for line in examples if line.strip()]
    assert len(commands) >= 5
    for command in commands:
        words = command.split()[1:]
        if '--ros-args' in words:
            words = words[: words.index('--ros-args')]
        assert parsed(words).command == words[0]


@pytest.mark.parametrize(
    ('words', 'sentence'),
    [
        ((), "lava: COMMAND is missing; 'lava --help'"),
        (('replays',), "lava: 'replays' is not a command, 'replay' is the closest; 'lava --help'"),
        (('dance',), "lava: 'dance' is not a command; there are demo, node,"),
        (('--verson',), "lava: '--verson' is not known here, '--version' is the closest"),
        (('replay',), "lava replay: bag is missing; 'lava replay --help'"),
        (('replay', 'bag', '--rate', 'x'), "lava replay: --rate: 'x' is not a number"),
        (('replay', 'bag', '--rate'), 'lava replay: --rate: expected one argument'),
        (('replay', 'bag', '--rte', '2'), "lava replay: '--rte' is not known here, '--rate' is"),
        (('info', 'a', 'b'), "lava info: 'b' is not known here"),
        (('plot', 'bag'), 'lava plot: -o/--output is missing'),
        (('bench', 'speed'), "'speed' is not known; there are effects, steps, publishing"),
        (('bench', 'effects', '--runs', '1.5'), "--runs: '1.5' is not a whole number"),
        (('demo', '--preset', 'none'), "--preset: 'none' is not known; there are draft, standard"),
        (('completion', 'fish'), "'fish' is not known; there are bash, zsh"),
        (('node', 'scene.yaml'), "lava node: 'scene.yaml' is not known here"),
    ],
)
def test_wrong_usage_is_one_sentence(words, sentence):
    """What is wrong, what is close, and where to read on; status 2, nothing on stdout."""
    said = refused(*words)
    assert said.count('\n') == 1
    assert sentence in said
    assert said.endswith("--help' lists what it takes\n")


def _completions(script, words):
    """What bash completes the last word to."""
    quoted = ' '.join(f"'{word}'" for word in words)
    code = (
        f'{script}\nCOMP_WORDS=({quoted}); COMP_CWORD={len(words) - 1}; COMP_LINE="{words}"\n'
        'completer=$(complete -p lava | sed -E "s/.*-F ([^ ]+).*/\\1/"); $completer\n'
        'printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    ended = subprocess.run(
        ['bash', '--norc', '-c', code], capture_output=True, text=True, timeout=120, check=True
    )
    return set(ended.stdout.split())


def test_bash_completes(tmp_path, monkeypatch):
    """Commands, options, choices and files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'etna.yaml').write_text('')
    script = done('completion', 'bash')
    assert _completions(script, ['lava', 'do']) == {'doctor'}
    assert {'--rate', '--loop', '--clock'} <= _completions(script, ['lava', 'replay', '--'])
    assert _completions(script, ['lava', 'completion', '']) >= {'bash', 'zsh'}
    assert 'etna.yaml' in _completions(script, ['lava', 'effects', 'et'])


def test_zsh_gets_a_script(monkeypatch):
    """It has every command; without the library that makes it the error says how to get it."""
    script = done('completion', 'zsh')
    assert script.startswith('#compdef lava')
    assert all(name in script for name in COMMANDS)
    monkeypatch.setitem(sys.modules, 'shtab', None)
    assert "pip install 'lava_ros[completion]'" in refused('completion', 'bash')


PROGRAM = """
import sys
if '--bare' in sys.argv:
    sys.modules['rich.progress'] = None
from lava_ros.cli.output import Progress
with Progress(has_lines=False) as progress:
    for part in range(11):
        progress.show('counting', part / 10)
print('done')
"""


def test_tenths_are_lines_where_nobody_watches(capsys):
    """Each tenth once, however often it is told."""
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


@pytest.mark.parametrize(('word', 'shown'), [('', '\x1b['), ('--bare', ' 50 %  counting')])
def test_a_terminal_has_a_bar(word, shown):
    """With rich; without it the lines do. What is printed afterwards is there."""
    outside, inside = os.openpty()
    process = subprocess.Popen(
        [sys.executable, '-c', PROGRAM, word],
        stdin=inside,
        stdout=inside,
        stderr=inside,
        cwd=ROOT,
        env=os.environ | {'TERM': 'xterm-256color'},
    )
    os.close(inside)
    seen = b''
    try:
        while chunk := os.read(outside, 4096):
            seen += chunk
    except OSError:
        # how the end of a terminal's last program is told
        pass
    os.close(outside)
    assert process.wait(120.0) == 0, seen
    text = seen.decode()
    assert shown in text
    assert 'counting' in text
    assert 'done' in text
