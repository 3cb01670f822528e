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

"""The benchmarks of steps, convergence and the choice of effects."""

import csv
from dataclasses import replace
import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.cli import main as cli
from lava_ros.effects import EFFECTS
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.simulation import Simulation
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import decide, effects_for
from lava_ros.verification.benchmarks import convergence, steps
from lava_ros.verification.benchmarks import selection as choice
from lava_ros.verification.benchmarks.effects import effect_sets, lava_field, STEP
from lava_ros.verification.benchmarks.reference import Reference
from lava_ros.verification.benchmarks.scenes import scenes


def test_the_plain_step_is_the_same_step(device):
    """After ten steps its particles are where the product's are, and have moved."""
    simulation = lava_field(900, effect_sets()['bare'], device)
    reference = Reference(simulation, STEP)
    start = reference.position
    reference.advance(10)
    # the reference's particles are in the order of the first sample: find them by their places
    simulation.advance(10 * STEP)
    moved = np.linalg.norm(reference.position - start, axis=1)
    there = simulation.sample().position
    apart = np.linalg.norm(reference.position[:, None] - there[None], axis=2).min(axis=1)
    assert np.median(moved) > 0.0
    assert np.median(apart) < 0.05 * np.median(moved)


@pytest.fixture
def brief(monkeypatch):
    """Measure a little, and start no process."""
    little = {'LEAST': 0.0, 'SETS': ('bare', 'green'), 'FEWER_SETS': ('bare',), 'COVERED_BY': 400,
              'GRIDS': (20,), '_starts': lambda device, repetitions: [2.0, 1.0]}
    for name, value in little.items():
        monkeypatch.setattr(steps, name, value)


def test_every_measurement_is_a_row(device, brief):
    """Each set of effects has a step, a rate and its memory for each number of particles."""
    seen = []
    measured = steps.measure(
        device, particles=(100, 400), repetitions=3,
        on_progress=lambda what, share: seen.append(share),
    )
    rows = [SimpleNamespace(**row) for row in measured]
    assert seen == sorted(seen) and 0.5 < seen[-1] < 1.0
    assert all(0.0 < row.low <= row.value <= row.high for row in rows)
    table = {(row.benchmark, row.particles): row for row in rows}
    for name in steps.SETS:
        for particles in (100, 400):
            step, rate = table[f'{name}: step', particles], table[f'{name}: rate', particles]
            assert rate.value * step.value == pytest.approx(particles)
            slow, fast = particles / step.high, particles / step.low
            assert (rate.low, rate.high) == pytest.approx((slow, fast))
            # position, volume and temperature twice over, in float32, is the least there can be
            assert table[f'{name}: memory', particles].value > 32.0
    gain = table['reference: step', 400].value / table['bare: step', 400].value
    assert table['bare: gain', 400].value == pytest.approx(gain)
    assert table['snapshot of 20 x 20 cells', 400].unit == 'ms'
    assert table['start of a process to its first snapshot', 10_000].low == 1.0


def test_memory_counts_an_array_once(device):
    """Twice the particles take about twice as much, and a view no more."""
    few, many = (lava_field(n, effect_sets()['bare'], device) for n in (40_000, 160_000))
    one, four = (sum(steps._arrays(field).values()) for field in (few, many))
    assert 3.0 < four / one < 4.5
    array = few._state.particle
    assert steps._arrays([array, array[:5], {'it': array}]) == {array.ptr: array.capacity}


def test_a_start_that_fails_says_why(monkeypatch):
    """The text holds what the process said."""
    monkeypatch.setattr(steps, '_FIRST', 'raise RuntimeError("no such {device}")')
    with pytest.raises(LavaError, match='no such thing'):
        steps._starts('thing', 1)


def test_the_command_writes_its_table(tmp_path, capsys, monkeypatch, brief):
    """Rows in the columns of every benchmark, as CSV, as JSON and on the screen."""
    output, text = tmp_path / 'steps.csv', tmp_path / 'steps.json'
    words = 'bench steps --device cpu --repetitions 2 --particles 100 400'
    assert cli.main([*words.split(), '--output', str(output), '--json', str(text)]) == 0
    rows = rows_of(output)
    columns = 'benchmark,particles,value,unit,low,high,repetitions,device,machine,command'
    assert list(rows[0]) == columns.split(',')
    assert {row['command'] for row in rows} == {f'lava {words}'}
    assert len(json.loads(text.read_text())) == len(rows)
    assert 'green: rate' in capsys.readouterr().out


def rows_of(path):
    """The rows of a table."""
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def test_committed_tables_say_how_they_were_made():
    """Each row has its unit, machine and command, and a spread around its value."""
    paths = list((Path(__file__).parents[3] / 'docs/benchmarks').glob('steps_*.csv'))
    assert paths
    for path in paths:
        rows = rows_of(path)
        names = {row['benchmark'] for row in rows}
        assert {'bare: rate', 'bare: gain', 'everything with green: memory'} <= names
        for row in rows:
            assert row['unit'] and row['machine'] and row['command'].startswith('lava bench steps')
            assert float(row['low']) <= float(row['value']) <= float(row['high'])


def test_scenes_are_cases():
    """Each has a vent on its ground and a time to run."""
    found = convergence.scenes()
    assert [case.name for case in found] == ['ridge', 'coarse_ridge', 'hill', 'valley', 'cliff']
    for case in found:
        (vent,) = case.scene.vents
        assert case.volume == case.duration * vent.discharge > 0.0


