# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reports as HTML, and their charts."""

import base64
import hashlib
from html.parser import HTMLParser
import json
import math
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree
import zlib

import numpy as np
import pytest

from lava_ros.bag import BagReader
from lava_ros.errors import LavaError
from lava_ros.maps.frames import Recording
from lava_ros.pages.report.charts import (
    Chart,
    charts_of,
    Curve,
    HEIGHT,
    LEFT,
    MAX_POINTS,
    svg,
    ticks,
    time_unit,
    TOP,
    WIDTH,
)
from lava_ros.pages.report.page import page, write_report
from lava_ros.pages.report.sections import facts, warnings
from lava_ros.pages.report.summary import summarize
from lava_ros.pages.runs import read_run
from lava_ros.scene import Terrain
from pages.report.conftest import HOSTILE
import recording
from recording import GRIDS, growing, RAW_CONFIG, record, TERRAIN

ROOT = Path(__file__).parents[3]
SAMPLE = ROOT / 'bags/sample'


class Reader(HTMLParser):
    """Parser of the page of a bag, which checks that all elements are closed.

    Attributes:
        page: The page.
        elements: Names and attributes of all elements.
        texts: Texts of all elements except scripts and styles.
        data: The JSON for the script.
    """

    VOID = frozenset({'meta', 'link', 'input', 'img', 'br'})

    def __init__(self, bag: Path) -> None:
        """Create and parse the page."""
        super().__init__()
        self.page = page(Recording(bag))
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.data: dict[str, Any] = {}
        self._open: list[tuple[str, dict[str, str | None]]] = []
        self.feed(self.page)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Record an element."""
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID and not self.get_starttag_text().endswith('/>'):
            self._open.append((tag, dict(attrs)))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Record an element without content."""
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        """Close the innermost element."""
        assert self._open.pop()[0] == tag

    def handle_data(self, data: str) -> None:
        """Record a text."""
        tag, attributes = self._open[-1] if self._open else ('', {})
        if attributes.get('id') == 'data':
            self.data = json.loads(data)
        elif tag not in ('script', 'style') and data.strip():
            self.texts.append(data.strip())

    def after(self, text: str, count: int) -> list[str]:
        """Return the texts after a text."""
        at = self.texts.index(text) + 1
        return self.texts[at : at + count]


@pytest.fixture(scope='module')
def read(run):
    """Return the parsed page of the run."""
    return Reader(run)


def frames(data: dict[str, Any], name: str) -> np.ndarray:
    """Return the codes of a layer, unpacked like in the script, shape [frames, rows, columns]."""
    (layer,) = [item for item in data['layers'] if item['name'] == name]
    raw = zlib.decompress(base64.b64decode(layer['cells']))
    shape = (len(data['times']), data['rows'], data['columns'])
    return np.bitwise_xor.accumulate(np.frombuffer(raw, np.uint8).reshape(shape), axis=0)


