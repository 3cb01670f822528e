# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Drawn members: reproducible, distributed as given, and placed by rasters."""

from dataclasses import replace
import hashlib
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rasterio.transform import Affine, from_origin
from rasterio.warp import transform_geom

from disc_flow import disc_plan, FACTOR, TERRAIN, VENT
from geodata import write_raster
from lava_ros.errors import LavaError
from lava_ros.forecast.observations import observed_in_file
from lava_ros.forecast.sampling import (
    draw_members,
    Member,
    Posterior,
    random_field,
    rough_terrain,
    Susceptibility,
)
from lava_ros.scene import Lava, Scene, Terrain
from lava_ros.scene.distributions import Roughness
from lava_ros.scene.on_terrain import read_raster_on

UNCERTAIN = {
    'temperature': {'distribution': 'normal', 'mean': 5.0, 'deviation': 20.0},
    'viscosity': {'distribution': 'uniform', 'low': 0.5, 'high': 1.5},
    'position': {'deviation': 30.0},
    'terrain': {'deviation': 1.0, 'correlation': 60.0},
}

#: Drawn when this test was written.
MEMBER_2 = Member(
    2, discharge=1.24154735, temperature=-15.4697323, viscosity=0.557388734,
    displacement=(28.0088975, 2.67187818), seed=(1, 2),
)

FIELD = '9bcbe4e39d95e50d'
SCENE = disc_plan(**UNCERTAIN).scene


def test_members_do_not_depend_on_their_number() -> None:
    many = draw_members(SCENE, 100, seed=3)
    assert draw_members(SCENE, 37, seed=3) == many[:37]
    assert draw_members(SCENE, 1, seed=3) == many[:1]
    others = draw_members(SCENE, 100, seed=4)
    assert all(one.discharge != other.discharge for one, other in zip(many, others, strict=True))
    # on every machine, with every version of numpy and scipy
    assert draw_members(SCENE, 3, seed=1)[2] == MEMBER_2


def test_eruptions_follow_the_probability_of_their_classes() -> None:
    long = {'distribution': 'uniform', 'low': 1e5, 'high': 1e6}
    classes = [
        {'probability': 3.0, 'duration': {**long, 'low': 1e3, 'high': 1e4}, 'volume': long},
        {'probability': 1.0, 'duration': long, 'volume': {**long, 'low': 1e6, 'high': 2e6}},
    ]
    members = draw_members(disc_plan(**UNCERTAIN, eruption=classes).scene, 256, seed=1)
    assert replace(members[2], eruption=None) == MEMBER_2
    drawn = np.array([member.eruption for member in members])
    short = drawn[:, 0] < 1e5
    assert short.mean() == pytest.approx(0.75, abs=0.02)
    assert drawn[short].min(axis=0) == pytest.approx([1e3, 1e5], rel=0.1)
    assert drawn[~short].max(axis=0) == pytest.approx([1e6, 2e6], rel=0.1)


def test_new_members_have_the_mean_and_the_spread_of_the_weighted_ones() -> None:
    parents = draw_members(disc_plan().scene, 512, seed=2)
    # a normal distribution times a normal likelihood with a mean of 1 and a deviation of 0.5
    score = np.log([member.discharge for member in parents]) / math.log(FACTOR)
    posterior = Posterior(parents, np.exp(-2.0 * (score - 1.0) ** 2))
    assert 100.0 < posterior.effective_members < 400.0
    drawn = draw_members(disc_plan().scene, 512, seed=2, posterior=posterior)
    found = np.log([member.discharge for member in drawn]) / math.log(FACTOR)
    assert found.mean() == pytest.approx(0.8, abs=0.02)
    assert found.std() == pytest.approx(math.sqrt(0.2), abs=0.02)
    assert len(set(found.tolist())) == 512
    # independent of their number, and others after another observation
    assert draw_members(disc_plan().scene, 37, seed=2, posterior=posterior) == drawn[:37]
    again = replace(posterior, generation=2)
    assert draw_members(disc_plan().scene, 9, seed=2, posterior=again) != drawn[:9]


