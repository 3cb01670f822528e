# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Scores of hindcasts and of their ensembles, and the pages that list them."""

from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eruption import footprint, SHAPE, write_case
from lava_ros.errors import LavaError
from lava_ros.forecast.member_scenes import member_scene
from lava_ros.forecast.sampling import draw_members
from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.probabilistic_score import mapped_on, plan_of, score_probability
from lava_ros.hindcast.run import Settings
from lava_ros.hindcast.score import distances, Score, score_case, STEPS
from lava_ros.scene import Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.materials import material_named
from lava_ros.simulation.output.inundation import standing_cells
from scripts import load_script

FOOTPRINT = np.zeros((40, 30), bool)
FOOTPRINT[5:30, 10:16] = True

VENT = (30, 12)


def _flow() -> np.ndarray:
    """Return lava two metres thick, two cells east of the mapped flow and five rows shorter."""
    thickness = np.zeros(FOOTPRINT.shape, np.float32)
    thickness[10:30, 12:18] = 2.0
    thickness[10:30, 18] = 0.09
    return thickness


def _scored(thickness: np.ndarray, footprint: np.ndarray, vent: Any = VENT,
            emitted: float = 1.0) -> Score:
    """Return the score of lava that has inundated only the cells where it stands."""
    row, column = vent
    vents = (Vent((10.0 * column + 5.0, 10.0 * row + 5.0), 1.0),)
    scene = Scene(Terrain(np.zeros(footprint.shape), 10.0, origin=(0.0, 0.0)), vents)
    case = Case('', '', '', scene, None, footprint, 0.0, 1.0, emitted)
    return score_case(case, thickness, standing_cells(thickness, 0.1))


def test_score_counts_hits_misses_and_false_alarms():
    found = _scored(_flow(), FOOTPRINT, emitted=30_000.0)
    assert (found.hits, found.misses, found.false_alarms) == (80, 70, 40)
    assert found.jaccard == pytest.approx(80 / 190)
    assert found.fit == pytest.approx((80 / 190) ** 0.5)
    assert (found.recall, found.precision) == (pytest.approx(80 / 150), pytest.approx(80 / 120))
    assert (found.area, found.standing_area) == (12_000.0, 12_000.0)
    assert found.mapped_area == 15_000.0
    assert found.area_error == pytest.approx(-0.2)
    assert (found.mean_thickness, found.median_thickness, found.thickest) == (2.0, 2.0, 2.0)
    assert found.mapped_thickness == pytest.approx(2.0)
    assert found.volume == pytest.approx(24_000.0 + 20 * 0.09 * 100.0)
    none = _scored(np.full(FOOTPRINT.shape, np.nan), FOOTPRINT, emitted=0.0)
    assert (none.jaccard, none.recall, none.precision) == (0.0, 0.0, 0.0)
    assert (none.length, none.volume, none.mean_thickness) == (0.0, 0.0, 0.0)


def test_length_is_that_of_the_path_along_the_flow():
    mask = np.zeros((60, 60), bool)
    mask[10:50, 10] = mask[10, 10:50] = True
    thickness = mask.astype(float)
    found = _scored(thickness, mask, (49, 10))
    assert found.length == found.mapped_length == pytest.approx(780.0, abs=20.0)
    assert found.length_error == 0.0
    short = np.where(np.indices(mask.shape)[1] < 30, thickness, 0.0)
    found = _scored(short, mask, (49, 10))
    assert found.length == pytest.approx(580.0, abs=20.0)
    assert found.length_error == pytest.approx(-200.0 / 780.0, abs=0.01)


def test_paths_are_nearly_straight():
    """A path over open ground is at most 2.8 % too long; paths cross gaps of drained lava."""
    ways = distances(np.ones((81, 81), bool), [(40, 40)])
    straight = np.hypot(*(np.indices(ways.shape) - 40))
    far = straight > 20.0
    assert (ways[far] >= straight[far] - 1e-9).all()
    assert (ways[far] / straight[far]).max() < 1.028
    mask = np.zeros((50, 20), bool)
    mask[40:45, 10] = mask[5:10, 10] = True
    ways = distances(mask, [(45, 10)])
    assert ways[40, 10] == pytest.approx(5.0)
    assert ways[5, 10] == pytest.approx(40.0)
    assert np.isinf(ways[20, 10])
    assert np.isinf(distances(np.zeros((3, 3), bool), [(1, 1)])).all()


def test_paths_are_the_shortest():
    mask = np.pad(np.random.default_rng(4).random((60, 50)) < 0.6, 2)
    sources = [tuple(place) for place in np.argwhere(mask)[[0, 700]]]
    ways = distances(mask, sources)
    steps = [*STEPS, *np.negative(STEPS)]
    by_neighbors = [np.roll(ways, step, (0, 1)) + np.hypot(*step) for step in steps]
    shortest = np.where(mask, np.min(by_neighbors, axis=0), np.inf)
    for place in sources:
        shortest[place] = 0.0
    np.testing.assert_array_equal(ways, shortest)


