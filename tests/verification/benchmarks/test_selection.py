# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The benchmark of the choice of effects."""

import csv
from dataclasses import replace
import math
from pathlib import Path

import numpy as np
import pytest

from lava_ros.effects import EFFECTS, Effects, excluded_by
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import decide, effects_for
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


def test_one_scene_lasts_longer_than_its_horizon():
    longer = [name for name, item in SCENES.items() if item.duration != item.horizon]
    assert longer == ['longer']
    assert SCENES['longer'].duration > 2.0 * SCENES['longer'].horizon


@pytest.mark.parametrize('item', SCENES.values(), ids=SCENES)
def test_full_set_has_every_effect_of_the_material(item):
    decisions = decisions_of(item)
    forced = choice.everything(decisions)
    full = effects_for(item.scene, forced, accuracy=ACCURACY, horizon=item.horizon)
    for decision in decisions:
        name = decision.name
        if name not in ('inertia', 'green', 'helmholtz'):
            assert (name in full) >= decision.is_on
            assert (name in full) == (not math.isnan(decision.value))
    assert full.inertia != full.helmholtz
    found = {decision.name: decision for decision in decisions}
    assert full.inertia or not found['inertia'].is_on
    assert full.helmholtz or not found['helmholtz'].is_on
    assert not full.green
    off = {decision.name for decision in choice.left_off(decisions)}
    assert off == {
        name for name in EFFECTS
        if name in found and not found[name].is_on and not math.isnan(found[name].value)
        and name != 'green'
    }


@pytest.mark.nightly
def test_comparison_forces_each_effect_that_is_off(monkeypatch):
    item = replace(SCENES['fast'], duration=20.0)
    asked = []
    run = choice.run_copies

    def noted(scene, count, switches, **options):
        asked.append(dict(switches))
        return run(scene, count, switches, **options)

    monkeypatch.setattr(choice, 'run_copies', noted)
    rows = list(choice.compare(item, device='cpu', preset='draft', runs=2, particles=300))
    chosen = set(rows[-1]['chosen'].split())
    assert 'inertia' in chosen
    assert [row['effect'] for row in rows[:-1]] == [
        name for name in ('helmholtz', 'viscous_heating', 'conduction') if name not in chosen
    ]
    assert rows[-1]['effect'] == choice.ALL
    # helmholtz requires that inertia is off, also in the run that it is compared with
    assert asked[:3] == [{}, {'inertia': False}, {'inertia': False, 'helmholtz': True}]
    assert asked[3:-1] == [{row['effect']: True} for row in rows[1:-1]]
    for row in rows[:-1]:
        effect = EFFECTS[row['effect']]
        largest = np.fmax(row['expected'], row['measured'])
        assert row['stated'] == pytest.approx(effect.cost * largest / effect.threshold)
    assert rows[-1]['stated'] == pytest.approx(sum(row['stated'] for row in rows[1:-1]))
    for row in rows:
        assert 0.0 <= row['changed'] < 0.5 and 0.0 <= row['chance'] < 0.5
        assert row['area_m2'] > 100.0 and row['front_m'] > 10.0


def test_spacing_grows_to_limit_the_number_of_particles():
    item = SCENES['plain']
    free = choice.accuracy_with(item, 'draft', None)
    assert free == resolved_accuracy(preset_accuracy('draft'), item.scene, horizon=item.horizon)
    coarse = choice.accuracy_with(item, 'draft', 500)
    volume = item.scene.vents[0].volume_between(0.0, item.duration)
    assert volume / (coarse.spacing**2 * coarse.thickness) == pytest.approx(500.0)
    assert choice.accuracy_with(item, 'draft', 10**9) == free


def test_copies_run_together_as_alone():
    item = SCENES['plain']
    accuracy = choice.accuracy_with(item, 'draft', 1000)
    effects = effects_for(item.scene, accuracy=accuracy, horizon=item.horizon)
    arguments = {'accuracy': accuracy, 'device': 'cpu'}
    both = choice.run_copies(
        item.scene, 3, effects, horizon=item.horizon, duration=150.0, **arguments
    )
    parts = choice.PARTS * np.array(item.scene.terrain.elevation.shape)
    assert both.cells.shape == (3, *parts)
    assert both.effects == effects
    alone = Simulation(item.scene, effects=effects, **arguments)
    alone.advance(150.0)
    thickness = np.nan_to_num(alone.snapshot().thickness)
    cells = choice.refined(thickness) > min(COVERED, choice.THIN * accuracy.thickness)
    assert cells.sum() > 200 * choice.PARTS**2
    # rotated copies are rotated back
    assert all(choice.jaccard(one, cells) > 0.97 for one in both.cells)


def test_area_is_that_of_most_runs():
    runs = np.array([[[1, 1, 0]], [[1, 0, 0]], [[1, 1, 1]]], dtype=bool)
    assert choice.footprint(runs).tolist() == [[True, True, False]]
    assert choice.noise(runs) == pytest.approx(0.5)
    one, other = np.array([[True, True, False]]), np.array([[False, True, True]])
    assert choice.jaccard(one, other) == pytest.approx(1.0 / 3.0)
    assert math.isnan(choice.jaccard(one & ~one, one & ~one))


@pytest.mark.parametrize(('table', 'missing'), [('cpu', set()), ('h100', {'fast'})])
def test_committed_changes_are_within_the_stated_errors(table, missing):
    with (FOLDER / f'choice_{table}.csv').open(newline='') as file:
        rows = list(csv.DictReader(file))
    names = {row['scene'] for row in rows}
    assert names == SCENES.keys() - missing
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
