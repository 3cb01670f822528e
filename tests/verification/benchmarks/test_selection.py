# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the choice of effects."""

import csv
from pathlib import Path

import numpy as np
import pytest

from lava_ros.effects import EFFECTS, Effects, excluded_by
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.selection import decide
from scripts import load_script

FOLDER = Path(__file__).parents[3] / 'docs/benchmarks'
ACCURACY = preset_accuracy(DEFAULT)
choice = load_script(FOLDER / 'choice.py')
SCENES = {item.name: item for item in choice.scenes()}


def decisions_of(item):
    return decide(item.scene, accuracy=ACCURACY, horizon=item.horizon)


def test_every_effect_is_on_in_a_scene_and_off_in_another():
    assert len(SCENES) == len(choice.scenes()) == 16
    chosen = [
        {decision.name for decision in decisions_of(item) if decision.is_on}
        for item in SCENES.values()
    ]
    for name in EFFECTS:
        switches = {name in effects for effects in chosen}
        expected = {False} if name in ('green', 'merging', 'wind') else {True, False}
        assert switches == ({True} if name == 'ground' else expected), name


@pytest.mark.parametrize('table', ['cpu', 'h100'])
def test_committed_changes_are_within_the_stated_errors(table):
    with (FOLDER / f'choice_{table}.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    names = {row['scene'] for row in rows}
    assert names == SCENES.keys()
    for name in names:
        found = [row for row in rows if row['scene'] == name]
        chosen = Effects(**{**dict.fromkeys(EFFECTS, False), **dict.fromkeys(
            found[-1]['chosen'].split(), True
        )})
        assert found[-1]['effect'] == choice.ALL
        for row in found[:-1]:
            assert row['effect'] not in chosen
            effect = EFFECTS[row['effect']]
            largest = np.fmax(float(row['expected']), float(row['measured']))
            stated = effect.cost * largest / effect.threshold
            assert float(row['stated']) == pytest.approx(stated, rel=1e-4)
            # an excluded effect may be off although its number exceeds the threshold
            is_excluded = any(excluded_by(row['effect'], other) for other in chosen)
            assert largest <= effect.threshold or is_excluded
    assert [
        (row['scene'], row['effect']) for row in rows
        if float(row['changed']) > float(row['stated']) + float(row['chance'])
    ] == []
