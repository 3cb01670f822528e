# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pictures of maps, printed pages, and numbers for people."""

from dataclasses import replace
from pathlib import Path
import re
from typing import Any

from matplotlib.image import imread
from matplotlib.text import Text
import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.layers.frame import Frame, LayerFrame
from lava_ros.layers.layer import IMAGE, Layer
from lava_ros.layers.numbers import duration, percent, seconds
from lava_ros.products.colours import scale_of
from lava_ros.products.plot import barriers_of, shaded_ground
from lava_ros.products.sheet import draw_sheet, Panel


@pytest.mark.parametrize(('source', 'values', 'label', 'top', 'past'), [
    ('thickness', [0.1, 2.2], 'm', 3.0, 'neither'),
    ('thickness', [*[1.0] * 999, 80.0], 'm', 1.0, 'max'),
    ('arrival', [90.0, 100.0], 's', 100.0, 'neither'),
    ('arrival', [60.0, 5.0 * 3600.0], 'h', 5.0, 'neither'),
    ('arrival', [86_400.0 * 9.5], 'd', 10.0, 'neither'),
    ('probability', [3.0], '%', 100.0, 'neither'),
    ('temperature', [], '°C', 100.0, 'neither'),
])
def test_scales_end_at_round_numbers(source, values, label, top, past):
    scale = scale_of(source, np.array([*values, np.nan]))
    assert (scale.label, scale.norm.vmax, scale.past) == (label, top, past)


@pytest.fixture
def frame():
    """Return a flow of 20 x 6 cells on a slope with no-data cells."""
    elevation = np.add.outer(np.arange(60.0), np.arange(90.0)).astype(np.float32)
    elevation[:, 80] = np.nan
    layers = {}
    for source, value in (('thickness', 4.0), ('temperature', 800.0), ('hazard', 100.0)):
        values = np.full(elevation.shape, np.nan, dtype=np.float32)
        values[30:50, 40:46] = value
        layers[source] = LayerFrame(Layer(source, source, source, IMAGE), values, False)
    vents, scene = np.array([[430.0, 480.0]]), {'terrain': {'epsg': 32633}}
    return Frame(elevation, 10.0, (0.0, 0.0), layers, vents, 5400.0, scene)


def test_arrival_times_differ_in_grey():
    scale = scale_of('arrival', np.array([0.0, 36_000.0]))
    red, green, blue, _ = scale.colours(np.linspace(0.0, 1.0, 12)).T
    grey = 0.2126 * red**2.2 + 0.7152 * green**2.2 + 0.0722 * blue**2.2
    # the lightness of CIE 1976, of which one can see a difference of 2
    assert np.diff(116.0 * np.cbrt(grey) - 16.0).min() > 3.0


def test_sea_is_blue_and_shaded(frame):
    sea = replace(frame, scene={'terrain': {'sea_level': 40.0}})
    ground, coast = shaded_ground(frame), shaded_ground(sea)
    is_sea = frame.elevation <= 40.0
    assert 500 < is_sea.sum() < is_sea.size
    assert (coast[is_sea][:, 2] > 1.2 * coast[is_sea][:, 0]).all()
    np.testing.assert_array_equal(coast[~is_sea], ground[~is_sea])


def test_barriers_are_drawn_in_map_coordinates(frame, tmp_path):
    line = [[500100.0, 4180200.0], [500300.0, 4180250.0]]
    place = {'epsg': 32633, 'offset': [500000.0, 4180000.0], 'barriers': [line]}
    dammed = replace(frame, scene={'terrain': place})
    assert [crest.tolist() for crest in barriers_of(dammed)] == [[[100.0, 200.0], [300.0, 250.0]]]
    plot_frame(dammed, tmp_path / 'a.svg')
    assert '<!-- barrier -->' in (tmp_path / 'a.svg').read_text()
    # bags of other programs may contain anything
    for barriers in ([], 'all along', [[[1.0, 2.0]]]):
        assert barriers_of(replace(frame, scene={'terrain': place | {'barriers': barriers}})) == []


def plot_frame(frame: Frame, output: Path) -> None:
    """Draw all layers of a frame."""
    panels = [Panel(frame, name, item.values) for name, item in frame.layers.items()]
    draw_sheet(panels, output, title='Lava', notes={'discharge': '5 m³/s'})


def red(path: Path) -> int:
    """Count the pixels as red as lethal hazard."""
    pixels = imread(path)[:, :, :3]
    found = (pixels[..., 0] > 0.4) & (pixels[..., 1] < 0.12) & (pixels[..., 2] < 0.25)
    return int(found.sum())


