# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lines of code that the hard scenes depend on, each with the test that fails without it.

``python -m hard.safeguards`` removes one after the other, in a copy of the package, and checks
that its test then fails: ``make safeguards``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import shutil
import subprocess
import sys
import tempfile

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Safeguard:
    """A line of code that prevents a failure, the description of that failure, and its file.

    ``line``, or the decisive part of it, occurs once, and is replaced by ``without``. The hard
    scene then violates the invariant at the preset.
    """

    name: str
    what: str
    file: str
    line: str
    without: str
    scene: str
    preset: str
    invariant: str


SOLVER = 'lava_ros/simulation'

SAFEGUARDS: tuple[Safeguard, ...] = (
    Safeguard('rise', 'thin lava thrown up a wall that it meets within a step',
              f'{SOLVER}/step/motion.py',
              'if height_at(m.ground, place.x + reduced.x, place.y + reduced.y) <= top:',
              'if height_at(m.ground, place.x + reduced.x, place.y + reduced.y) <= real(1e30):',
              'film_at_wall', 'standard', 'climb'),
    Safeguard('push', 'lava lifted by all of its thickness where its surface is all but level',
              f'{SOLVER}/step/motion.py',
              'rise = real(_STEEPEST) * wp.length(reduced) / m.constants.radius',
              'rise = real(1e30) * wp.length(reduced) / m.constants.radius',
              'pond_between_walls', 'fine', 'energy'),
    Safeguard(
        'reach', 'lava thrown across the map by a cliff whose edge it creeps over within a step',
        f'{SOLVER}/step/motion.py', 'if size > longest:', 'if size > longest + real(1e30):',
        'brink', 'fine', 'place',
    ),
    Safeguard('fall', 'lava at a wall that is many times as fast as free fall',
              f'{SOLVER}/particles/terrain.py',
              'if head > fall:',
              'if head > fall + real(1e30):',
              'pit_filled', 'standard', 'fall'),
    Safeguard('due', 'lava that comes out of its vent late by as long as a step',
              f'{SOLVER}/step/timestep.py',
              'particles < limits.few_particles',
              'particles < 0',
              'slope_89_degrees', 'draft', 'halving'),
    Safeguard(
        'thickest', 'too long steps for the lateral stress that sweeps leave out in thick lava',
        f'{SOLVER}/step/stage.py',
        'constants.thickest = MAX_SOLVED * accuracy.thickness', 'constants.thickest = math.inf',
        'pond_lateral', 'fine', 'climb',
    ),
    Safeguard('drag', 'lava that neighbours on level ground push up a wall by lateral stress',
              'lava_ros/simulation/step/effects/helmholtz.py',
              'drags = f[0] * steep(gradient_at(m.ground, p[0], p[1]))',
              'drags = f[0]',
              'pond_lateral', 'draft', 'energy'),
    Safeguard('heat', 'lava at the foot of a cliff that drag heats by more than its fall gave',
              'lava_ros/simulation/step/effects/inertia.py',
              'if work > given:',
              'if work > given + real(1e30):',
              'heated_in_pit_inertia', 'standard', 'temperature'),
    Safeguard('bend', 'lava that swings from side to side of a hollow in ever shorter steps',
              f'{SOLVER}/step/flow.py',
              'rate += largest * curvature * m.constants.inverse_diffusion_number',
              'rate += real(0.0) * curvature',
              'canyon_level', 'standard', 'cost'),
    Safeguard('diffusion', 'steps beyond what is stable: noise that pushes lava apart',
              f'{SOLVER}/step/timestep.py',
              'if diffusion * step > one:',
              'if diffusion * step > wp.float64(1e30):',
              'leaving_everywhere', 'standard', 'climb'),
    Safeguard('apart', 'particles in one place, that never part',
              f'{SOLVER}/output/snapshot.py',
              'places[copies] += np.where(onto[:, None], offset, -offset)',
              'places[copies] += 0.0 * offset',
              'coincident', 'standard', 'spread'),
    Safeguard('phase', 'vents in one place whose particles are in one place',
              f'{SOLVER}/step/vents.py',
              'phase[index] = next(number for number in count() if number not in taken)',
              'phase[index] = 0.0',
              'vents_over_each_other', 'standard', 'distinct'),
)


def fails_without(safeguard: Safeguard) -> bool:
    """Return True if the test of a safeguard fails in a copy of the package without it."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        ignored = shutil.ignore_patterns('__pycache__')
        for name in ('lava_ros', 'tests'):
            shutil.copytree(ROOT / name, root / name, ignore=ignored)
        shutil.copy(ROOT / 'pyproject.toml', root)
        path = root / safeguard.file
        text = path.read_text(encoding='utf-8')
        path.write_text(text.replace(safeguard.line, safeguard.without), encoding='utf-8')
        result = subprocess.run(
            [
                sys.executable, '-m', 'pytest', '-q', '-x', 'tests/hard/test_hard.py',
                '-k', f'misses and {safeguard.name}', '-m', '', '-p', 'no:cacheprovider',
            ],
            cwd=root,
            env={**os.environ, 'PYTHONPATH': str(root)},
            capture_output=True,
            text=True,
            check=False,
        )
    # 1: tests failed; any other status is not conclusive
    return result.returncode == 1 and safeguard.invariant in result.stdout


def main(names: Sequence[str]) -> int:
    """Remove the named safeguards, or all; return 1 if a test does not fail."""
    missed = 0
    for safeguard in SAFEGUARDS:
        if names and safeguard.name not in names:
            continue
        fails = fails_without(safeguard)
        missed += not fails
        verdict = 'its test fails' if fails else 'ITS TEST DOES NOT FAIL AS IT SHOULD'
        print(f'without {safeguard.name} ({safeguard.file}): {verdict}', flush=True)
    return int(missed > 0)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
