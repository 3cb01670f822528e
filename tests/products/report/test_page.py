# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Reports of bags as HTML, and their charts."""

from dataclasses import replace
from html.parser import HTMLParser
import math
from pathlib import Path
import re
from urllib.request import urlopen
from xml.etree import ElementTree

from matplotlib.image import imread
import numpy as np
import pytest

from lava_ros.bag import BagReader
from lava_ros.errors import LavaError
from lava_ros.layers.recording import Recording
from lava_ros.products.page_layout import Imprint
from lava_ros.products.report.charts import Chart, charts_of, Curve
from lava_ros.products.report.page import write_report
from lava_ros.products.report.sections import depth_table, facts, warnings
from lava_ros.products.report.summary import summarize
from lava_ros.products.run_page import read_run
from lava_ros.products.run_warnings import warnings_of_recording
from lava_ros.scene.features import load_files
from lava_ros.scene.onset import Onset
from lava_ros.simulation.output.budget import VolumeBudget
from products.report.conftest import HOSTILE
import recording
from recording import GRIDS, growing, record, TERRAIN

ROOT = Path(__file__).parents[3]
SAMPLE = ROOT / 'bags/sample'


class Reader(HTMLParser):
    """Parser of the page of a bag, which checks that all elements are closed.

    Attributes:
        page: The page.
        elements: Names and attributes of all elements.
        texts: Texts of all elements except styles.
    """

    VOID = frozenset({'meta', 'link', 'input', 'img', 'br'})

    def __init__(self, bag: Path) -> None:
        """Create and parse the page, which is written next to the bag."""
        super().__init__()
        path = bag.with_suffix('.html')
        self.size = write_report([bag], path)
        self.page = path.read_text(encoding='utf-8')
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
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
        if self._open and self._open[-1][0] != 'style' and data.strip():
            self.texts.append(data.strip())

    @property
    def pictures(self) -> dict[str, str]:
        """Data URLs of the pictures by their description."""
        return {
            str(item['alt']): str(item['src']) for tag, item in self.elements if tag == 'img'
        }

    def after(self, text: str, count: int) -> list[str]:
        """Return the texts after a text."""
        at = self.texts.index(text) + 1
        return self.texts[at : at + count]


@pytest.fixture(scope='module')
def read(run):
    """Return the parsed page of the run."""
    return Reader(run)


def test_page_is_self_contained(read):
    for _, attributes in read.elements:
        for name in ('src', 'href', 'srcset', 'action'):
            value = attributes.get(name)
            assert value is None or value.startswith('data:')
    assert "default-src 'none'" in read.page
    # requests of style sheets
    assert re.search(r'@import|url\(', read.page) is None


def test_page_escapes_texts_of_the_bag(read):
    assert sum('window.broken' in item for item in read.texts) >= 2
    assert any(HOSTILE in item for item in read.texts)
    assert all(item['src'] != 'x' for tag, item in read.elements if tag == 'img')
    assert not any(tag == 'script' for tag, _ in read.elements)


def test_page_has_maps_and_charts(read):
    assert list(read.pictures) == [
        'Lava thickness', 'Temperature', 'Hazard index',
        'Time of arrival of the lava, 0.1 m thick', 'Volume over time', 'Area over time',
        'Distance of the front over time', 'Highest temperature over time',
    ]
    *maps, volume, area, front, hot = read.pictures.values()
    for url in maps:
        with urlopen(url) as file:
            assert np.std(imread(file, format='png')[..., :3]) > 0.05
    for url in (volume, area, front, hot):
        with urlopen(url) as file:
            assert ElementTree.parse(file).getroot().tag.endswith('svg')


def test_curves_have_the_values_of_the_frames(run, read):
    charts = {item.key: item for item in charts_of(Recording(run), summarize(Recording(run)))}
    area, front, hottest = (charts[key].curves[0] for key in ('area', 'front', 'temperature'))
    assert area.times == [200.0 * index for index in range(9)]
    columns = [int(time / 100.0) for time in area.times]
    assert area.values == [250.0 * count for count in columns]
    volumes = [round(float(growing(time).sum()) * 25.0, 1) for time in area.times]
    for curve in charts['volume'].curves[:2]:
        assert curve.values == pytest.approx(volumes, rel=1e-4)
    budget = VolumeBudget.from_texts(Recording(run).timeline.last_run[-1].values)
    assert budget is not None
    for curve in charts['volume'].curves:
        assert curve.values[-1] == budget.parts()[curve.label]
    # from the vent in the centre of the first column to the corner of the last column
    tip = np.hypot(5.0 * (columns[-1] - 1), 22.5)
    assert front.values[-1] == pytest.approx(tip, rel=1e-4)
    assert math.isnan(front.values[0])
    # exact, although grids have steps of 12 degrees
    hot = [900.0 - 0.1 * time for time in area.times[1:]]
    assert math.isnan(hottest.values[0])
    assert hottest.values[1:] == pytest.approx(hot, abs=0.01)
    # the page has the last values as texts
    assert 'At the end: standing 4,000 m².' in read.texts
    assert 'At the end: hottest cell 740 °C.' in read.texts


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
    assert len(alerts) == 2
    assert read.texts.index('Simulation, not verified.') < read.texts.index('simulated')
    assert read.texts.index(
        'The recording was cut off, or still continues: data after its last complete message are '
        'missing.'
    ) < read.texts.index('simulated')


