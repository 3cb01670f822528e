# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The report in a real browser."""

from matplotlib.image import imread
import numpy as np
import pytest

from lava_ros.pages.report.page import write_report
from pages.report.devtools import Browser, needs_browser

pytestmark = needs_browser

# A checksum of the map, and the fraction of its pixels in the dark red of lethal hazard.
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
    """Yield a browser with the report."""
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
    """Show the thickness of the last frame, and check for errors after the test."""
    browser.click('input[value=thickness] + span')
    # a focused switch handles keys itself
    browser.evaluate('document.activeElement.blur()')
    set_frame(browser, 8)
    yield
    assert browser.problems == []
    assert browser.evaluate('window.broken === undefined')


def set_frame(browser: Browser, frame: int) -> None:
    """Move the slider."""
    browser.evaluate(
        f'(() => {{const s = document.getElementById("time"); s.value = {frame};'
        's.dispatchEvent(new Event("input", {bubbles: true}))})()'
    )


def test_the_slider_moves_the_map_the_clock_and_the_curves(browser):
    area = 'document.querySelector("output[data-curve=area]").textContent'
    cursor = 'document.querySelector(".cursor").x1.baseVal.value'
    late = [browser.evaluate(item) for item in (PIXELS, CLOCK, area, cursor)]
    set_frame(browser, 2)
    early = [browser.evaluate(item) for item in (PIXELS, CLOCK, area, cursor)]
    assert late[1:3] == ['27 min', '4000 m²']
    assert early[1:3] == ['7 min', '1000 m²']
    assert late[0] != early[0]
    assert early[3] < late[3] - 50.0


def test_each_layer_has_its_own_picture_and_legend(browser):
    views = {}
    for name in ('thickness', 'temperature', 'hazard', 'arrival'):
        browser.click(f'input[value={name}] + span')
        legend = browser.evaluate('document.getElementById("legend").textContent')
        checksum, red = browser.evaluate(PIXELS)
        views[name] = (checksum, legend, red)
    assert len({item[0] for item in views.values()}) == 4
    assert views['thickness'][1] == 'Lava thickness 0 m3.26 m'
    assert views['hazard'][1] == 'Hazard index:harmful: lava has drained awaylethal lava'
    assert views['arrival'][1] == 'Arrival 0 s27 min'
    assert views['hazard'][2] > 0.05
    assert views['temperature'][2] < 0.02


def test_keys_choose_frame_and_layer(browser):
    for key, frame in (('ArrowLeft', 7), ('ArrowLeft', 6), ('ArrowRight', 7)):
        browser.press(key)
        assert browser.evaluate(FRAME) == frame
    browser.evaluate('document.getElementById("time").focus()')
    for key, frame in (('Home', 0), ('ArrowRight', 1), ('End', 8)):
        browser.press(key)
        assert browser.evaluate(FRAME) == frame
    browser.press('3')
    assert browser.evaluate('document.querySelector("input[value=hazard]").checked')


def test_play_starts_at_the_first_frame_and_stops_at_the_last(browser):
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


def test_pointer_shows_the_values_of_a_cell(browser):
    found = """(() => {
      const d = JSON.parse(document.getElementById('data').textContent);
      return [d.west, d.south, d.cell, d.rows, d.columns];
    })()"""
    west, south, cell, rows, columns = browser.evaluate(found)
    # the centre of row 15, column 3
    x, y = -50.0 + 3.5 * 5.0, 20.0 + 15.5 * 5.0
    browser.click(
        '#map', x=(x - west) / (cell * columns), y=1.0 - (y - south) / (cell * rows)
    )
    text = browser.evaluate('document.getElementById("readout").textContent')
    assert text.startswith(f'E {500_000 + x:.0f}, N {4_180_000 + y:.0f} (EPSG:32633): ')
    assert 'thickness 3.1 m' in text
    assert 'hazard 100' in text
    # lava arrives in column 3 at 400 s
    assert 'lava arrived by 7 min' in text


def test_page_requests_nothing(browser):
    assert {item.rsplit('/', 1)[1] for item in browser.requested} == {'report.html'}


def test_page_fits_on_a_phone(browser, tmp_path):
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
