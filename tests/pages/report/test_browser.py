# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The report opened and driven in a real browser."""


from matplotlib.image import imread
import numpy as np
import pytest

from lava_ros.pages.report.page import write_report
from pages.report.devtools import Browser, needs_browser

pytestmark = needs_browser

# A checksum of what the map shows, and how many of its pixels are as dark red as lethal hazard.
PIXELS = """(() => {
  const copy = document.createElement('canvas');
  const map = document.getElementById('map');
  [copy.width, copy.height] = [map.width, map.height];
  const context = copy.getContext('2d', {willReadFrequently: true});
  context.drawImage(map, 0, 0);
  const {data} = context.getImageData(0, 0, map.width, map.height);
  let sum = 0;
  let red = 0;
  for (let i = 0; i < data.length; i += 4) {
    sum = (31 * sum + data[i] + 3 * data[i + 1] + 7 * data[i + 2]) % 1000000007;
    if (data[i] > 120 && data[i + 1] < 40 && data[i + 2] < 70) red += 1;
  }
  return [sum, red / (data.length / 4)];
})()"""

CLOCK = 'document.getElementById("clock").textContent'
FRAME = 'Number(document.getElementById("time").value)'


@pytest.fixture(scope='module')
def browser(run, tmp_path_factory):
    """A browser that has opened the report."""
    folder = tmp_path_factory.mktemp('browser')
    write_report(run, folder / 'report.html')
    (folder / 'profile').mkdir()
    found = Browser(folder / 'profile')
    try:
        found.resize(1000, 900)
        found.open(folder / 'report.html')
        yield found
    finally:
        found.close()


@pytest.fixture(autouse=True)
def at_the_end(browser):
    """Each test begins with the height of the last frame, and leaves no error behind."""
    browser.click('input[value=height] + span')
    # The keys of a switch that has the focus are its own.
    browser.evaluate('document.activeElement.blur()')
    set_frame(browser, 8)
    yield
    assert browser.problems == []
    assert browser.evaluate('window.broken === undefined')


def set_frame(browser: Browser, frame: int) -> None:
    """Move the slider as a hand does."""
    browser.evaluate(
        f'(() => {{const s = document.getElementById("time"); s.value = {frame};'
        's.dispatchEvent(new Event("input", {bubbles: true}))})()'
    )


def test_the_slider_moves_the_map_the_clock_and_the_curves(browser):
    """Another time shows other pixels, another time, another cursor and other values."""
    said = 'document.querySelector("output[data-curve=area]").textContent'
    cursor = 'document.querySelector(".cursor").x1.baseVal.value'
    late = [browser.evaluate(item) for item in (PIXELS, CLOCK, said, cursor)]
    set_frame(browser, 2)
    early = [browser.evaluate(item) for item in (PIXELS, CLOCK, said, cursor)]
    assert late[1:3] == ['27 min', '4000 m²']
    assert early[1:3] == ['7 min', '1000 m²']
    assert late[0] != early[0]
    assert early[3] < late[3] - 50.0


def test_each_layer_has_its_own_picture_and_legend(browser):
    """Four layers: four pictures, four legends; lethal hazard is dark red."""
    seen = {}
    for name in ('height', 'temperature', 'hazard', 'arrival'):
        browser.click(f'input[value={name}] + span')
        legend = browser.evaluate('document.getElementById("legend").textContent')
        checksum, red = browser.evaluate(PIXELS)
        seen[name] = (checksum, legend, red)
    assert len({item[0] for item in seen.values()}) == 4
    assert seen['height'][1] == 'Lava thickness 0 m3.26 m'
    assert seen['hazard'][1] == 'Hazard 0 100, lethal'
    assert seen['arrival'][1] == 'Arrival 0 s27 min'
    assert seen['hazard'][2] > 0.05
    assert seen['temperature'][2] < 0.02


def test_keys(browser):
    """Arrows step, Home and End go to the ends, space plays and stops, numbers choose."""
    for key, frame in (('ArrowLeft', 7), ('ArrowLeft', 6), ('ArrowRight', 7)):
        browser.press(key)
        assert browser.evaluate(FRAME) == frame
    browser.evaluate('document.getElementById("time").focus()')
    for key, frame in (('Home', 0), ('ArrowRight', 1), ('End', 8)):
        browser.press(key)
        assert browser.evaluate(FRAME) == frame
    browser.press('3')
    assert browser.evaluate('document.querySelector("input[value=hazard]").checked')


def test_play(browser):
    """Space begins at the start, runs to the end by itself and stops there."""
    browser.press(' ')
    assert browser.evaluate('document.getElementById("play").textContent') == 'Pause'
    assert browser.evaluate(FRAME) < 8
    browser.wait_for(f'{FRAME} >= 1')
    browser.press(' ')
    assert browser.evaluate('document.getElementById("play").textContent') == 'Play'
    set_frame(browser, 7)
    browser.click('#play')
    browser.wait_for('document.getElementById("play").textContent === "Play"')
    assert browser.evaluate(FRAME) == 8


def test_reading_a_cell(browser):
    """The cell under the pointer is told in the world's coordinates with all its values."""
    found = """(() => {
      const d = JSON.parse(document.getElementById('data').textContent);
      return [d.west, d.south, d.cell, d.rows, d.columns];
    })()"""
    west, south, cell, rows, columns = browser.evaluate(found)
    # The middle of row 15, column 3 of the terrain.
    x, y = -50.0 + 3.5 * 5.0, 20.0 + 15.5 * 5.0
    browser.click(
        '#map', x=(x - west) / (cell * columns), y=1.0 - (y - south) / (cell * rows)
    )
    text = browser.evaluate('document.getElementById("readout").textContent')
    assert text.startswith(f'E {500_000 + x:.0f}, N {4_180_000 + y:.0f} (EPSG:32633): ')
    assert 'height 3.1 m' in text
    assert 'hazard 100' in text
    # Column 3 is there from 400 s on.
    assert 'lava came by 7 min' in text


def test_no_network(browser):
    """The page asks for itself and nothing else."""
    assert {item.rsplit('/', 1)[1] for item in browser.requested} == {'report.html'}


def test_on_a_phone(browser, tmp_path):
    """Nothing is wider than the screen, and the map and its controls are on it."""
    browser.resize(360, 740, phone=True)
    try:
        assert browser.evaluate('document.documentElement.scrollWidth') <= 360
        width, height = browser.evaluate(
            '(() => {const b = document.getElementById("play").getBoundingClientRect();'
            'return [b.width, b.height]})()'
        )
        assert width >= 44
        assert height >= 44
        browser.evaluate('document.getElementById("map").scrollIntoView()')
        browser.screenshot(tmp_path / 'phone.png')
        assert np.std(imread(tmp_path / 'phone.png')[..., :3]) > 0.05
    finally:
        browser.resize(1000, 900)
