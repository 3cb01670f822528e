# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Copies of the package without the files of some effects, and the results of programs in them."""

import hashlib
import os
from pathlib import Path
import shutil
import subprocess
import sys

from lava_ros.scene import Lava, Vent
from solver import incline, only, simulated

ROOT = Path(__file__).parents[2]


def copy_package(folder, *deleted):
    """Copy the package to a folder, without the files of the named effects."""
    shutil.copytree(ROOT / 'lava_ros', folder / 'lava_ros')
    delete_effects(folder, *deleted)


def delete_effects(folder, *names):
    """Delete the files of effects from a copy of the repository or of the package."""
    for name in names:
        (folder / f'lava_ros/effects/{name}.py').unlink()
        (folder / f'lava_ros/simulation/step/effects/{name}.py').unlink(missing_ok=True)
        (folder / f'tests/effects/test_{name}.py').unlink(missing_ok=True)


def output_of(code, names, root=ROOT):
    """Return the words that a program prints, given names, with the package in a folder."""
    path = os.pathsep.join(map(str, filter(None, [root, ROOT / 'tests', os.getenv('PYTHONPATH')])))
    run = subprocess.run(
        [sys.executable, '-c', code, *names], capture_output=True, text=True, cwd=root,
        env=os.environ | {'PYTHONPATH': path}, timeout=600,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout.split()


def digest_of(names):
    """Return a digest of a flow with the named effects."""
    ground = incline(-0.2, 20, 20, 5.0, origin=(-50.0, -50.0))
    simulation = simulated(
        ground, Lava.paper(), Vent((0.0, 0.0), 2.0), effects=only(*names), spacing=3.0,
        thickness=1.0,
    )
    simulation.advance(120.0)
    seen = simulation.snapshot()
    return hashlib.sha256(seen.thickness.tobytes() + seen.temperature.tobytes()).hexdigest()