@pytest.mark.parametrize('turns', [1, 2, 3])
def test_rotated_and_mirrored_maps_have_the_same_score(turns):
    rng = np.random.default_rng(3)
    thickness = np.where(rng.random(FOOTPRINT.shape) < 0.8, _flow(), 0.0)
    vent = np.zeros(FOOTPRINT.shape)
    vent[VENT] = 1.0
    straight = asdict(_scored(thickness, FOOTPRINT))
    for change in (partial(np.rot90, k=turns), np.fliplr):
        (cell,) = np.argwhere(change(vent))
        changed = _scored(change(thickness), change(FOOTPRINT), cell)
        assert asdict(changed) == pytest.approx(straight, rel=1e-6)


SETTINGS = Settings('draft', 20.0, 'cpu', maps=4)


def test_members_fill_the_published_ranges(etna):
    plan = plan_of(etna, SETTINGS)
    scenes = [member_scene(plan.scene, item) for item in draw_members(plan.scene, 32)]
    basalt = material_named('etna_basalt')
    known = {name: item.range for name, item in basalt.constants.items() if item.range}
    found = {name: [getattr(item.lava, name) for item in scenes] for name in known}
    found['temperature'] = [item.vents[0].temperature for item in scenes]
    known['temperature'] = basalt.vent_temperature.range
    found['discharge'] = [item.vents[0].series[0][1] / 20.0 for item in scenes]
    for name, (low, high) in {**known, 'discharge': (0.5, 1.5)}.items():
        values = np.array(found[name])
        assert low * (1 - 1e-6) <= values.min() <= values.max() <= high * (1 + 1e-6), name
        middle = np.sqrt(low * high) if high > 10.0 * low else (low + high) / 2.0
        assert 10 <= (values < middle).sum() <= 22 or name == 'crust_cover_decay', name
    assert len({tuple(values) for values in found.values()}) == len(found)


@pytest.mark.parametrize('exact', [True, False])
def test_uncertainty_of_a_case_replaces_published_ranges_and_the_others_remain(tmp_path, exact):
    text = (
        'uncertainty:\n'
        '  constants: {crust_temperature: {distribution: uniform, low: 700, high: 710}}\n'
    ) + '  exact: all\n' * exact
    plan = plan_of(load_case(write_case(tmp_path / 'valley', yaml=text)), SETTINGS)
    first, second = (member_scene(plan.scene, item) for item in draw_members(plan.scene, 2))
    assert 700.0 < first.lava.crust_temperature != second.lava.crust_temperature < 710.0
    assert (first.vents == second.vents) == exact
    folder = write_case(tmp_path / 'colour', yaml=text.replace('crust_temp', 'viscosity_temp'))
    with pytest.raises(LavaError, match=r'uncertainty.constants.viscosity_temperature'):
        load_case(folder)


def test_members_run_on_the_cells_of_the_hindcast(etna):
    fine, coarse = (
        plan_of(etna, Settings('draft', spacing, 'cpu')) for spacing in (20.0, 60.0)
    )
    assert fine.scene.terrain.shape == SHAPE
    np.testing.assert_array_equal(mapped_on(etna, fine), etna.footprint)
    assert coarse.scene.terrain.resolution == 60.0
    area = mapped_on(etna, coarse).sum() * 60.0**2
    assert area == pytest.approx(etna.area, rel=0.3)
    assert fine.horizon == etna.duration and not fine.effects.inertia
    event = TerrainEvent(60.0, 'a wall', etna.scene.terrain)
    changing = replace(etna, scene=replace(etna.scene, events=(event,)))
    changed = plan_of(changing, Settings('draft', 60.0, 'cpu')).ground_at(61.0)
    np.testing.assert_array_equal(changed.elevation, coarse.scene.terrain.elevation)


def test_probabilities_are_scored_where_lava_could_be():
    """The base rate has no skill and the map itself is perfect; dry ground does not count."""
    came = footprint() > 0.0
    beside = np.zeros(SHAPE, bool)
    beside[:20] = True
    rate = came.sum() / (came | beside).sum()
    uniform = np.where(came | beside, 100.0 * rate, 0.0)
    flat = score_probability(uniform, came)
    assert flat['brier_skill'] == pytest.approx(0.0, abs=1e-12)
    assert flat['base_rate'] == pytest.approx(rate)
    assert flat['largest_gap'] == pytest.approx(0.0, abs=1e-12)
    assert flat['brier_skill_of_terrain'] > 0.0
    perfect = score_probability(100.0 * came, came)
    assert (perfect['brier_score'], perfect['cells']) == (0.0, came.sum())
    # cells that are dry in the forecast and on the map always agree
    few = np.zeros(SHAPE)
    few[0, :5] = 30.0
    assert score_probability(few, few > 50.0)['largest_gap'] is None
    wrong = score_probability(np.where(beside, 80.0, 0.0), came)
    assert wrong['brier_skill'] < 0.0
    # the bin of a probability of 0 includes the missed cells
    assert wrong['largest_gap'] == pytest.approx(0.8)


SCRIPT = Path(__file__).parents[2] / 'docs/benchmarks/tables.py'


def test_tables_in_the_documents_match_the_measurements(monkeypatch):
    # a table needs the script beside it
    monkeypatch.syspath_prepend(SCRIPT.parent)
    script = load_script(SCRIPT)
    for name, tables in script.PAGES.items():
        page = (SCRIPT.parents[1] / name).read_text(encoding='utf-8')
        assert script.written(page, tables) == page
        assert name != 'VALIDATION.md' or '| etna_basalt | 2001 |' in page
    assert {'VALIDATION.md', 'PERFORMANCE.md', 'benchmarks/README.md'} <= set(script.PAGES)
