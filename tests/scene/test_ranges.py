# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Usual ranges of open quantities, and exact quantities."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geodata import write_scene
from lava_ros.errors import LavaError
from lava_ros.scene import Scene, scene_from_yaml
from lava_ros.scene.distributions import Distribution
from lava_ros.scene.materials import materials
from lava_ros.scene.measurements import contour_errors, RATE_ERRORS, SURVEYS, usual_errors
from lava_ros.scene.ranges import describe_inputs, exact_quantities, span_of, with_ranges
from lava_ros.scene.uncertainty import uncertainty_from_dict

VENT = {'position': [50.0, 50.0], 'effusion_rate': 10.0, 'radius': 20.0}

#: Quantities that a scene of Etna's basalt leaves open.
ETNA = {
    'effusion_rate', 'temperature', 'viscosity', 'yield_strength', 'position', 'terrain',
    'density', 'crust_strength', 'crust_cover', 'crust_cover_decay', 'crust_temperature',
}


def scene_of(folder: Path, *, epsg: int | None = 32633, **data: Any) -> Scene:
    """Return a scene of a plane with a vent."""
    data = {'vents': [VENT], **data}
    system = {} if epsg is None else {'epsg': epsg}
    return scene_from_yaml(write_scene(folder, np.zeros((10, 10)), 10.0, data, **system))


def test_everything_with_a_published_range_is_drawn(tmp_path):
    scene = scene_of(tmp_path)
    found = with_ranges(scene).uncertainty.drawn
    assert set(found) == ETNA
    assert all(item.source for item in found.values())
    # the range of the viscosity is in Pa s, the distribution that of a factor
    assert found['viscosity'].support == pytest.approx((35e3 / 500e3, 560e3 / 500e3))
    assert found['temperature'].support == pytest.approx((1303.0 - 1360.0, 0.0))
    assert found['effusion_rate'].support == (0.5, 1.5)
    assert found['position'].radius == 20.0
    assert found['yield_strength'].follows == 'viscosity'
    assert found['crust_cover_decay'].follows == '-crust_cover'
    # a second call adds nothing
    assert with_ranges(with_ranges(scene)).uncertainty == with_ranges(scene).uncertainty
    assert describe_inputs(scene) == describe_inputs(with_ranges(scene))
    assert set(describe_inputs(scene)['drawn']) == ETNA
    assert set(exact_quantities(scene).values()) == {'no published range'}


@pytest.mark.parametrize(('exact', 'fixed'), [
    (['viscosity'], {'viscosity'}),
    (['effusion_rate', 'crust_strength'], {'effusion_rate', 'crust_strength'}),
    ('all', ETNA - {'density'}),
])
def test_scene_fixes_quantities(tmp_path, exact, fixed):
    own = {'distribution': 'uniform', 'low': 2300.0, 'high': 2400.0}
    scene = scene_of(tmp_path, uncertainty={'exact': exact, 'constants': {'density': own}})
    found = with_ranges(scene).uncertainty.drawn
    assert set(found) == ETNA - fixed
    assert found['density'] == Distribution('uniform', (2300.0, 2400.0))
    reasons = exact_quantities(scene)
    assert {name for name in ETNA if reasons.get(name) == 'fixed by the user'} == fixed
    # without the quantity that determines it, a follower is drawn independently
    assert 'yield_strength' not in found or bool(found['yield_strength'].follows) == (
        'viscosity' in found
    )


@pytest.mark.parametrize(('data', 'name', 'reason'), [
    ({'vents': []}, 'effusion_rate', 'no vents'),
    ({'vents': []}, 'position', 'no vents'),
    ({'epsg': None}, 'terrain', 'no coordinate system, so no survey with known errors'),
    ({'lava': {'yield_strength': 0.0}}, 'yield_strength', 'the lava has none'),
    ({'lava': {'crust_strength': 0.0}}, 'crust_strength', '0 in the scene'),
    ({'lava': {'material': 'kedadry2023'}}, 'viscosity', 'no published range'),
    ({'lava': {'solidus': 1359.5}}, 'temperature', 'the lava is close to its solidus'),
])
def test_quantities_without_a_range_are_named(tmp_path, data, name, reason):
    scene = scene_of(tmp_path, **data)
    assert exact_quantities(scene)[name] == reason
    assert name not in with_ranges(scene).uncertainty.drawn


@pytest.mark.parametrize(('value', 'is_log', 'expected'), [
    (2.0, True, (1.0, 4.0)),
    (1.0, True, (1.0, 4.0)),
    (40.0, True, (20.0, 80.0)),
    (10.0, False, (8.5, 11.5)),
])
def test_value_outside_of_the_published_range_has_one_as_wide(value, is_log, expected):
    assert span_of((1.0, 4.0), value, is_log=is_log) == pytest.approx(expected)


def test_ranges_stay_inside_the_limits_of_a_constant_and_above_the_solidus(tmp_path):
    scene = scene_of(tmp_path, lava={'crust_cover': 0.85, 'solidus': 1340.0})
    found = with_ranges(scene).uncertainty.drawn
    assert found['crust_cover'].support == pytest.approx((0.8, 0.9))
    assert found['temperature'].support == pytest.approx((1341.0 - 1360.0, 0.0))
    assert 'about the value of the scene' in found['crust_cover'].source


