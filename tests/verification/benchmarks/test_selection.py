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
CHANGES = ('changed', 'chance', 'thickness_changed', 'thickness_chance')
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
        # the lobe, which has a crust, is tube-fed: insulation has its crust
        never = ('green', 'merging', 'wind', 'conduction', 'crust')
        assert switches == ({False} if name in never else {True, False}), name


@pytest.mark.parametrize('name', SCENES)
def test_choice_does_not_depend_on_the_resolution(name):
    item, numbers = SCENES[name], []
    for accuracy in (
        *map(preset_accuracy, ('draft', DEFAULT, 'fine')),
        *(preset_accuracy(DEFAULT, spacing=spacing) for spacing in (0.2, 20.0)),
    ):
        decisions = decide(item.scene, accuracy=accuracy, horizon=item.horizon)
        numbers.append([(decision.value, decision.is_on) for decision in decisions])
    for other in numbers[1:]:
        np.testing.assert_equal(other, numbers[0])


def test_committed_changes_are_within_the_stated_errors():
    with (FOLDER / 'choice_cpu.csv').open(newline='') as file:
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
            is_on = row.get('on') == 'True'
            assert (row['effect'] in chosen) is is_on
            effect, threshold = EFFECTS[row['effect']], float(row['threshold'])
            largest = np.fmax(float(row['expected']), float(row['measured']))
            if is_on:
                assert largest > threshold
                continue
            stated = effect.cost * largest / threshold
            assert float(row['stated']) == pytest.approx(stated, rel=1e-4)
            # an excluded effect may be off although its number exceeds the threshold
            is_excluded = any(excluded_by(row['effect'], other) for other in chosen)
            assert largest <= threshold or is_excluded
    assert [
        (row['scene'], row['effect']) for row in rows
        if row.get('on') != 'True'
        and float(row['changed']) > float(row['stated']) + float(row['chance'])
    ] == []


def test_effects_well_above_their_thresholds_change_the_flow():
    """Each changes the footprint or the mean thickness by more than chance.

    At its threshold an effect changes them by its cost, which is about as large as chance.
    """
    with (FOLDER / 'choice_cpu.csv').open(newline='') as file:
        rows = [
            {name: float(row[name]) for name in (*CHANGES, 'expected', 'measured', 'threshold')}
            for row in csv.DictReader(file) if row['on'] == 'True'
        ]
    clear = [
        row for row in rows
        if np.fmax(row['expected'], row['measured']) >= 2.0 * row['threshold']
    ]
    needed = [
        row for row in clear if row['changed'] > row['chance']
        or row['thickness_changed'] > row['thickness_chance']
    ]
    assert len(clear) > 60
    assert len(needed) >= 0.92 * len(clear)
