# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""An effect is deleted by deleting its files: package and tests work without it."""

import os
import shutil
import subprocess
import sys

import pytest

from effects.copies import copy_package, delete_effects, digest_of, output_of, ROOT
from lava_ros.effects import EFFECTS

#: Prints where the package is, and the digest of a simulation with the named effects.
DIGEST = """
import sys
import lava_ros
from effects.copies import digest_of
print(lava_ros.__path__[0], digest_of(sys.argv[1:]))
"""

#: Imports the rooms that use effects without each of the named ones in turn, and chooses effects
#: for every material.
WITHOUT = """
from importlib import import_module
import pkgutil, sys
import numpy as np
every = pkgutil.iter_modules
for left_out in sys.argv[1:]:
    pkgutil.iter_modules = lambda *args: [
        one for one in every(*args) if not f'effects.{one.name}'.endswith(f'effects.{left_out}')
    ]
    for name in [name for name in sys.modules if name.startswith('lava_ros')]:
        del sys.modules[name]
    for room in ('scene', 'simulation', 'forecast', 'hindcast', 'verification'):
        path = import_module(f'lava_ros.{room}').__path__
        for module in pkgutil.walk_packages(path, f'lava_ros.{room}.'):
            import_module(module.name)
    from lava_ros.effects import EFFECTS
    from lava_ros.scene import Scene, Terrain, Vent, scene_from_dict, scene_to_dict
    from lava_ros.scene.materials import materials
    from lava_ros.simulation.selection import effects_for
    from lava_ros.verification.benchmarks.effects import effect_sets
    from lava_ros.verification.cases import CASES
    assert left_out not in EFFECTS and len(EFFECTS) > 10
    ground = Terrain(np.add.outer(np.arange(20.0), np.zeros(20)), 10.0)
    for material in materials().values():
        vent = Vent((100.0, 100.0), 5.0, temperature=material.vent_temperature.value)
        scene = Scene(ground, (vent,), material.lava)
        assert left_out not in effects_for(scene)
        scene_to_dict(scene)
    assert not any(left_out in case.effects for case in CASES.values())
    assert left_out not in effect_sets()
"""


def test_flow_is_bitwise_identical_with_other_effects_deleted(tmp_path):
    names = ('cooling', 'arrhenius', 'steep')
    deleted = [name for name in EFFECTS if name not in names]
    assert len(deleted) > 10
    copy_package(tmp_path, *deleted)
    found = output_of(DIGEST, names, tmp_path)
    assert found[-2:] == [str(tmp_path / 'lava_ros'), digest_of(names)]


@pytest.mark.parametrize('names', [
    ('solidification',), pytest.param(EFFECTS, marks=pytest.mark.nightly),
], ids=['one', 'each'])
def test_package_works_without_any_effect(names):
    output_of(WITHOUT, names)


@pytest.mark.nightly
@pytest.mark.parametrize('name', EFFECTS)
def test_other_tests_pass_without(tmp_path, name):
    """All tests are collected, and those of effects and scenes run, in a copy."""
    folder = tmp_path / 'copy'
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns('.*', 'build', '__pycache__'))
    delete_effects(folder, name)
    path = os.pathsep.join(map(str, filter(None, [folder, os.getenv('PYTHONPATH')])))
    for arguments in (['--collect-only', 'tests'], ['tests/effects', 'tests/scene']):
        run = subprocess.run(
            [sys.executable, '-m', 'pytest', '-q', *arguments], capture_output=True, text=True,
            cwd=folder, env=os.environ | {'PYTHONPATH': path},
        )
        assert run.returncode == 0, run.stdout