def test_page_is_self_contained(read):
    for _, attributes in read.elements:
        for name in ('src', 'href', 'srcset', 'action'):
            value = attributes.get(name)
            assert value is None or value.startswith('data:')
    assert "default-src 'none'" in read.page
    # requests of style sheets and scripts
    assert re.search(r'@import|url\(|fetch\(|XMLHttpRequest|importScripts', read.page) is None
    for kind in ('script', 'style'):
        # exact text of the only one
        (content,) = re.findall(f'<{kind}>(.*?)</{kind}>', read.page, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in read.page


def test_script_uses_only_existing_elements_and_data(read):
    script = (ROOT / 'lava_ros/pages/report/report.js').read_text(encoding='utf-8')
    ids = set(re.findall(r"byId\('(\w+)'\)", script))
    assert len(ids) >= 7
    assert ids <= {attributes.get('id') for _, attributes in read.elements}
    assert any(attributes.get('name') == 'layer' for _, attributes in read.elements)
    parts = set(re.findall(r'\bdata\.(\w+)', script))
    assert len(parts) >= 12
    assert parts <= set(read.data)
    layer = set(read.data['layers'][0]) | set(read.data['arrival'])
    charts = set(read.data['charts'][0])
    assert set(re.findall(r'\bitem\.(\w+)', script)) <= layer | charts


def test_page_escapes_texts_of_the_bag(read):
    assert sum('window.broken' in item for item in read.texts) >= 2
    assert any(HOSTILE in item for item in read.texts)
    assert not any(tag == 'img' for tag, _ in read.elements)
    assert sum(tag == 'script' for tag, _ in read.elements) == 2


def test_maps_equal_the_recorded_grids(read):
    data = read.data
    assert data['times'] == [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0, 1400.0, 1600.0]
    height = frames(data, 'thickness')
    (layer,) = [item for item in data['layers'] if item['name'] == 'thickness']
    row = round((data['south'] - 20.0) / 5.0)
    column = round((data['west'] + 50.0) / 5.0)
    part = (slice(row, row + data['rows']), slice(column, column + data['columns']))
    for index, time in enumerate(data['times']):
        expected = np.where(TERRAIN.has_data, growing(time), 0.0)[part]
        shown = np.where(height[index] > 0, layer['low'] + height[index] * layer['step'], 0.0)
        np.testing.assert_allclose(shown, expected, atol=0.051)
        np.testing.assert_array_equal(shown > 0.0, expected > 0.0)
    assert (frames(data, 'hazard')[-1] == 100).sum() == 160


def test_arrival_is_never_late(read):
    arrival = read.data['arrival']
    raw = zlib.decompress(base64.b64decode(arrival['cells']))
    codes = np.frombuffer(raw, '<u2').reshape(read.data['rows'], read.data['columns'])
    times = arrival['start'] + (codes.astype(float) - 1.0) * arrival['step']
    reached = np.unique(times[codes > 0])
    expected = np.arange(200.0, 1601.0, 200.0)
    assert (reached <= expected).all()
    np.testing.assert_allclose(reached, expected, atol=1.01 * arrival['step'])


def test_curves_have_the_values_of_the_frames(read):
    charts = {item['key']: item['curves'] for item in read.data['charts']}
    times = charts['area'][0]['times']
    columns = [int(time / 100.0) for time in times]
    assert charts['area'][0]['values'] == [250.0 * count for count in columns]
    volumes = [round(float(growing(time).sum()) * 25.0, 1) for time in times]
    for curve in charts['volume'][:2]:
        assert curve['values'] == pytest.approx(volumes, rel=1e-4)
    # from the vent in the centre of the first column to the corner of the last column
    tip = np.hypot(5.0 * (columns[-1] - 1), 22.5)
    assert charts['front'][0]['values'][-1] == pytest.approx(tip, rel=1e-4)
    assert charts['front'][0]['values'][0] is None
    # exact, although grids have steps of 12 degrees
    hot = [900.0 - 0.1 * time if count else None
           for time, count in zip(times, columns, strict=True)]
    assert charts['temperature'][0]['values'] == pytest.approx(hot, abs=0.01)


def test_temperature_curve_of_old_bags_is_that_of_their_maps(tmp_path, monkeypatch):
    original = recording.diagnostics_of

    def without(snapshot, stamp_ns):
        message = original(snapshot, stamp_ns)
        (status,) = message.status
        status.values = [item for item in status.values if 'temperature' not in item.key]
        return message

    monkeypatch.setattr(recording, 'diagnostics_of', without)
    path = record(tmp_path / 'old', config=GRIDS)
    chart = charts_of(Recording(path), summarize(Recording(path)))[-1]
    (curve,) = chart.curves
    assert curve.values[1] == pytest.approx(860.0, abs=6.1) and curve.values[1] % 12.0 == 0.0


def test_barriers_are_on_the_map(tmp_path):
    scene = '{terrain: {offset: [100.0, 200.0], barriers: [[[110.0, 220.0], [150.0, 260.0]]]}}'
    found = Reader(record(tmp_path / 'dam', custom_data={'scene': scene}))
    assert found.data['barriers'] == [[[10.0, 20.0], [50.0, 60.0]]]


def test_page_lists_effects_and_accuracy(read):
    assert read.after('cooling', 2) == ['on', 'heat lost = 2.5 > 0.01']
    assert read.after('Changes during the run', 8)[4:] == ['5 min', 'crust', 'on', 'forced']
    assert any(item.startswith('standard: For maps') for item in read.texts)
    assert float(*read.after('particles across the flow', 1)) > 1.0
    assert read.after('numerical error', 1) == ['15 % of the inundated area']
    assert {'-1', 'lethal lava: 0.5 m or more, or 300 °C or more'} <= set(read.texts)


def test_page_warns_if_the_bag_was_cut_off(tmp_path):
    bag = record(tmp_path / 'bag', close=False)
    assert BagReader(bag).recovered
    read = Reader(bag)
    alerts = [item for tag, item in read.elements if item.get('role') == 'alert']
    assert len(alerts) == 3
    assert read.texts.index('Simulation, not verified.') < read.texts.index('simulated')
    assert read.texts.index(
        'The recording was cut off: data after its last complete message are lost.'
    ) < read.texts.index('simulated')


def test_picture_and_page_agree(tmp_path):
    def flow(time: float) -> np.ndarray:
        thickness = growing(time)
        thickness[12, :8] = 0.05
        thickness[14, 0] = 7.2 if time < 800.0 else 41.3
        return thickness

    bag = record(tmp_path / 'bag', flow=flow)
    frame = Recording(bag).frame_at()
    rows = dict(facts(Recording(bag), summarize(Recording(bag))))
    # 10 rows of 8 columns without the row that is too thin
    assert frame.area(frame.standing) == 72 * 25.0
    assert rows['standing lava, 0.1 m or more'] == '1800 m²'
    # without arrival times, drained cells are unknown
    assert frame.inundated is None and not any('inundated' in name for name in rows)
    assert rows['maximum thickness'] == '41.3 m'
    assert Reader(bag).after('5 m or more', 2) == ['over a roof', '25 m²']
    assert read_run(bag).summary == '1800 m² standing lava  ·  up to 41.3 m thick'
    assert not any('thicker in places' in item for item in warnings(
        Recording(bag), summarize(Recording(bag))))


def test_unrounded_layers_are_packed_in_250_steps(tmp_path):
    read = Reader(record(tmp_path / 'bag', config=RAW_CONFIG))
    (layer,) = [item for item in read.data['layers'] if item['name'] == 'thickness']
    assert layer['step'] == pytest.approx(3.26 / 250.0, rel=1e-5)
    assert frames(read.data, 'thickness').max() == 250


def test_page_of_a_large_run_combines_cells_and_frames(tmp_path, monkeypatch):
    """Combined cells have their maximum."""
    monkeypatch.setattr('lava_ros.pages.report.summary.MAX_CELLS', 900)
    monkeypatch.setattr('lava_ros.pages.report.summary.MAX_FRAMES', 12)
    terrain = Terrain(np.add.outer(np.arange(31.0), np.arange(51.0)), 5.0, TERRAIN.origin, 32633)

    def flow(time: float) -> np.ndarray:
        thickness = np.zeros(terrain.shape, dtype=np.float32)
        thickness[1:30, 1 : 1 + int(time)] = 1.0
        thickness[21, 48] = 9.0
        return thickness

    times = [2.0 * index for index in range(14)]
    read = Reader(record(tmp_path / 'bag', times, flow=flow, terrain=terrain, config=GRIDS))
    assert read.data['cell'] == 10.0
    assert read.data['rows'] * read.data['columns'] <= 900
    assert len(read.data['times']) <= 12
    assert (read.data['times'][0], read.data['times'][-1]) == (0.0, 26.0)
    assert (frames(read.data, 'thickness') == 90).any(axis=(1, 2)).all()


def test_page_without_lava_shows_the_whole_terrain(tmp_path):
    bag = record(tmp_path / 'bag', flow=lambda time: np.zeros(TERRAIN.shape, dtype=np.float32))
    read = Reader(bag)
    assert (read.data['rows'], read.data['columns']) == (30, 40)
    assert read.data['arrival'] is None


def test_report_needs_simulated_times(tmp_path):
    with pytest.raises(LavaError, match='/diagnostics of the node'):
        page(Recording(record(tmp_path / 'bag', clock=False)))


@pytest.mark.parametrize('name', ['report.pdf', 'missing/report.html'])
def test_rejects_an_output_that_cannot_be_written(run, tmp_path, name):
    with pytest.raises(LavaError, match='output is '):
        write_report(run, tmp_path / name)


def test_page_of_the_sample_bag(tmp_path):
    read = Reader(SAMPLE)
    size = write_report(SAMPLE, tmp_path / 'report.html')
    assert (tmp_path / 'report.html').read_text(encoding='utf-8') == read.page
    assert 50_000 < size == len(read.page.encode()) < 250_000
    assert read.data['epsg'] == 26710
    assert 'The bag does not contain the effects.' not in read.texts
    assert 'solidification' in read.texts


def drawn(chart: Chart, start: float, end: float) -> ElementTree.Element:
    """Parse a chart, which must be well-formed XML."""
    return ElementTree.fromstring(svg(chart, start, end))


def test_curve_points_match_values():
    """The first point is at the lower left, the last at the upper right; NaN leaves a gap."""
    curve = Curve('a', [0.0, 3600.0, 7200.0, 10800.0], [0.0, 1.0, math.nan, 4.0])
    tree = drawn(Chart('area', 'Area', 'm²', [curve]), 0.0, 10800.0)
    (path,) = [item.get('d') for item in tree.iter('path')]
    assert path is not None
    pens = re.findall('[ML]', path)
    points = [tuple(map(float, item.split())) for item in re.split('[ML]', path)[1:]]
    assert pens == ['M', 'L', 'M']
    assert points[0] == (LEFT, HEIGHT - 34.0)
    assert points[-1] == (WIDTH - 12.0, TOP)
    texts = [item.text for item in tree.iter('text')]
    assert 'simulated time [h]' in texts
    assert {'0', '1', '2', '3', '4'} <= set(texts)


def test_chart_escapes_labels():
    name = '"><script>'
    tree = drawn(Chart(name, name, name, [Curve(name, [0.0, 1.0], [1.0, 2.0])]), 0.0, 1.0)
    assert [item.tag for item in tree.iter() if 'script' in item.tag] == []
    assert name in (tree.get('aria-label') or '')


@pytest.mark.parametrize('values', [[0.0, 0.0], [math.nan, math.nan], [5.0, 5.0]])
def test_draws_constant_and_empty_curves(values):
    assert len(drawn(Chart('a', 'A', 'm', [Curve('a', [0.0, 1.0], values)]), 0.0, 1.0)) > 3
    assert len(drawn(Chart('a', 'A', 'm', [Curve('a', [0.0], [1.0])]), 0.0, 0.0)) > 3


@pytest.mark.parametrize(('low', 'high', 'expected'), [
    (0.0, 2.8, [0.0, 1.0, 2.0]),
    (0.0, 100.0, [0.0, 25.0, 50.0, 75.0, 100.0]),
    (1100.0, 1200.0, [1100.0, 1125.0, 1150.0, 1175.0, 1200.0]),
    (3.0, 3.0, [3.0]),
])
def test_ticks_are_round_numbers(low, high, expected):
    assert ticks(low, high, 4) == expected


def test_thinned_curve_keeps_its_ends():
    times = np.arange(5000.0).tolist()
    few = Curve('a', times, times).thinned()
    assert len(few) <= MAX_POINTS
    assert (few[0], few[-1]) == ((0.0, 0.0), (4999.0, 4999.0))


@pytest.mark.parametrize(
    ('span', 'name'), [(60.0, 's'), (600.0, 'min'), (7200.0, 'h'), (300_000.0, 'd')]
)
def test_time_unit_suits_the_span(span, name):
    assert time_unit(span)[1] == name
