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

"""The benchmark of the choice of effects."""

from dataclasses import replace
import math

import numpy as np
import pytest

from lava_ros.effects import EFFECTS
from lava_ros.simulation import Simulation
from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import decide, effects_for
from lava_ros.verification.benchmarks import selection as choice
from lava_ros.verification.benchmarks.scenes import scenes

ACCURACY = preset_accuracy(DEFAULT)


def test_scenes_differ_in_what_they_call_for():
    """Every effect is on in a scene and off in another, but what has to be asked for, and wind."""
    items = scenes()
    assert len({item.name for item in items}) == len(items) == 12
    chosen = [effects_for(item.scene, accuracy=ACCURACY, horizon=item.horizon) for item in items]
    for name in EFFECTS:
        switches = {name in effects for effects in chosen}
        expected = {False} if name in ('green', 'merging', 'wind') else {True, False}
        assert switches == expected, name


@pytest.mark.parametrize('item', scenes(), ids=lambda item: item.name)
def test_everything_is_what_the_material_has(item):
    """Nothing chosen is left out of all effects, and nothing the material lacks is in them."""
    arguments = {'accuracy': ACCURACY, 'horizon': item.horizon}
    auto = effects_for(item.scene, **arguments)
    full = choice.everything(item.scene, **arguments)
    for decision in decide(item.scene, **arguments):
        name = decision.name
        if name in ('inertia', 'green', 'helmholtz'):
            continue
        assert getattr(full, name) >= getattr(auto, name)
        assert getattr(full, name) == (not math.isnan(decision.value))
    assert full.inertia != full.helmholtz
    assert full.inertia or not auto.inertia
    assert not full.green
    assert full != auto


@pytest.mark.parametrize('name', [pytest.param('plain', marks=pytest.mark.nightly), 'fast'])
def test_chosen_effects_cover_what_all_effects_cover(name):
    """Short runs reach the same cells with the chosen effects as with all."""
    item = next(item for item in scenes() if item.name == name)
    item = replace(item, horizon=0.2 * item.horizon)
    row = choice.compare(item, device='cpu', preset=DEFAULT, runs=2)
    assert min(row['jaccard'], row['single']) >= 0.98
    assert min(row['noise_auto'], row['noise_all']) >= 0.95
    assert row['cells'] > 100 and row['seconds_auto'] > 0.0


def test_copies_are_the_scene_over_and_over():
    """Each has the terrain and its own vents; ends move with them, series keep their times."""
    scene = next(item.scene for item in scenes() if item.name == 'fissure')
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
    item = next(item for item in scenes() if item.name == 'plain')
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
    """Two of three runs decide for each cell; halves take turns."""
    runs = np.array([[[1, 1, 0]], [[1, 0, 0]], [[1, 1, 1]]], dtype=bool)
    assert choice.footprint(runs).tolist() == [[True, True, False]]
    assert choice.noise(runs) == pytest.approx(0.5)


def test_jaccard_of_cells():
    """Cells in both over cells in either; nothing compared to nothing is not a match."""
    one, other = np.array([[True, True, False]]), np.array([[False, True, True]])
    assert choice.jaccard(one, other) == pytest.approx(1.0 / 3.0)
    assert math.isnan(choice.jaccard(one & ~one, one & ~one))
