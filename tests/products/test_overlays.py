# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Features of users' files on a map: extent, styles, names, scale and isochrones."""

import re

from matplotlib.text import Text
import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.layers.frame import Frame
from lava_ros.layers.numbers import duration
from lava_ros.products import plot
from lava_ros.products.overlays import bounds_with_places, hidden, OverlayStyle, REACH
from lava_ros.products.sheet import draw_sheet, Panel
from lava_ros.scene.features import Feature

#: Easting and northing of the origin of the map [m].
OFFSET = (500_000.0, 4_180_000.0)

#: 300 x 400 cells of 10 m with lava on 50 x 50 cells in the centre.
GROUND = np.add.outer(2.0 * np.arange(300.0), np.arange(400.0)).astype(np.float32)
FRAME = Frame(
    GROUND, 10.0, (0.0, 0.0), {}, np.array([[1800.0, 1500.0]]), 60.0,
    {'terrain': {'epsg': 32633, 'offset': list(OFFSET)}},
)
LAVA = np.full(GROUND.shape, np.nan)
LAVA[120:170, 170:220] = np.add.outer(np.arange(50.0), np.arange(50.0)) * 100.0


def feature(kind: str, places: list[tuple[float, float]], name: str = '') -> Feature:
    """Return a feature with coordinates from the origin of the map [m]."""
    return Feature('', kind, (np.add(places, OFFSET),), {'name': name})


@pytest.fixture
def page(monkeypatch):
    """Return a function that lays out a page and returns the axes of its map and all texts."""
    figures = []
    monkeypatch.setattr(
        'lava_ros.products.sheet.save_picture', lambda figure, *_, **__: figures.append(figure)
    )

    def draw(source='thickness', **options):
        draw_sheet([Panel(FRAME, source, LAVA)], 'a.png', title='Lava', **options)
        axes = figures[-1].axes[0]
        return axes, [item.get_text() for item in figures[-1].findobj(Text)]

    return draw


