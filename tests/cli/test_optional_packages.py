# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Errors about packages that only some tasks need, and commands that need none of them."""

import ast
from pathlib import Path
import re
import sys

import numpy as np
from packaging.requirements import Requirement
import pytest

from command_line import refused
from project import EXTRAS, MODULES

SAMPLE = Path(__file__).parents[2] / 'bags/sample'

#: Packages that a command can lack, with a command line, and the remedy in the error.
MISSING = [
    ('rasterio', f'export {SAMPLE} -o maps', 'pip install rasterio'),
    ('rasterio', f'export {SAMPLE} -o maps --formats geojson', 'pip install rasterio'),
    ('rasterio', 'effects --terrain model.tif --vent 5,5', 'pip install rasterio'),
    ('rasterio', 'run --members 2 --terrain flat.npz --vent 50,50 -o out', 'pip install rasterio'),
    ('pyogrio', f'export {SAMPLE} -o maps --formats gpkg', 'pip install pyogrio'),
    ('pyogrio', f'places {SAMPLE} places.gpkg', 'pip install pyogrio'),
    ('viser', f'watch {SAMPLE}', 'pip install viser'),
    ('distributed', 'run --members 2 --terrain flat.npz --vent 50,50 --effusion-rate 1 '
     '--until 1min -o out --scheduler tcp://localhost:1', 'pip install distributed'),
    ('rclpy', 'ros node', "pip install '.[ros]' in the folder of the source"),
    ('nav_msgs', 'ros demo', "pip install '.[ros]' in the folder of the source"),
    ('rclpy', 'ros feed', "pip install '.[ros]' in the folder of the source"),
]


@pytest.mark.parametrize(('package', 'line', 'remedy'), MISSING)
def test_error_names_the_missing_package_and_the_remedy(
    package: str, line: str, remedy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    np.savez('flat.npz', elevation=np.zeros((10, 10)), resolution=10.0)
    for name in ('model.tif', 'places.gpkg'):
        Path(name).touch()
    before = set(tmp_path.iterdir())
    monkeypatch.setitem(sys.modules, package, None)
    error = refused(*line.split()).splitlines()[-1]
    assert re.search(rf'\b{package}\b.* is not installed', error), error
    assert remedy in error and set(tmp_path.iterdir()) == before


def test_every_guarded_package_is_tried_and_belongs_to_an_extra() -> None:
    guarded = {
        str(call.args[0].value)
        for path in MODULES.values()
        for call in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
        and call.func.id == 'require' and isinstance(call.args[0], ast.Constant)
    }
    installed_by_extras = {Requirement(item).name for item in EXTRAS['all']}
    assert guarded and guarded <= installed_by_extras
    assert guarded <= {package for package, _, _ in MISSING}


def test_no_text_installs_the_package_from_a_registry() -> None:
    # nobody owns that name in the registry: anyone could upload something there
    root = Path(__file__).parents[2]
    texts = [*(root / 'docs').rglob('*.md'), *root.glob('*.md'), *MODULES.values(),
             *(root / 'examples').glob('*')]
    for path in filter(Path.is_file, texts):
        for line in path.read_text(encoding='utf-8').splitlines():
            words = line.partition('pip install')[2].replace('`', ' ').split()
            names = {word.strip('\'"').partition('[')[0] for word in words}
            assert '--no-index' in words or not {'lava_ros', 'lava-ros'} & names, (path, line)