@pytest.mark.parametrize(('options', 'is_damaged', 'words'), [
    ({}, False, None),
    ({'times': [200.0, 400.0, 0.0, 100.0]}, False, 'The simulation was reset during the rec'),
    ({}, True, 'Part of the bag is damaged or missing'),
    ({'flow': lambda time: np.zeros(TERRAIN.shape, dtype=np.float32)}, False, 'There is no lava'),
])
def test_recording_has_the_warnings_of_its_run(options, is_damaged, words, tmp_path):
    bag = record(tmp_path / 'bag', **options)
    if is_damaged:
        (path,) = BagReader(bag).files
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 0xFF
        path.write_bytes(data)
    read = Recording(bag)
    found = warnings_of_recording(read, read.timeline.last_run)
    assert [text.startswith(words) for text in found] == [True] if words else not found


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
    assert rows['standing area, 0.1 m or more'] == '1800 m²'
    # without arrival times, drained cells are unknown
    assert frame.inundated is None and not any('inundated' in name for name in rows)
    assert rows['maximum thickness'] == '41.3 m'
    assert Reader(bag).after('5 m or more', 2) == ['over a roof', '25 m²']
    assert read_run(bag).summary == '1800 m² standing lava  ·  up to 41.3 m thick'
    assert not any('thicker in places' in item for item in warnings(
        Recording(bag), summarize(Recording(bag))))


@pytest.mark.parametrize('part', [1.0, 0.5, 0.2])
def test_depth_classes_add_up_to_the_area_of_standing_lava(part, tmp_path):
    run = record(tmp_path / 'run', [0.0, 400.0, 800.0])
    summary = summarize(Recording(run))
    covered = np.where(summary.frame.standing, np.float32(part), np.float32(0.0))
    frame = replace(summary.frame, inundated=covered)
    table = depth_table(replace(summary, frame=frame))
    assert table is not None
    whole = frame.standing.sum() * frame.resolution**2
    assert frame.standing_area == pytest.approx(part * whole)
    areas = [float(area.removesuffix(' m²')) for *_, area in table.rows]
    assert sum(areas) == pytest.approx(frame.standing_area, rel=0.01)


def test_page_without_lava_has_no_arrival(tmp_path):
    bag = record(tmp_path / 'bag', flow=lambda time: np.zeros(TERRAIN.shape, dtype=np.float32))
    read = Reader(bag)
    assert 'Lava thickness' in read.pictures
    assert not any('arrival' in name for name in read.pictures)


def test_options_of_pages_apply_to_a_single_bag(run, tmp_path):
    """The page has the given date, author and overlays."""
    places = tmp_path / 'places.csv'
    x, y = TERRAIN.offset
    places.write_text(f'x,y,name\n{x - 40},{y + 95},town\n')
    write_report(
        [run], tmp_path / 'a.html', overlays=load_files('--places', [places]),
        onset=Onset.from_text('2021-09-19T15:10Z'), imprint=Imprint('A. Author'),
    )
    text = (tmp_path / 'a.html').read_text(encoding='utf-8')
    assert '2021-09-19 15:10 UTC' in text and 'A. Author' in text and 'town' in text


def test_report_needs_simulated_times(tmp_path):
    with pytest.raises(LavaError, match='/diagnostics of the node'):
        write_report([record(tmp_path / 'bag', clock=False)], tmp_path / 'a.html')


@pytest.mark.parametrize('name', ['report.pdf', 'missing/report.html'])
def test_rejects_an_output_that_cannot_be_written(run, tmp_path, name):
    with pytest.raises(LavaError, match='output is '):
        write_report([run], tmp_path / name)


def test_page_of_the_sample_bag(tmp_path):
    (tmp_path / 'sample').symlink_to(SAMPLE)
    read = Reader(tmp_path / 'sample')
    assert 100_000 < read.size == len(read.page.encode()) < 2_000_000
    assert any('EPSG:26710' in item for item in read.texts)
    assert 'The bag does not contain the effects.' not in read.texts
    assert 'solidification' in read.texts


@pytest.mark.parametrize(
    'values', [[0.0, 0.0], [math.nan, math.nan], [5.0, 5.0], [0.0, 4.0]]
)
@pytest.mark.parametrize('times', [[0.0, 7200.0], [0.0, 0.0]])
def test_draws_constant_and_empty_curves(times, values, tmp_path):
    chart = Chart('area', 'Area', 'm²', [Curve('a', times, values), Curve('b', times, values)])
    for name in ('a.svg', 'b.svg'):
        chart.draw(tmp_path / name)
    assert (tmp_path / 'a.svg').read_bytes() == (tmp_path / 'b.svg').read_bytes()
    tree = ElementTree.parse(tmp_path / 'a.svg')
    ids = {item.get('id') for item in tree.iter()}
    assert {'line2d_1', 'legend_1'} <= ids
    last = 'none' if math.isnan(values[-1]) else f'{values[-1]:g} m²'
    assert chart.texts() == [('a', last), ('b', last)]
