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

"""What shows a bag to people: `lava export`, `animate`, `report`, and `info` of its volumes."""

import json

import pytest

from lava_ros.cli.export import MAPS
from lava_ros.cli.main import main
from lava_ros.maps.export import MAPS as EXPORTED_MAPS
from lava_ros.scene import Terrain
from recording import record, TERRAIN


@pytest.fixture
def bag(tmp_path):
    """Frames at 200, 400, 600 and 800 s."""
    return str(record(tmp_path / 'bag'))


def test_export(bag, tmp_path, capsys):
    """The files are named; there is nothing to warn of."""
    assert MAPS == EXPORTED_MAPS
    assert main(['export', bag, '-o', str(tmp_path / 'out'), '--at', '600']) == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        f'written to {tmp_path / "out" / f"{name}.tif"}' for name in MAPS
    ]
    assert said.err == ''


def test_export_of_every_frame(bag, tmp_path, capsys):
    """Many files are counted."""
    assert main(['export', bag, '-o', str(tmp_path / 'out'), '--every']) == 0
    assert capsys.readouterr().out == f'14 files written to {tmp_path / "out"}\n'
    assert len(list((tmp_path / 'out').glob('*.tif'))) == 14


def test_export_without_coordinate_system(tmp_path, capsys):
    """It is done, and said with the way out."""
    terrain = Terrain(TERRAIN.elevation, 5.0, TERRAIN.origin)
    bag = str(record(tmp_path / 'bag', terrain=terrain))
    assert main(['export', bag, '-o', str(tmp_path / 'a')]) == 0
    assert '--epsg and --offset say where it is' in capsys.readouterr().err
    arguments = ['--epsg', '32633', '--offset', '500000', '4180000']
    assert main(['export', bag, '-o', str(tmp_path / 'b'), *arguments]) == 0
    assert capsys.readouterr().err == ''


def test_info_has_the_simulated_time_and_volumes(bag, tmp_path, capsys):
    """What the node said last: eight columns of ten cells, 5 m wide."""
    volume = 250.0 * (8 * 3.26 - 0.05 * 28)
    assert main(['info', bag]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert 'simulated  800.000 s' in lines
    place = lines.index('volumes') + 1
    told = dict(line.strip().split('  ', 1) for line in lines[place : place + 8])
    assert {name: value.strip() for name, value in told.items()} == {
        'emitted': f'{volume:,.1f} m3',
        'flowing': f'{volume:,.1f} m3',
        'frozen': '0 m3',
        'left over the border': '0 m3',
        'left into cells without data': '0 m3',
        'waiting in the vents': '0 m3',
        'of that late': '0 m3',
        'unaccounted for': 'below 1e-15',
    }
    assert main(['info', bag, '--json', '-']) == 0
    said = json.loads(capsys.readouterr().out)['simulation']
    assert said['time'] == 800.0
    assert said['volume_held_m3'] == pytest.approx(volume, rel=1e-6)
