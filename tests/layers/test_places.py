# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Places on the cells of a terrain, and arrival of lava there."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.layers import places as places_module
from lava_ros.layers.forecast import EnsembleForecast, Forecast, HazardMaps, PlaceForecast
from lava_ros.layers.place_arrivals import arrivals, ArrivalTable, COLUMNS, live_arrivals
from lava_ros.layers.places import front_distances, Places, places_on
from lava_ros.scene import Terrain
from lava_ros.scene.features import Feature
from lava_ros.simulation.output.snapshot import Snapshot
from recording import snapshot_at

ROWS, COLUMNS_, CELL = 8, 10, 10.0

#: Ground with a no-data corner; map coordinates differ from projected coordinates.
GROUND = Terrain(
    np.where(np.add.outer(np.arange(ROWS), np.arange(COLUMNS_)) < 1, np.nan, 100.0),
    CELL, origin=(-20.0, 30.0), epsg=32633, offset=(500_000.0, 4_180_000.0),
)


def feature(
    kind: str, *rings: list[tuple[float, float]], name: str = '', where: str = ''
) -> Feature:
    """Return a feature with coordinates from the lower-left corner of the ground [m]."""
    corner = np.add(GROUND.origin, GROUND.offset)
    return Feature(
        where or f'a.geojson, {name or kind}', kind,
        tuple(np.array(ring, dtype=float) + corner for ring in rings), {'name': name},
    )


def place(kind: str, *rings: list[tuple[float, float]], **known: str) -> Places:
    """Return a single feature on the cells of the ground."""
    return places_on([feature(kind, *rings, **known)], GROUND)


def box(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float]]:
    """Return the corners of a rectangle."""
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]


def sizes(found: Places) -> dict[tuple[int, int], float]:
    """Return the length or area in each cell, by row and column."""
    result: dict[tuple[int, int], float] = {}
    for row, column, size in zip(found.rows, found.columns, found.sizes, strict=True):
        result[int(row), int(column)] = result.get((int(row), int(column)), 0.0) + float(size)
    return result


def test_line_has_its_length_in_each_cell_that_it_crosses() -> None:
    found = place('LineString', [(5.0, 15.0), (25.0, 15.0), (25.0, 45.0)])
    assert sizes(found) == pytest.approx({
        (1, 0): 5.0, (1, 1): 10.0, (1, 2): 10.0, (2, 2): 10.0, (3, 2): 10.0, (4, 2): 5.0,
    })
    assert found.whole == pytest.approx([50.0]) and found.off_map.tolist() == [0.0]


def test_area_has_its_overlap_with_each_cell() -> None:
    tiny = place('Polygon', box(11.0, 12.0, 12.0, 14.0))
    assert sizes(tiny) == pytest.approx({(1, 1): 2.0})
    holed = place('Polygon', box(10.0, 10.0, 40.0, 40.0), box(20.0, 20.0, 30.0, 25.0))
    assert sizes(holed).pop((2, 2)) == pytest.approx(50.0)
    assert sum(sizes(holed).values()) == pytest.approx(850.0) == holed.whole[0]
    triangle = place('Polygon', [(10.0, 10.0), (30.0, 10.0), (10.0, 30.0), (10.0, 10.0)])
    assert sizes(triangle) == pytest.approx({(1, 1): 100.0, (1, 2): 50.0, (2, 1): 50.0})


