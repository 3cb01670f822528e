# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The example that narrows a forecast with an observed outline, and its constants."""

import json
import os
from pathlib import Path
import subprocess
import sys

from matplotlib.image import imread
import pytest

ROOT = Path(__file__).parents[2]


def run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run the example in a folder."""
    return subprocess.run(
        [sys.executable, str(ROOT / 'examples/narrow_forecast.py'), *words], cwd=folder,
        env=os.environ | {'PYTHONPATH': str(ROOT), 'PYTHONUNBUFFERED': '1'},
        capture_output=True, text=True, timeout=400, check=False,
    )


@pytest.mark.parametrize('words', ['--members 1', '--max-speed 0', '--json a/b.json'])
def test_wrong_argument_is_named(words, tmp_path):
    ended = run(tmp_path, *words.split())
    assert ended.returncode == 2 and f'{words.split()[0]} is' in ended.stderr, ended.stderr


@pytest.mark.nightly
def test_observation_improves_the_forecast(tmp_path):
    # of far fewer members than the default, those near the outline may be worse later
    words = ('--max-speed', '200', '--picture', 'out.png', '--device', 'cpu')
    ended = run(tmp_path, *words, '--json', 'out.json')
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert 'a forecast of the arrival time' in ended.stdout
    result = json.loads((tmp_path / 'out.json').read_text())
    # the times depend on the machine, their order does not
    assert 0.0 < result['forecast_after_s'] < result['all_members_after_s']
    assert result['members_effective'] < result['members'] == 16
    before, after = result['before'], result['after']
    for key in ('mean_entropy_bits', 'undecided_m2', 'brier_score'):
        assert 0.0 <= after[key] < before[key], key
    assert imread(tmp_path / 'out.png').shape[2] in (3, 4)