def test_new_members_of_a_single_parent_differ_inside_their_ranges() -> None:
    classes = [
        {'probability': 1.0, 'duration': span, 'volume': span}
        for span in (
            {'distribution': 'uniform', 'low': 1e3, 'high': 1e4},
            {'distribution': 'uniform', 'low': 1e5, 'high': 1e6},
        )
    ]
    scene = disc_plan(**UNCERTAIN, eruption=classes).scene
    parents, weights = draw_members(scene, 16), np.zeros(16)
    weights[5] = 1.0
    drawn = draw_members(scene, 64, posterior=Posterior(parents, weights))
    assert {member.seed for member in drawn} == {(0, 5)}
    assert parents[5].eruption is not None
    is_short = parents[5].eruption[0] < 1e5
    for member in drawn:
        assert member.eruption is not None and (member.eruption[0] < 1e5) == is_short
        assert 0.5 < member.viscosity < 1.5
    # a tenth of the deviation before, times the width of the kernel
    spread = np.std([member.temperature for member in drawn])
    assert spread == pytest.approx(0.1 * 20.0 * (4.0 / 9.0) ** (1.0 / 11.0), rel=0.1)
    # exact quantities remain so
    assert {member.yield_strength for member in drawn} == {1.0}


def test_values_are_distributed_as_given() -> None:
    members = draw_members(SCENE, 256, seed=5)
    names = ('discharge', 'temperature', 'viscosity', 'yield_strength')
    table = {name: np.array([getattr(member, name) for member in members]) for name in names}
    table['displacement_x'] = np.array([member.displacement[0] for member in members])
    assert np.median(table['discharge']) == pytest.approx(1.0, rel=0.01)
    assert np.std(np.log(table['discharge'])) == pytest.approx(np.log(1.6), rel=0.02)
    assert table['temperature'].mean() == pytest.approx(5.0, abs=0.3)
    assert table['temperature'].std() == pytest.approx(20.0, rel=0.02)
    assert table['viscosity'].min() >= 0.5 and table['viscosity'].max() <= 1.5
    assert table['displacement_x'].std() == pytest.approx(30.0, rel=0.02)
    assert (table['yield_strength'] == 1.0).all()
    # quantities are independent of each other
    correlation = np.corrcoef([table['temperature'], table['viscosity'], table['displacement_x']])
    assert np.abs(correlation - np.eye(3)).max() < 0.05


def test_refuses_unusable_draws() -> None:
    for count in (0, 1.5, 10**9):
        with pytest.raises(LavaError, match='members'):
            draw_members(SCENE, count)  # type: ignore[arg-type]
    with pytest.raises(LavaError, match='seed'):
        draw_members(SCENE, 4, seed=-1)
    with pytest.raises(LavaError, match=r'scene\.uncertainty'):
        draw_members(Scene(TERRAIN, (VENT,), lava=Lava.paper()), 4)
    # a wrong shape, negative or infinite values, and values only off the terrain
    nowhere = np.zeros((4, 5))
    nowhere[0, 0] = 1.0
    terrain = Terrain(np.where(nowhere, np.nan, 0.0), 1.0)
    for values in (np.ones((5, 4)), -np.ones((4, 5)), np.full((4, 5), np.inf), nowhere):
        with pytest.raises(LavaError, match='susceptibility'):
            Susceptibility(terrain, values)


def test_vents_follow_the_susceptibility_map() -> None:
    likelihood = np.zeros(TERRAIN.shape)
    likelihood[3, 4], likelihood[20, 10:12] = 2.0, 1.0
    likelihood[5, 5] = np.nan
    members = draw_members(SCENE, 256, susceptibility=Susceptibility(TERRAIN, likelihood))
    places = [member.place for member in members if member.place]
    cells = [TERRAIN.cell_at(*place) for place in places]
    assert len(cells) == 256
    for cell, count in (((3, 4), 128), ((20, 10), 64), ((20, 11), 64)):
        assert cells.count(cell) == pytest.approx(count, abs=1)
    inside = np.array(places) % 20.0
    assert inside.mean() == pytest.approx(10.0, abs=0.5)
    assert inside.std() == pytest.approx(20.0 / np.sqrt(12.0), abs=0.5)


