# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of steps beside grids."""

import csv

import pytest

from lava_ros.cli import main as cli
from lava_ros.errors import LavaError
from lava_ros.ros import publishing_benchmark as publishing


@pytest.fixture
def brief(monkeypatch):
    """Measure a little, and start no process."""
    monkeypatch.setattr(publishing, 'SPAN', 0.4)
    monkeypatch.setattr(publishing, 'GRIDS', (20,))
    monkeypatch.setattr(publishing, 'held', lambda *_: [('memory', 100, 2.0, 'GB')])


def test_every_measurement_is_a_row(tmp_path, capsys, brief):
    """Steps with and without grids, by how much they slow, grids a second, and memory."""
    output = tmp_path / 'publishing.csv'
    words = ['bench', 'publishing', '--device', 'cpu', '--repetitions', '2', '--particles', '400']
    assert cli.main([*words, '--output', str(output)]) == 0
    with output.open(newline='') as file:
        rows = {row['benchmark']: row for row in csv.DictReader(file)}
    assert 'grids of 20 x 20: steps slow by' in capsys.readouterr().out
    without, beside = (
        float(rows[f'grids of 20 x 20: steps {word}']['high']) for word in ('without', 'beside')
    )
    assert 0.0 < beside and 0.0 < without
    # a busy machine makes few within a span, also the ones that were under way when it began
    assert 0.0 < float(rows['grids of 20 x 20: made']['high']) < 30.0
    assert float(rows['grids of 20 x 20: bytes of one']['high']) > 0.0
    assert rows['memory']['unit'] == 'GB'
    assert cli.main([*words, '500']) == 2


def test_a_process_that_fails_says_why(monkeypatch):
    """The text holds what the process said."""
    monkeypatch.setattr(publishing, '_HOLD', 'raise RuntimeError("no {cells} on {device}")')
    with pytest.raises(LavaError, match='no 7 on thing'):
        list(publishing.held('thing', 5, 7))


@pytest.mark.nightly
def test_a_cpu_has_no_device_memory():
    """A process of its own steps, shows and says how many particles it has; nothing to weigh."""
    assert list(publishing.held('cpu', 100, 20)) == []
