# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The smallest installation, in an environment and a home folder of its own."""

import csv
import json
from pathlib import Path
import subprocess

import pytest

from install.installed_node import install, outside, TERRAIN

#: Commands of an observatory, in order, for the folder of the run and for that of the ensemble.
SCENE = '--terrain slope.npz --vent 50,100 --effusion-rate 10 --preset draft --device cpu'
COMMANDS = f"""
run {SCENE} --until 5min -o run
map run -o run.pdf
map run -o run.html
map run -o run.gif
places run places.csv -o arrivals.csv
export run -o maps
run {SCENE} --until 5min --members 4 --workers 1 -o members
map members -o members.png
map members -o members.html
places members places.csv -o probable.csv
"""


@pytest.mark.nightly
def test_installation_without_extras_runs_draws_and_exports(tmp_path: Path) -> None:
    programs = install(tmp_path, '.', 'rasterio')
    environment = {**outside(), 'HOME': str(tmp_path / 'home'), 'PYTHONNOUSERSITE': '1'}
    environment.pop('PYTHONPATH')
    folder = tmp_path / 'observatory'
    folder.mkdir()
    (folder / 'places.csv').write_text('name,x,y\nMill,70,100\nFar,250,20\n')

    def do(*command: object) -> str:
        done = subprocess.run(
            [str(programs / str(command[0])), *map(str, command[1:])], cwd=folder,
            env=environment, capture_output=True, text=True, check=False,
        )
        assert done.returncode == 0, (command, done.stdout, done.stderr)
        return done.stdout

    assert 'rclpy' not in do('python', '-m', 'pip', 'list')
    do('python', '-c', TERRAIN)
    for words in COMMANDS.strip().splitlines():
        do('lava', *words.split())
    assert json.loads((folder / 'run/run.json').read_text())['inundated_area_m2'] > 0.0
    with (folder / 'arrivals.csv').open() as file:
        mill, far = csv.DictReader(file)
    assert (mill['name'], far['name']) == ('Mill', 'Far')
    assert float(mill['arrival_p50_s']) < 300.0 and not far['arrival_p50_s']
    assert (folder / 'run.pdf').read_bytes().startswith(b'%PDF')
    assert (folder / 'run.gif').read_bytes().startswith(b'GIF')
    for name in ('maps/thickness.tif', 'members/inundation_probability.tif', 'run.html',
                 'members.png', 'members.html', 'probable.csv'):
        assert (folder / name).stat().st_size > 1000 or name.endswith('csv'), name