@pytest.mark.parametrize('lava', [
    *({'material': name} for name in sorted(set(materials()) - {'kedadry2023'})),
    {'vft_a': -4.0, 'vft_b': 5000.0, 'vft_c': 600.0},
    {'composition': {'SiO2': 48.0, 'MgO': 8.0, 'FeO': 12.0, 'CaO': 12.0, 'Al2O3': 16.0}},
])
def test_viscosity_of_every_material_has_a_range(tmp_path, lava):
    found = with_ranges(scene_of(tmp_path, lava=lava)).uncertainty.drawn
    low, high = found['viscosity'].support
    assert low <= 1.0 <= high and high / low > 10.0
    assert not {'vft_a', 'vft_b', 'vft_c', 'reference_temperature'} & set(found)


@pytest.mark.parametrize(('own', 'expected'), [
    ({'effusion_rate': {'measured': 'field'}}, RATE_ERRORS['field']),
    ({'terrain': {'survey': 'srtm'}}, SURVEYS['srtm'].roughness),
    ({'terrain': {'contours': 20.0}}, contour_errors(20.0)),
])
def test_scene_names_how_an_input_was_measured(tmp_path, own, expected):
    (name,) = own
    assert with_ranges(scene_of(tmp_path, uncertainty=own)).uncertainty.drawn[name] == expected


def test_table_states_its_error_or_its_method(tmp_path):
    for head, row, expected in (
        ('start,end,q', '0,100,10', RATE_ERRORS['field']),
        ('start,end,q,error', '0,100,10,1', Distribution('lognormal', (1.0, 1.1049))),
    ):
        (tmp_path / 'rates.csv').write_text(f'{head}\n{row}\n')
        rate = {'file': 'rates.csv', 'measured': 'field'}
        found = scene_of(tmp_path, vents=[{**VENT, 'effusion_rate': rate}]).uncertainty.discharge
        assert found is not None
        assert found.numbers == pytest.approx(expected.numbers, rel=1e-4)
        assert found.kind == expected.kind


@pytest.mark.parametrize(('description', 'cell', 'expected'), [
    ('etna_SRTM1.tif', 30.0, SURVEYS['srtm'].roughness),
    ('Copernicus_DSM_COG_10_N37.tif', 30.0, SURVEYS['tandem-x'].roughness),
    ('United States Geological Survey', 30.0, SURVEYS['usgs'].roughness),
    ('a survey by LiDAR in 2007', 30.0, SURVEYS['lidar'].roughness),
    ('dem.tif', 2.0, SURVEYS['lidar'].roughness),
    ('dem.tif', 10.0, SURVEYS['tandem-x'].roughness),
    ('100 m contours of Copernicus EMS', 25.0, contour_errors(100.0)),
    ('map with contour lines every 12.5 m, SRTM', 25.0, contour_errors(12.5)),
    ('contours of a lidar survey', 1.0, SURVEYS['lidar'].roughness),
    ('0 m contours', 25.0, SURVEYS['tandem-x'].roughness),
])
def test_errors_of_terrain_follow_the_description_or_the_cells(description, cell, expected):
    assert usual_errors(description, cell)[0] == expected


@pytest.mark.parametrize(('data', 'field'), [
    ({'exact': ['colour']}, r'uncertainty.exact\[0\]'),
    ({'exact': 'viscosity'}, 'uncertainty.exact'),
    ({'exact': ['position'], 'position': {'radius': 5.0}}, r'uncertainty.exact\[0\]'),
    ({'effusion_rate': {'measured': 'guess'}}, 'uncertainty.effusion_rate.measured'),
    ({'terrain': {'survey': 'levelling'}}, 'uncertainty.terrain.survey'),
    ({'terrain': {'contours': 0.0}}, 'uncertainty.terrain.contours'),
    ({'terrain': {'contours': 20.0, 'deviation': 2.0}}, 'uncertainty.terrain'),
    ({'viscosity': {'distribution': 'uniform', 'low': 1, 'high': 2, 'follows': 'density'}},
     'uncertainty.viscosity.follows'),
    ({'viscosity': {'distribution': 'uniform', 'low': 1, 'high': 2, 'follows': 'viscosity'}},
     'uncertainty.viscosity.follows'),
])
def test_refuses_unknown_quantities_and_methods(data, field):
    with pytest.raises(LavaError, match=field):
        uncertainty_from_dict(data)


def test_explicit_uncertainty_of_python_draws_nothing_else(tmp_path):
    scene = scene_of(tmp_path)
    alone = replace(scene, uncertainty=replace(scene.uncertainty, material=''))
    assert with_ranges(alone) is alone


def test_fixing_a_quantity_removes_its_distribution():
    own = {'distribution': 'loguniform', 'low': 0.5, 'high': 2.0}
    known = uncertainty_from_dict({
        'viscosity': own, 'yield_strength': {**own, 'follows': 'viscosity'},
        'effusion_rate': own, 'constants': {'density': {**own, 'low': 2e3, 'high': 3e3}},
    })
    fixed = known.fixing(['viscosity', 'density'])
    assert set(fixed.drawn) == {'effusion_rate', 'yield_strength'}
    assert fixed.exact == ('viscosity', 'density') and not fixed.yield_strength.follows
    assert set(known.fixing(['all']).drawn) == set(known.drawn)
    assert known.fixing(['all']).is_exact('terrain')