def shows(axes, x, y):
    """Return True if a position is inside the map."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return west <= x <= east and south <= y <= north


def test_map_contains_places_within_reach(page, caplog):
    near, far = (2900.0, 1300.0), (30_000.0, 1300.0)
    villages = [feature('Point', [near], 'near'), feature('Point', [far], 'far')]
    axes, texts = page(overlays={'villages': villages})
    assert shows(axes, *near) and not shows(axes, *far)
    assert 'near' in texts and 'far' not in texts
    assert 'beyond the map: far' in texts
    assert 'villages: 1 of 2 features lie outside' in caplog.text
    axes, _ = page()
    assert not shows(axes, *near)


def test_reach_is_limited_by_terrain_and_size_of_the_lava():
    """Vertices of a road count separately; places off the terrain do not count."""
    bounds, limits = (0.0, 0.0, 100.0, 50.0), (-1000.0, -120.0, 1000.0, 130.0)
    reach = REACH * 100.0
    road = np.array([[99.0 + reach, 20.0], [101.0 + reach, 20.0]])
    gone = [np.array([[50.0, -130.0]]), np.array([[50.0, 140.0]])]
    features = [Feature('', 'LineString', (road,), {}), Feature('', 'Point', gone, {})]
    assert bounds_with_places(bounds, limits, [features]) == (0.0, 0.0, 99.0 + reach, 50.0)


def test_map_contains_the_requested_extent(page):
    for extent in ((100.0, 200.0, 900.0, 700.0), (-500.0, -300.0, 200.0, 200.0)):
        west, south, east, north = extent
        axes, _ = page(extent=(*np.add(extent[:2], OFFSET), *np.add(extent[2:], OFFSET)))
        assert shows(axes, west, south) and shows(axes, east, north)
        # one side is not larger than that of the extent
        assert min(np.ptp(axes.get_xlim()) / (east - west),
                   np.ptp(axes.get_ylim()) / (north - south)) < 1.01


@pytest.mark.parametrize('scale', [10_000.0, 25_000.0])
def test_scale_is_that_of_the_paper(scale, page):
    axes, texts = page(scale=scale)
    box, figure = axes.get_position(), axes.figure
    inches = box.width * figure.get_figwidth(), box.height * figure.get_figheight()
    shown = np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())
    np.testing.assert_allclose(np.divide(shown, inches), 0.0254 * scale, rtol=1e-9)
    assert f'scale: 1:{scale / 1000:g} 000 on A4 paper' in texts


def test_rejects_a_scale_that_is_too_large(page):
    match = r"--scale is '1:500', expected 1:(\d+) or smaller"
    with pytest.raises(LavaError, match=match) as error:
        page(scale=500.0)
    fits = float(error.value.expected.split(' ')[0][2:])
    page(scale=fits)
    with pytest.raises(LavaError, match='--scale'):
        page(scale=0.99 * fits)


@pytest.mark.parametrize('width', [7.0, 31.0, 480.0, 1234.0, 2999.0, 5400.0, 77_000.0])
def test_scale_bar_and_contours_are_round(width):
    length = plot.scale_bar_length(width)
    assert f'{length:e}'[0] in '125' and float(f'{length:.0e}') == length
    assert 0.08 * width < length < 0.33 * width
    frame = Frame(GROUND * np.float32(width / 800.0), 10.0, (0.0, 0.0), {}, FRAME.vents, None, {})
    interval = plot.contour_interval(frame, frame.extent)
    assert f'{interval:e}'[0] in '125' and interval == pytest.approx(float(f'{interval:.0e}'))


def test_legend_has_the_contour_interval(page):
    _, texts = page()
    (entry,) = [text for text in texts if text.startswith('elevation contours')]
    assert re.fullmatch('elevation contours every [125]0* m', entry)
    flat = Frame(np.ones((5, 5), np.float32), 1.0, (0.0, 0.0), {}, np.empty((0, 2)), None, {})
    assert plot.contour_interval(flat, flat.extent) == 0.0


def test_names_of_lines_and_areas_are_on_the_map(page):
    road = feature('LineString', [(1500.0, 1400.0), (2500.0, 1500.0), (90_000.0, 1500.0)], 'road')
    park = feature('Polygon', [(-9e4, -9e4), (9e4, -9e4), (9e4, 9e4), (-9e4, 9e4), (-9e4, -9e4)],
                   'park')
    parts = [feature('LineString', [(1600.0 + x, 1700.0), (1700.0 + 2 * x, 1700.0)], 'track')
             for x in (0.0, 150.0)]
    axes, texts = page(overlays={'roads': [road, *parts], 'parks': [park]})
    assert [texts.count(name) for name in ('road', 'park', 'track')] == [1, 1, 1]
    for label in axes.texts:
        if label.get_text() in ('road', 'park', 'track'):
            assert shows(axes, *label.xy)


def test_features_without_any_part_on_the_map_are_hidden():
    def ring(size):
        return size * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])

    window = (-10.0, -10.0, 10.0, 10.0)
    shown = [
        Feature('', 'LineString', (np.array([[90.0, 0.0], [80.0, 9.0], [9.0, 9.0]]),), {}),
        # no vertex is on the map
        Feature('', 'LineString', (np.array([[90.0, 0.0], [80.0, 0.0], [-80.0, 0.0]]),), {}),
        Feature('', 'Polygon', (ring(90.0),), {}),
        Feature('', 'Polygon', (ring(90.0), ring(9.0)), {}),
    ]
    gone = [
        Feature('', 'Point', (np.array([[11.0, 0.0]]),), {}),
        Feature('', 'LineString', (ring(90.0),), {}),
        # the map is in a hole of the area
        Feature('', 'Polygon', (ring(90.0), ring(80.0)), {}),
    ]
    assert hidden([*shown, *gone], window) == gone


@pytest.mark.parametrize(
    ('kinds', 'marker', 'line'),
    [
        (('Point',), 's', 'None'), (('LineString',), 'None', '--'),
        (('Point', 'Polygon'), 's', '--'),
    ],
)
def test_symbol_of_a_file_has_the_markers_and_lines_of_its_features(kinds, marker, line):
    handle = OverlayStyle.of(1).handle([feature(kind, [(0.0, 0.0)]) for kind in kinds])
    assert (handle.get_marker(), handle.get_linestyle()) == (marker, line)


def test_names_avoid_each_other_and_the_edge(page):
    places = [(1900.0, 1500.0), (1920.0, 1500.0), (1940.0, 1510.0), (2640.0, 1500.0)]
    villages = [feature('Point', [place], f'village {i}') for i, place in enumerate(places)]
    extent = (*np.add((1500.0, 1200.0), OFFSET), *np.add((2650.0, 1900.0), OFFSET))
    axes, _ = page(overlays={'villages': villages}, extent=extent)
    axes.figure.canvas.draw()
    labels = [item for item in axes.texts if item.get_text().startswith('village')]
    boxes = [item.get_window_extent() for item in labels]
    assert len(boxes) == 4
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert all(box.x1 <= axes.get_window_extent().x1 for box in boxes)


@pytest.mark.parametrize('source', ['thickness', 'arrival'])
def test_no_text_of_a_map_overprints_another(source, page):
    rng = np.random.default_rng(2)
    places = rng.uniform((1600.0, 1100.0), (2300.0, 1800.0), (14, 2))
    places[:3] = [(1800.0, 1505.0), (1805.0, 1510.0), (1795.0, 1513.0)]
    villages = [feature('Point', [place], f'village {i}') for i, place in enumerate(places)]
    axes, _ = page(source, overlays={'villages': villages})
    axes.figure.canvas.draw()
    shown = [item for item in axes.texts if item.get_text()]
    boxes = {item: item.get_window_extent() for item in shown}
    clashes = [
        (one.get_text(), other.get_text())
        for index, one in enumerate(shown) for other in shown[:index]
        if boxes[one].overlaps(boxes[other])
    ]
    assert not clashes
    names = [item.get_text() for item in shown]
    assert sum(name.startswith('village') for name in names) == 14
    # names close together have lines to their points
    assert sum(item.arrow_patch is not None for item in axes.texts if not item.get_text()) >= 1


def test_names_without_room_are_left_out_and_logged(page, caplog):
    places = [feature('Point', [(1900.0, 1500.0)], f'place {i}') for i in range(60)]
    _, texts = page(overlays={'places': places})
    shown = [text for text in texts if text.startswith('place ')]
    assert 8 <= len(shown) < 60
    assert 'names that would hide others are not on the map: place ' in caplog.text


def test_each_file_has_its_own_style(page):
    styles = [OverlayStyle.of(number) for number in range(25)]
    assert len({(style.colour, style.marker, str(style.line)) for style in styles}) == 25
    overlays = {
        name: [feature('Point', [(1900.0, 1500.0)])] for name in ('vent', 'a/roads', 'roads')
    }
    axes, _ = page(overlays=overlays)
    (legend,) = axes.figure.legends
    names = [item.get_text() for item in legend.get_texts()]
    # one entry for the vents of the map, one for the file with this name
    assert names.count('vent') == 2 and {'a/roads', 'roads'} <= set(names)


def test_arrival_map_has_isochrones(page):
    axes, texts = page('arrival')
    expected = [duration(time) for time in (1800.0, 3600.0, 5400.0, 7200.0, 9000.0)]
    assert [item.get_text() for item in axes.texts if item.get_text() in expected] == expected
    assert 'isochrones of first arrival' in texts and 'hours after the start' in texts
    _, texts = page()
    assert 'isochrones of first arrival' not in texts


def test_number_of_names_is_limited_with_a_warning(page, caplog, monkeypatch):
    monkeypatch.setattr('lava_ros.products.overlays.MAX_NAMES', 5)
    places = np.random.default_rng(1).uniform(1800.0, 2100.0, (40, 2))
    names = [feature('Point', [place], f'place {i}') for i, place in enumerate(places)]
    _, texts = page(overlays={'places': names})
    assert sum(text.startswith('place ') for text in texts) == 5
    assert 'only 5 of 40 names' in caplog.text
