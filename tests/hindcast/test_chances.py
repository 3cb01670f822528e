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


"""Ensembles of cases: what is drawn, on what ground, and the score against the map."""

from pathlib import Path

import numpy as np
import pytest

from eruption import footprint, SHAPE, write_case
from lava_ros.errors import LavaError
from lava_ros.forecast.members import member_scene
from lava_ros.forecast.sampling import draw_members
from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.chances import chances_of, mapped_on, plan_of
from lava_ros.hindcast.run import Settings
from lava_ros.scene.materials import material_named

SETTINGS = Settings('draft', 20.0, 'cpu', maps=4)


def test_members_fill_the_published_ranges(tmp_path: Path) -> None:
    """Absolute values of members lie in the ranges of the material, and spread over them."""
    plan = plan_of(load_case(write_case(tmp_path / 'valley')), SETTINGS)
    scenes = [member_scene(plan.scene, item) for item in draw_members(plan.scene, 32)]
    etna = material_named('etna_basalt')
    known = {name: item.range for name, item in etna.constants.items() if item.range}
    found = {name: [getattr(item.lava, name) for item in scenes] for name in known}
    found['temperature'] = [item.vents[0].temperature for item in scenes]
    known['temperature'] = etna.vent_temperature.range
    found['discharge'] = [item.vents[0].series[0][1] / 20.0 for item in scenes]
    for name, (low, high) in {**known, 'discharge': (0.5, 1.5)}.items():
        values = np.array(found[name])
        assert low * (1 - 1e-6) <= values.min() <= values.max() <= high * (1 + 1e-6), name
        middle = np.sqrt(low * high) if high > 20.0 * low else (low + high) / 2.0
        assert 10 <= (values < middle).sum() <= 22 or name == 'crust_cover_decay', name
    assert len({tuple(values) for values in found.values()}) == len(found)


def test_a_case_says_what_is_uncertain(tmp_path: Path) -> None:
    """What case.yaml names takes the place of the published ranges, constants too."""
    text = (
        'uncertainty:\n'
        '  constants: {crust_temperature: {distribution: uniform, low: 700, high: 710}}\n'
    )
    plan = plan_of(load_case(write_case(tmp_path / 'valley', yaml=text)), SETTINGS)
    first, second = (member_scene(plan.scene, item) for item in draw_members(plan.scene, 2))
    assert 700.0 < first.lava.crust_temperature != second.lava.crust_temperature < 710.0
    assert first.vents == second.vents
    folder = write_case(tmp_path / 'colour', yaml=text.replace('crust_temp', 'viscosity_temp'))
    with pytest.raises(LavaError, match=r'uncertainty.constants.viscosity_temperature'):
        load_case(folder)


def test_ground_and_map_are_no_finer_than_particles(tmp_path: Path) -> None:
    """Members run on the cells of the hindcast, and the map is that of these cells."""
    case = load_case(write_case(tmp_path / 'valley'))
    fine, coarse = (
        plan_of(case, Settings('draft', spacing, 'cpu')) for spacing in (20.0, 60.0)
    )
    assert fine.scene.terrain.shape == SHAPE
    np.testing.assert_array_equal(mapped_on(case, fine), case.footprint)
    assert coarse.scene.terrain.resolution == 60.0
    area = mapped_on(case, coarse).sum() * 60.0**2
    assert area == pytest.approx(case.area, rel=0.3)
    assert fine.horizon == case.duration
    assert not fine.effects.inertia


def test_events_are_refused(tmp_path: Path) -> None:
    """Members run on one ground; a case whose ground changes is not run as if it did not."""
    x, y = 500_350.0, 4_180_700.0
    text = f'events: [{{time: 60, barrier: {{line: [[{x}, {y}], [{x + 90}, {y}]], '
    text += 'height: 9, width: 20}}]\n'
    with pytest.raises(LavaError, match=r'case.events'):
        plan_of(load_case(write_case(tmp_path / 'valley', yaml=text)), SETTINGS)


def test_chances_are_scored_where_lava_could_be() -> None:
    """A base rate said everywhere has no skill, the map itself has all, dry ground gives none."""
    came = footprint() > 0.0
    beside = np.zeros(SHAPE, bool)
    beside[:20] = True
    rate = came.sum() / (came | beside).sum()
    said = np.where(came | beside, 100.0 * rate, 0.0)
    flat = chances_of(said, came)
    assert flat['brier_skill'] == pytest.approx(0.0, abs=1e-12)
    assert flat['base_rate'] == pytest.approx(rate)
    assert flat['largest_gap'] == pytest.approx(0.0, abs=1e-12)
    assert flat['brier_skill_of_terrain'] > 0.0
    right = chances_of(100.0 * came, came)
    assert (right['brier_score'], right['cells']) == (0.0, came.sum())
    wrong = chances_of(np.where(beside, 80.0, 0.0), came)
    assert wrong['brier_skill'] < 0.0
    # the cells that were missed are judged with all that were said to stay dry
    assert wrong['largest_gap'] == pytest.approx(0.8)