def test_fields_have_their_deviation_and_correlation() -> None:
    roughness = Roughness(2.0, 60.0)
    fields = np.stack([random_field((40, 50), 10.0, roughness, (9, k)) for k in range(800)])
    assert fields.std() == pytest.approx(2.0, rel=0.03)
    assert fields.mean() == pytest.approx(0.0, abs=0.1)
    for cells in (3, 6, 9):
        covariance = (fields[:, :, cells:] * fields[:, :, :-cells]).mean()
        assert covariance == pytest.approx(4.0 * np.exp(-((cells / 6.0) ** 2)), abs=0.15)
    assert abs((fields[:, :, 0] * fields[:, :, -1]).mean()) < 0.25


def test_fields_are_reproducible() -> None:
    field = random_field((20, 30), 5.0, Roughness(1.0, 25.0), (1, 2))
    assert hashlib.blake2b(field.tobytes(), digest_size=8).hexdigest() == FIELD
    ground = np.zeros((20, 30))
    ground[0, :3] = np.nan
    rough = rough_terrain(Terrain(ground, 5.0), Roughness(1.0, 25.0), (1, 2))
    assert np.array_equal(np.isnan(rough.elevation), np.isnan(ground))
    assert np.array_equal(rough.elevation[1:], field[1:])


#: 6 x 8 cells of 20 m, in UTM zone 33.
GROUND = Terrain(np.zeros((6, 8)), 20.0, epsg=32633, offset=(500_000.0, 4_180_000.0))


def write(path: Path, values: np.ndarray, **options: Any) -> Path:
    """Write a raster of the terrain's extent, row 0 in the north."""
    known = {'cell': 20.0, 'north_west': (500_000.0, 4_180_120.0), 'nodata': -1.0}
    return write_raster(path, values.astype('float32'), **known | options)


def test_cells_of_a_raster_fill_cells_of_the_terrain(tmp_path: Path) -> None:
    values = np.arange(48.0).reshape(6, 8)
    values[0, 0] = -1.0
    cells = read_raster_on(GROUND, write(tmp_path / 'a.tif', values), field='a')
    expected = np.flipud(np.where(values < 0.0, np.nan, values))
    np.testing.assert_array_equal(cells, expected)
    coarse = write(
        tmp_path / 'b.tif', np.array([[1.0, 2.0], [3.0, 4.0]]),
        transform=from_origin(500_000.0, 4_180_120.0, 80.0, 60.0),
    )
    cells = read_raster_on(GROUND, coarse, field='b')
    np.testing.assert_array_equal(cells, np.kron([[3.0, 4.0], [1.0, 2.0]], np.ones((3, 4))))


def test_raster_in_degrees_is_reprojected(tmp_path: Path) -> None:
    degrees = write(
        tmp_path / 'a.tif', np.ones((1, 1)), crs='EPSG:4326',
        transform=from_origin(14.9, 38.0, 0.1 + 80.0 / 87_900.0, 1.0),
    )
    cells = read_raster_on(GROUND, degrees, field='a')
    assert (cells[:, :4] == 1.0).all() and np.isnan(cells[:, 4:]).all()


def test_outline_is_unknown_where_it_has_no_data(tmp_path: Path) -> None:
    values = np.zeros((6, 8))
    values[0, :3], values[5] = 1.0, -1.0
    lava, known = observed_in_file(write(tmp_path / 'a.tif', values), GROUND)
    assert lava[5, :3].all() and lava.sum() == 3
    assert not known[0].any() and known[1:].all()


def test_cell_with_all_the_likelihood_gets_every_vent(tmp_path: Path) -> None:
    values = np.zeros((6, 8))
    values[1, 2] = 0.3
    path = write(tmp_path / 'a.tif', values)
    places = Susceptibility(GROUND, read_raster_on(GROUND, path, field='--susceptibility'))
    for fraction in (1e-9, 0.5, 1.0 - 1e-9):
        assert GROUND.cell_at(*places.place(fraction, fraction)) == (4, 2)


