# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The notebook runs from its first cell to its last, and contains no outputs."""

import json
import os
from pathlib import Path
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip('matplotlib')
rasterio = pytest.importorskip('rasterio')
ROOT = Path(__file__).parents[1]
NOTEBOOK = json.loads((ROOT / 'examples/lava_ros.ipynb').read_text(encoding='utf-8'))


def test_notebook_has_no_outputs() -> None:
    assert (NOTEBOOK['nbformat'], NOTEBOOK['nbformat_minor']) == (4, 5)
    assert len(NOTEBOOK['cells']) == 10
    assert len({cell['id'] for cell in NOTEBOOK['cells']}) == 10
    code = [cell for cell in NOTEBOOK['cells'] if cell['cell_type'] == 'code']
    assert len(code) == 9
    assert all(cell['outputs'] == [] and cell['execution_count'] is None for cell in code)


@pytest.mark.nightly
def test_cells_run_in_order(tmp_path: Path) -> None:
    cells = [''.join(c['source']) for c in NOTEBOOK['cells'] if c['cell_type'] == 'code']
    cells += ["for number in plt.get_fignums(): plt.figure(number).savefig(f'{number}.png')"]
    cells += ['print(budget.flowing)']
    done = subprocess.run(
        [sys.executable, '-c', '\n'.join(cells)], cwd=tmp_path, capture_output=True, text=True,
        env=os.environ | {'MPLBACKEND': 'Agg', 'PYTHONPATH': str(ROOT)}, timeout=300.0,
    )
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob('*.png'))) == 4
    with rasterio.open(tmp_path / 'maps/thickness.tif') as file:
        thickness = file.read(1, masked=True)
    # 40 m3/s for an hour, 15 for another, less the lava that waits in the vent
    flowing = float(done.stdout.split()[-1])
    assert 0.97 * 198_000.0 < flowing < 198_000.0
    assert thickness.sum() * 30.0**2 == pytest.approx(flowing, rel=1e-4)
    with rasterio.open(tmp_path / 'maps/inundation_probability.tif') as file:
        probability = file.read(1, masked=True)
    assert np.isclose(probability.max(), 100.0)
    assert np.isin(probability.compressed(), 12.5 * np.arange(9)).all()
