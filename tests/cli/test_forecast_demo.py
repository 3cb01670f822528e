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

"""`lava forecast-demo`: a node, forecasts over DDS, and an outline that narrows them."""

import json
import os
from pathlib import Path
import subprocess
import sys

from matplotlib.image import imread

ROOT = Path(__file__).parents[2]


def test_what_is_seen_narrows_the_forecast(tmp_path):
    """Forecasts come over DDS; after the outline less is undecided, and what is said is truer."""
    words = ('--device', 'cpu', '--members', '6', '--speed', '100')
    words += ('--json', 'out.json', '--picture', 'out.png')
    demo = subprocess.run(
        [sys.executable, '-m', 'lava_ros.cli.main', 'forecast-demo', *words],
        cwd=tmp_path,
        env=os.environ | {'PYTHONPATH': str(ROOT), 'PYTHONUNBUFFERED': '1'},
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert demo.returncode == 0, demo.stdout + demo.stderr
    assert 'a forecast of when lava comes' in demo.stdout
    result = json.loads((tmp_path / 'out.json').read_text())
    # how soon it is depends on the machine; the order does not
    assert 0.0 < result['forecast_after_s'] < result['all_members_after_s']
    assert result['members_effective'] < result['members'] == 6
    before, after = result['before'], result['after']
    for key in ('mean_entropy_bits', 'undecided_m2', 'brier_score'):
        assert 0.0 <= after[key] < before[key], key
    assert imread(tmp_path / 'out.png').shape[2] in (3, 4)
