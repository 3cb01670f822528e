# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The live view opened and driven in a real browser."""


from matplotlib.image import imread
import numpy as np
import pytest

pytest.importorskip('bokeh')
from pages.report.devtools import Browser, needs_browser
from watch_page import Growing, served

pytestmark = needs_browser

# The model of a kind, and what is seen inside the shadows of Bokeh's elements.
MODEL = '[...Bokeh.documents[0]._all_models.values()].find(item => item.type === "{}")'
SEEN = """(() => {
  const inside = (root) => [...root.querySelectorAll('*')].flatMap(
    (item) => [item, ...(item.shadowRoot ? inside(item.shadowRoot) : [])]);
  window.seen = (selector) => inside(document).filter((item) => item.matches(selector));
})()"""
TITLE = 'seen("h1")[0]?.textContent'


@pytest.fixture(scope='module')
def frames(tmp_path_factory):
    """Four of six frames."""
    return Growing(tmp_path_factory.mktemp('frames'), 4)


@pytest.fixture(scope='module')
def browser(frames, tmp_path_factory):
    """A browser that has opened the page."""
    with served(frames) as address:
        found = Browser(tmp_path_factory.mktemp('profile'))
        try:
            found.resize(1400, 900)
            found.call('Page.navigate', url=address)
            found.wait_for('window.Bokeh && Bokeh.documents.length === 1')
            found.evaluate(SEEN)
            found.wait_for(f'{TITLE} === "Lava flow after 13 min of 13 min so far"')
            yield found
        finally:
            found.close()


def _handle(browser: Browser) -> list[float]:
    """Value and largest value of the slider's handle, as people see it."""
    names = ('aria-valuenow', 'aria-valuemax')
    words = ', '.join(f'Number(seen(".noUi-handle")[0].getAttribute("{name}"))' for name in names)
    return browser.evaluate(f'[{words}]')


def test_the_page_grows_with_the_run(browser, frames, tmp_path):
    """New frames come by themselves, with new kinds of maps; the slider goes back in time."""
    assert _handle(browser) == [3.0, 3.0]
    frames.grow(5)
    browser.wait_for(f'{TITLE} === "Lava flow after 17 min of 17 min so far"')
    assert _handle(browser) == [4.0, 4.0]
    browser.screenshot(tmp_path / 'late.png')
    browser.evaluate('seen(".noUi-handle")[0].focus()')
    browser.press('ArrowLeft')
    browser.press('ArrowLeft')
    browser.wait_for(f'{TITLE} === "Lava flow after 10 min of 17 min so far"')
    frames.grow(6)
    browser.wait_for(f'{TITLE} === "Lava flow after 10 min of 20 min so far"')
    browser.screenshot(tmp_path / 'early.png')
    assert _handle(browser) == [2.0, 5.0]
    for _ in range(3):
        browser.press('ArrowRight')
    browser.wait_for('seen(".bk-btn").length === 5')
    late, early = (imread(tmp_path / f'{name}.png')[..., :3] for name in ('late', 'early'))
    assert np.abs(late - early).max() > 0.2
    assert late.std() > 0.1


def test_maps_have_their_own_scales(browser):
    """Each button shows another map, with its unit beside the colours."""
    formats = []
    for name in ('Lava thickness', 'Hazard', 'Temperature', 'Arrival'):
        browser.evaluate(f'seen(".bk-btn").find(item => item.textContent === "{name}").click()')
        browser.wait_for(f'{MODEL.format("HoverTool")}.tooltips[0][0] === "{name}"')
        formats.append(browser.evaluate(f'{MODEL.format("ColorBar")}.formatter.format'))
    assert formats == ['%g m', '%g ', '%g °C', '%g min']


def test_what_is_wrong_is_said_as_text(browser):
    """The status is on the page, and what it quotes is no part of it."""
    browser.wait_for('seen("p").some(item => item.textContent === "no node answers <here>")')
    assert browser.evaluate('seen("here").length') == 0


def test_no_network_and_no_complaints(browser):
    """All that the page needs comes from where it does."""
    browser.evaluate('0')
    assert browser.requested
    assert {item.split('/')[2].split(':')[0] for item in browser.requested} == {'127.0.0.1'}
    said = [item for item in browser.problems if 'bokeh' not in item.lower()]
    assert said == []
