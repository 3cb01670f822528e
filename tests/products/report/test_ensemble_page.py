# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The page of an ensemble in a real browser, on a screen and on a phone."""

import pytest

from cli.conftest import ensemble_words, write_ensemble_scene
from command_line import done
from products.report.devtools import Browser, needs_browser
from recording import TERRAIN

pytestmark = needs_browser

#: Elements with text or a picture that are not completely inside the width of the window.
OUTSIDE = """[...document.querySelectorAll('h1, h2, p, dt, dd, td, img, figcaption')]
  .filter(e => getComputedStyle(e).position !== 'absolute')
  .map(e => [e.tagName, e.textContent, e.getBoundingClientRect()])
  .filter(([, , box]) => box.width && (box.left < 0 || box.right > innerWidth))
  .map(([tag, text]) => `${tag} ${text}`)"""

#: Texts of the row of a place.
ROW = "[...document.querySelectorAll('tr')].find(e => /^town/.test(e.textContent)).innerText"


@pytest.fixture(scope='module')
def page(tmp_path_factory):
    """Write the page of an ensemble with places, one of which is off the map."""
    folder = tmp_path_factory.mktemp('page')
    write_ensemble_scene(folder, 3.0, {'position': {'deviation': 5.0}})
    done(*ensemble_words(folder, 2), '--start', '2006-07-14T22:00Z')
    x, y = TERRAIN.offset
    rows = [f'{x + 10 * index},{y + 95},a place with a long name {index}' for index in range(6)]
    places = folder / 'places.csv'
    places.write_text('\n'.join(['x,y,name', *rows, f'{x + 90_000},{y},town']) + '\n')
    done('map', folder / 'members', '-o', folder / 'page.html', '--places', places)
    return folder / 'page.html'


@pytest.mark.parametrize('size', [(1280, 900), (400, 800)])
def test_page_of_an_ensemble_fits(size, page, tmp_path):
    browser = Browser(tmp_path)
    try:
        browser.resize(*size)
        browser.call('Page.navigate', url=page.as_uri())
        browser.wait_for('document.readyState === "complete" && document.images.length === 4')
        assert browser.evaluate('document.documentElement.scrollWidth') <= size[0]
        assert browser.evaluate(OUTSIDE) == []
        # a village off the map does not read like one that lava does not reach
        town = browser.evaluate(ROW)
        assert 'off the map: nothing is known' in town and '0 %' not in town
        assert '2006-07-14 22:' in browser.evaluate('document.body.innerText')
        # pictures are as large as the window allows, and come before long facts
        widths = browser.evaluate(
            '[...document.images].map(e => e.getBoundingClientRect().width)'
        )
        assert len(widths) == 4 and min(widths) > min(0.85 * size[0], 399)
        order = browser.evaluate(
            '[document.querySelector("figure"), document.querySelector("#about-title")]'
            '.map(e => e.getBoundingClientRect().top)'
        )
        assert order[0] < 900 < order[1]
        assert browser.problems == []
    finally:
        browser.close()