def test_a_scene_at_each_preset(device):
    """Finer presets have more particles; the finest is what it is compared with."""
    x = np.arange(40) * 5.0
    scene = Scene(
        Terrain(np.tile(-0.2 * x, (40, 1)), 5.0), (Vent((40.0, 100.0), 2.0),), Lava(viscosity=1e4)
    )
    case = convergence.case_of('incline', scene, 600.0)
    rows = [SimpleNamespace(**row) for row in convergence.compare(case, device=device, runs=2)]
    assert [row.preset for row in rows] == list(convergence.LADDER)
    coarse, middle, last = rows
    assert coarse.particles < middle.particles < last.particles
    assert coarse.spacing_m > middle.spacing_m > last.spacing_m
    assert (last.jaccard, last.area_ratio, last.length_ratio) == (1.0, 1.0, 1.0)
    assert 0.5 < middle.jaccard <= 1.0 and middle.across == pytest.approx(16.0, rel=0.01)


ACCURACY = preset_accuracy(DEFAULT)
SCENES = {item.name: item for item in scenes()}


def test_scenes_differ_in_what_they_call_for():
    """Every effect is on in a scene and off in another, but what has to be asked for, and wind."""
    assert len(SCENES) == len(scenes()) == 12
    chosen = [
        effects_for(item.scene, accuracy=ACCURACY, horizon=item.horizon)
        for item in SCENES.values()
    ]
    for name in EFFECTS:
        switches = {name in effects for effects in chosen}
        expected = {False} if name in ('green', 'merging', 'wind') else {True, False}
        assert switches == expected, name


@pytest.mark.parametrize('item', SCENES.values(), ids=SCENES)
def test_everything_is_what_the_material_has(item):
    """Nothing chosen is left out of all effects, and nothing the material lacks is in them."""
    arguments = {'accuracy': ACCURACY, 'horizon': item.horizon}
    auto = effects_for(item.scene, **arguments)
    full = choice.everything(item.scene, **arguments)
    for decision in decide(item.scene, **arguments):
        name = decision.name
        if name not in ('inertia', 'green', 'helmholtz'):
            assert getattr(full, name) >= getattr(auto, name)
            assert getattr(full, name) == (not math.isnan(decision.value))
    assert full.inertia != full.helmholtz
    assert full.inertia or not auto.inertia
    assert not full.green and full != auto


@pytest.mark.parametrize('name', [pytest.param('plain', marks=pytest.mark.nightly), 'fast'])
def test_chosen_effects_cover_what_all_effects_cover(name):
    """Short runs reach the same cells with the chosen effects as with all."""
    item = SCENES[name]
    item = replace(item, horizon=0.2 * item.horizon)
    row = choice.compare(item, device='cpu', preset='draft', runs=2)
    assert min(row['jaccard'], row['single']) >= 0.98
    assert min(row['noise_auto'], row['noise_all']) >= 0.95
    assert row['cells'] > 100 and row['seconds_auto'] > 0.0


def test_copies_are_the_scene_over_and_over():
    """Each has the terrain and its own vents; ends move with them, series keep their times."""
    scene = SCENES['fissure'].scene
    scene = replace(scene, vents=(replace(scene.vents[0], discharge=((0.0, 2.0), (9.0, 0.0))),))
    wide = choice.copies(scene, 5, shift=0.1)
    rows, columns = scene.terrain.elevation.shape
    known = np.isfinite(wide.terrain.elevation)
    assert known.sum() >= 5 * rows * columns
    for number, vent in enumerate(wide.vents):
        place = np.array(vent.position) - scene.vents[0].position
        column, row = np.floor(place / scene.terrain.resolution + 1e-6).astype(int)
        tile = wide.terrain.elevation[row : row + rows, column : column + columns]
        assert (tile == scene.terrain.elevation).all()
        border = wide.terrain.elevation[row : row + rows, column + columns :][:, : choice.GAP]
        assert np.isnan(border).all()
        moved = place - scene.terrain.resolution * np.array([column, row])
        assert moved == pytest.approx(np.full(2, 0.1 * number * scene.terrain.resolution))
        assert np.array(vent.end) - vent.position == pytest.approx((20.0, 160.4))
        assert [time for time, _ in vent.series] == [0.0, 9.0]
        assert vent.series[0][1] == pytest.approx(2.0 * (1.0 + choice.GAIN * number))
    assert number == 4


def test_runs_side_by_side_are_the_runs_one_by_one():
    """The copy whose vents are where they were covers what a run of its own does."""
    item = SCENES['plain']
    accuracy = resolved_accuracy(preset_accuracy('draft'), item.scene)
    effects = effects_for(item.scene, accuracy=accuracy, horizon=item.horizon)
    arguments = {'accuracy': accuracy, 'device': 'cpu'}
    both = choice.covered(item.scene, 3, effects, horizon=150.0, **arguments)
    assert both.shape == (3, *item.scene.terrain.elevation.shape)
    alone = Simulation(item.scene, effects=effects, **arguments)
    alone.advance(150.0)
    cells = alone.snapshot().thickness > choice.COVERED
    assert cells.sum() > 200
    assert choice.jaccard(both[0], cells) > 0.98


def test_a_footprint_is_what_most_runs_cover():
    """Two of three runs decide for each cell; halves take turns.

    Jaccard: cells in both over cells in either; nothing compared to nothing is not a match.
    """
    runs = np.array([[[1, 1, 0]], [[1, 0, 0]], [[1, 1, 1]]], dtype=bool)
    assert choice.footprint(runs).tolist() == [[True, True, False]]
    assert choice.noise(runs) == pytest.approx(0.5)
    one, other = np.array([[True, True, False]]), np.array([[False, True, True]])
    assert choice.jaccard(one, other) == pytest.approx(1.0 / 3.0)
    assert math.isnan(choice.jaccard(one & ~one, one & ~one))