@pytest.mark.parametrize('crs', ['EPSG:32633', 'EPSG:4326'])
@pytest.mark.parametrize(('west', 'beyond'), [(20.0, 0.0), (110.0, 50.0)])
def test_warns_of_the_part_beyond_the_terrain(
    crs: str, west: float, beyond: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Lava of 100 m x 60 m on a terrain of 160 m x 120 m."""
    x, y = 500_000.0 + west, 4_180_030.0
    ends = [(x, y), (x + 100.0, y), (x + 100.0, y + 60.0), (x, y + 60.0), (x, y)]
    area = transform_geom('EPSG:32633', 'EPSG:4326', {'type': 'Polygon', 'coordinates': [ends]})
    (tmp_path / 'a.geojson').write_text(json.dumps(area))
    lava = np.zeros((40, 60))
    lava[13:19, 20:30] = 1.0
    plain: dict[str, Any] = {'cell': 10.0, 'north_west': (x - 200.0, y + 190.0)}
    if crs == 'EPSG:4326':
        # about 10 m
        width, height = 10.0 / 87_900.0, 10.0 / 111_000.0
        (lon, lat) = area['coordinates'][0][3]
        plain = {'transform': from_origin(lon - 20 * width, lat + 13 * height, width, height)}
    write(tmp_path / 'a.tif', lava, crs=crs, **plain)
    for name in ('a.geojson', 'a.tif'):
        caplog.clear()
        found, _ = observed_in_file(tmp_path / name, GROUND)
        assert found.any()
        warned = [record.getMessage() for record in caplog.records]
        assert len(warned) == bool(beyond)
        for text in warned:
            percent = float(text.partition(': ')[2].partition(' %')[0])
            assert percent == pytest.approx(beyond, abs=10.0) and 'beyond the terrain' in text


def test_likelihood_of_fine_cells_adds_up(tmp_path: Path) -> None:
    """A fissure that is narrower than a cell of the terrain does not fall between the middles."""
    values = np.full((24, 32), -1.0)
    values[:, 9], values[12, 20] = 1.0, 6.0
    path = write(tmp_path / 'a.tif', values, cell=5.0)
    cells = read_raster_on(GROUND, path, field='--susceptibility', method='average')
    expected = np.zeros((6, 8))
    expected[:, 2], expected[2, 5] = 4.0 / 16.0, 6.0 / 16.0
    np.testing.assert_allclose(cells, expected, atol=1e-12)


def test_refuses_unusable_rasters(tmp_path: Path) -> None:
    (tmp_path / 'text.tif').write_text('no raster')
    ones = np.ones((6, 8))
    far = write(tmp_path / 'far.tif', ones, transform=from_origin(0.0, 1000.0, 20.0, 20.0))
    for path in (tmp_path / 'none.tif', tmp_path / 'text.tif', far):
        with pytest.raises(LavaError, match='--observed'):
            observed_in_file(path, GROUND)
    (tmp_path / 'other.tif').write_text('<VRTDataset rasterXSize="8" rasterYSize="6"/>')
    with pytest.raises(LavaError, match='a virtual raster with files of the same folder'):
        observed_in_file(tmp_path / 'other.tif', GROUND)
    flat = write(tmp_path / 'flat.tif', ones, transform=Affine(0.0, 0.0, 5e5, 0.0, -20.0, 4.18e6))
    endless = write(tmp_path / 'nan.tif', ones, transform=Affine(20, 0, math.nan, 0, -20, 4.18e6))
    for path in (flat, endless):
        with pytest.raises(LavaError, match='a georeferenced raster'):
            observed_in_file(path, GROUND)
    here = write(tmp_path / 'here.tif', ones)
    with pytest.raises(LavaError, match='coordinate system'):
        read_raster_on(Terrain(np.zeros((6, 8)), 20.0), here, field='a')