def test_lava_has_the_colour_of_its_hazard(frame, tmp_path):
    hazard = frame.layers['hazard']
    plot_frame(replace(frame, layers={'hazard': hazard}), tmp_path / 'wet.png')
    dry = {'hazard': replace(hazard, values=np.full_like(hazard.values, np.nan))}
    plot_frame(replace(frame, layers=dry, vents=np.empty((0, 2))), tmp_path / 'dry.png')
    assert red(tmp_path / 'wet.png') > red(tmp_path / 'dry.png') + 10_000
    assert (tmp_path / 'wet.png').stat().st_size < 800_000


@pytest.fixture
def texts(monkeypatch):
    """Return the list of texts in the drawn pictures."""
    written: list[str] = []

    def keep(figure: Any, path: Path, **_: str) -> None:
        figure.canvas.draw()
        written.extend(item.get_text() for item in figure.findobj(Text))

    monkeypatch.setattr('lava_ros.products.sheet.save_picture', keep)
    return written


def test_page_has_the_elements_of_a_published_map(frame, texts):
    scene = {'terrain': {'epsg': 32633, 'offset': [500_000.0, 4_180_000.0]}}
    plot_frame(replace(frame, scene=scene), Path('all.png'))
    for words in ('SIMULATION, NOT VERIFIED', 'N', 'easting [m]', 'northing [m]', 'm', '°C',
                  'Lava thickness', 'discharge: 5 m³/s', 'vent'):
        assert words in texts, words
    east = [int(item.replace(' ', '')) for item in texts if re.fullmatch('500 [0-9]{3}', item)]
    assert len(set(east)) > 1 and all(value % 100 == 0 for value in east)
    assert any(item.endswith('° E') for item in texts) and any('° N' in item for item in texts)
    assert any(re.fullmatch('[0-9]+ m', item) for item in texts)
    # the 180th meridian is at an easting of 180,211 m
    texts.clear()
    scene = {'terrain': {'epsg': 32701, 'offset': [179_781.0, 8_140_148.0]}}
    plot_frame(replace(frame, scene=scene), Path('all.png'))
    assert {'180.000°', '16.798° S'} <= {*texts}
    # a map without a coordinate system has the coordinates of the map frame
    texts.clear()
    plot_frame(replace(frame, scene={}), Path('all.png'))
    assert 'x [m], map frame' in texts and not any('° E' in item for item in texts)
    # a map outside the domain of its projection has no degrees
    texts.clear()
    scene = {'terrain': {'epsg': 32633, 'offset': [1e8, 4_180_000.0]}}
    plot_frame(replace(frame, scene=scene), Path('all.png'))
    assert 'easting [m]' in texts and not any('° E' in item for item in texts)


def test_maps_of_one_page_show_the_same_area(frame, tmp_path, monkeypatch):
    windows = []
    monkeypatch.setattr(
        'lava_ros.products.plot.draw_map', lambda axes, frame, picture, window: (
            axes.set_xlim(window[0], window[2]), axes.set_ylim(window[1], window[3]),
            windows.append(window),
        ),
    )
    panels = [
        Panel(
            replace(frame, scene={'terrain': {'epsg': 32633, 'offset': [east, 0.0]}}),
            'hazard', frame.layers['hazard'].values,
        )
        for east in (500_000.0, 500_100.0)
    ]
    draw_sheet(panels, tmp_path / 'two.png', title='Two')
    np.testing.assert_allclose(np.subtract(*windows), [100.0, 0.0, 100.0, 0.0], atol=1e-6)
    # both flows are in it
    assert windows[0][0] <= 400.0 and windows[0][2] >= 560.0


def test_rejects_a_picture_that_cannot_be_written(frame, tmp_path):
    for name in ('missing/a.png', 'a.lava'):
        with pytest.raises(LavaError, match=f'output is .*{name}'):
            plot_frame(frame, tmp_path / name)


@pytest.mark.parametrize(('format_value', 'value', 'text'), [
    *[(duration, 0.0, '0 s'), (duration, 119.0, '119 s'), (duration, 300.0, '5 min')],
    *[(duration, 7200.0, '2 h'), (duration, 20_400.0, '5 h 40 min')],
    (duration, 2.75 * 86_400.0, '2 d 18 h'),
    *[(seconds, 0.0123, '12 ms'), (seconds, 3.21, '3.2 s'), (seconds, 59.6, '60 s')],
    *[(seconds, 1800.0, '30 min'), (seconds, 9000.0, '2.5 h')],
    *[(percent, 0.0345, '3.5 %'), (percent, 0.25, '25 %'), (percent, 1.0, '100 %')],
    *[(percent, 2e-7, '2e-07'), (percent, 0.0, '0 %'), (percent, float('nan'), 'none')],
])
def test_numbers_have_two_digits_and_a_suitable_unit(format_value, value, text):
    assert format_value(value) == text