@pytest.mark.parametrize('seed', range(6))
def test_overlap_agrees_with_a_fine_count(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Random stars in both directions extend beyond the grid on all sides."""
    # computes in bands of a few rows
    monkeypatch.setattr(places_module, '_MAX_BAND_CELLS', 25)
    draw = np.random.default_rng(seed)
    angles = np.sort(draw.uniform(0.0, 2.0 * np.pi, 9))[:: 1 if seed % 2 else -1]
    radii = draw.uniform(20.0, 60.0, 9)
    corners = np.stack([50.0 + radii * np.cos(angles), 40.0 + radii * np.sin(angles)], axis=1)
    ring = [*map(tuple, corners), tuple(corners[0])]
    fine = 20
    x, y = ((np.arange(count * fine) + 0.5) * CELL / fine for count in (COLUMNS_, ROWS))
    inside = np.zeros((len(y), len(x)), dtype=bool)
    for (x0, y0), (x1, y1) in pairwise(ring):
        crosses = (y0 > y[:, None]) != (y1 > y[:, None])
        with np.errstate(divide='ignore', invalid='ignore'):
            inside ^= crosses & (x[None, :] < x0 + (y[:, None] - y0) * (x1 - x0) / (y1 - y0))
    expected = inside.reshape(ROWS, fine, COLUMNS_, fine).mean(axis=(1, 3)) * CELL**2
    found = np.zeros((ROWS, COLUMNS_))
    for cell, size in sizes(place('Polygon', ring)).items():
        found[cell] = size
    expected[0, 0] = 0.0
    assert np.abs(found - expected).max() < 6.0
    assert found.sum() == pytest.approx(expected.sum(), rel=0.01)


def test_parts_of_a_feature_are_one_place_and_names_differ() -> None:
    parts = [
        feature('Polygon', box(10.0, 10.0, 20.0, 20.0), name='Nicolosi', where='a, 1'),
        feature('Polygon', box(40.0, 40.0, 50.0, 50.0), name='Nicolosi', where='a, 1'),
        feature('Point', [(5.0, 15.0)], name='hut', where='a, 2'),
        feature('Point', [(5.0, 25.0)], name='hut', where='a, 3'),
        feature('Point', [(5.0, 35.0)], where='a, 4'),
    ]
    found = places_on(parts, GROUND)
    assert found.names == ('Nicolosi', 'hut', 'hut (2)', 'point 4')
    assert found.kinds == ('area', 'point', 'point', 'point')
    assert found.whole.tolist() == [200.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize(('found', 'off_map'), [
    (place('Point', [(-5.0, 5.0)]), 1.0),
    (place('Point', [(1e8, 5.0)]), 1.0),
    # no-data cell
    (place('Point', [(5.0, 5.0)]), 1.0),
    (place('LineString', [(-30.0, 15.0), (10.0, 15.0)]), 0.75),
    (place('Polygon', box(-1e6, 10.0, 1e6, 20.0)), 1.0 - 1e2 / 2e6),
    (place('Polygon', box(-50.0, -50.0, -10.0, -10.0)), 1.0),
    (place('Polygon', box(0.0, 0.0, 20.0, 10.0)), 0.5),
])
def test_places_off_the_map_have_no_arrival(found: Places, off_map: float) -> None:
    assert found.off_map == pytest.approx([off_map])
    dry = np.full(GROUND.shape, np.nan)
    quantiles = dict.fromkeys((0.1, 0.5, 0.9), found.at(dry))
    (row,) = arrivals(found, quantiles, quantiles)
    assert row.is_known is (off_map < 1.0)
    assert (row.probability is None) is (off_map == 1.0)
    assert ('off the map' in row.map_words()) is (off_map > 0.0)
    texts = ArrivalTable((row,), {'inundation_threshold_m': 0.1}, is_ensemble=False).as_texts()[1]
    assert ('not reached' in texts) is (off_map < 1.0)


@pytest.mark.parametrize(('wrong', 'words'), [
    (feature('LineString', [(5.0, 5.0), (5.0, 5.0)], name='road'), 'road is .a line of size 0'),
    (feature('LineString', [(5.0, 5.0)], name='road'), 'at least two different points'),
    (feature('Polygon', box(5.0, 5.0, 5.0, 25.0), name='farm'), 'farm is .*an area above 0'),
])
def test_rejects_features_without_a_size(wrong: Feature, words: str) -> None:
    with pytest.raises(LavaError, match=words):
        places_on([feature('Point', [(5.0, 15.0)]), wrong], GROUND)


def test_distances_are_those_of_the_nearest_inundated_cell() -> None:
    inundated = np.zeros(GROUND.shape, dtype=bool)
    inundated[2:6, 1:4] = True
    found = places_on([
        feature('Point', [(65.0, 35.0)], name='east'),
        feature('Point', [(-265.0, 35.0)], name='off the map'),
        feature('Point', [(25.0, 42.0)], name='inside'),
        feature('LineString', [(65.0, -100.0), (65.0, 100.0)], name='road past it'),
        feature('Polygon', box(95.0, 75.0, 99.0, 79.0), name='farm'),
    ], GROUND)
    expected = [30.0, 280.0, 0.0, 30.0, np.hypot(60.0, 20.0)]
    assert front_distances(found, inundated, GROUND) == pytest.approx(expected)
    assert np.isnan(front_distances(found, np.zeros(GROUND.shape, dtype=bool), GROUND)).all()


def flow() -> np.ndarray:
    """Return arrival times [s] of lava that flows from the left along two rows."""
    times = np.full(GROUND.shape, np.nan, dtype=np.float32)
    times[3:5, :6] = 100.5 * np.arange(1, 7)
    return times


def test_table_has_the_first_arrival_at_each_place() -> None:
    found = places_on([
        feature('Point', [(25.0, 35.0)], name='hut'),
        feature('LineString', [(45.0, 5.0), (45.0, 75.0)], name='road'),
        feature('Polygon', box(52.0, 45.0, 72.0, 55.0), name='farm'),
        feature('Point', [(95.0, 35.0)], name='far'),
    ], GROUND)
    times = flow()
    # half of each cell is inundated
    parts = 0.5 * np.isfinite(times)
    both = (dict.fromkeys((0.1, 0.5, 0.9), found.at(one)) for one in (times, parts))
    rows = arrivals(found, *both)
    data: list[dict[str, Any]] = ArrivalTable(rows, {}, is_ensemble=False).as_dict()['places']
    assert [item['arrival_p50_s'] for item in data] == [301.5, 502.5, 603.0, None]
    assert [item['probability_percent'] for item in data] == [100.0, 100.0, 100.0, 0.0]
    assert data[1]['inundated_length_p10_m'] == pytest.approx(0.5 * 20.0)
    assert data[2]['inundated_area_p90_m2'] == pytest.approx(0.5 * 8.0 * 5.0)
    assert data[2]['area_m2'] == pytest.approx(200.0)
    assert {key for item in data for key in item} == set(COLUMNS)
    head, *lines = ArrivalTable(rows, {}, is_ensemble=False).as_csv().splitlines()
    assert head == ','.join(COLUMNS) and len(lines) == 4
    assert lines[3].startswith('far,point,0.0,0.0,0 %,,,,')


def snapshot(time: float) -> Snapshot:
    """Return the flow at a time, with the arrival times so far."""
    times = flow()
    arrived = np.where(times <= time, times, np.nan).astype(np.float32)
    thickness = np.where(np.isfinite(arrived), 1.0, 0.0).astype(np.float32)
    inundated = np.isfinite(arrived).astype(np.float32)
    return replace(snapshot_at(time, thickness, GROUND), arrived=arrived, inundated=inundated)


PLACES = places_on([
    feature('Point', [(5.0, 35.0)], name='reached'),
    feature('Point', [(45.0, 35.0)], name='ahead'),
    feature('Point', [(95.0, 35.0)], name='beyond'),
    feature('Point', [(-95.0, 35.0)], name='away'),
], GROUND)


def test_live_table_without_a_forecast_has_past_arrivals_and_distances() -> None:
    live = live_arrivals(PLACES, snapshot(250.0))
    assert live.reached == (True, False, False, False) and live.source == 'none'
    assert [row.probability for row in live.rows] == [100.0, None, None, None]
    assert live.words(0) == 'lava arrived 2 min ago'
    assert live.words(1) == 'no lava yet, and no forecast; the front is 30 m away'
    assert live.words(3) == 'off the map: nothing is known'
    assert live.summary == 'no lava yet at any place, and no forecast'


def test_live_table_prefers_past_arrivals_to_a_forecast() -> None:
    ahead = (flow() - 200.0).clip(0.0)
    forecast = Forecast(
        200.0, 400.0, 0.01, GROUND, ahead, ahead, ahead, ahead, duration=1.0, particle_count=1
    )
    live = live_arrivals(PLACES, snapshot(250.0), forecast)
    assert [row.arrival[0.5] for row in live.rows] == [100.5, 502.5, None, None]
    assert [row.probability for row in live.rows] == [100.0, 100.0, 0.0, None]
    assert live.values(1)['time_to_arrival_p50_s'] == 252.5
    assert live.words(1) == 'lava arrives in 4 min; the front is 30 m away'
    assert live.words(2) == 'no lava within 6 min; the front is 80 m away'


def test_live_table_of_an_ensemble_has_its_probabilities_and_times() -> None:
    nan = np.nan
    cells = {part: flow() - 200.0 + 60.0 * index for index, part in enumerate((0.1, 0.5, 0.9))}
    cells[0.9][:, 4:] = nan
    maps = HazardMaps(
        probability=np.zeros(GROUND.shape), arrival=cells, inundated=cells,
        thickness=np.zeros(GROUND.shape), members=5, effective_members=5.0, arrival_error=1.0,
        places=PlaceForecast(
            np.array([100.0, 60.0, 0.0, 0.0]),
            {
                part: np.array([0.0, float(times[3, 4]), nan, nan])
                for part, times in cells.items()
            },
            np.array([0.0, float(cells[0.1][3, 4]) - 30.0, nan, nan]),
        ),
    )
    ensemble = EnsembleForecast(200.0, 400.0, 0.1, GROUND, maps, 5, True, 0, 1.0)
    live = live_arrivals(PLACES, snapshot(250.0), None, ensemble)
    assert live.source == 'ensemble' and live.end == 600.0
    assert live.rows[0].arrival == {0.1: 100.5, 0.5: 100.5, 0.9: 100.5}
    assert live.rows[1].arrival == {0.1: 502.5, 0.5: 562.5, 0.9: None}
    assert live.words(1) == (
        'lava arrives with a probability of 60 %, in 4 min (10 %), 5 min (50 %); '
        'the front is 30 m away'
    )
    assert (live.rows[2].probability, live.rows[3].probability) == (0.0, None)
    # none of 5 is below 1 / 6, and lava that is there is certain
    assert live.words(2) == (
        'lava arrives with a probability below 17 % within 6 min; the front is 80 m away'
    )
    assert [row.probability_words for row in live.rows] == ['100 %', '60 %', 'below 17 %', None]
    assert [row.earliest for row in live.rows] == [100.5, 472.5, None, None]
