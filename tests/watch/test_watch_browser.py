# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The live view in 3-D, opened and driven in a real browser."""

from threading import Event, Thread

from matplotlib.image import imread
import numpy as np
import pytest

pytest.importorskip('viser')
from lava_ros.watch.server import Server
from products.report.devtools import Browser, needs_browser
from waiting import wait_until
from watch_page import Growing

pytestmark = needs_browser

TEXT = '(document.body?.innerText ?? "")'
ABOVE = '[...document.querySelectorAll("button")].find(e => /above/.test(e.textContent)).click()'


def test_the_page_shows_a_growing_run_in_3d(tmp_path):
    frames, ended = Growing(tmp_path, 4), Event()
    server, browser = Server(frames, 0), Browser(tmp_path)
    serving = Thread(target=server.run, args=(ended,))
    serving.start()

    def picture():
        browser.screenshot(tmp_path / 'page.png')
        return imread(tmp_path / 'page.png')[..., :3]

    try:
        browser.resize(700, 450)
        browser.call('Page.navigate', url=f'http://127.0.0.1:{server.port}/')
        browser.wait_for(f'{TEXT}.includes("Lava flow after 13 min of 13 min so far")')
        # texts of files and nodes are not markup
        browser.wait_for(f'{TEXT}.includes("no node answers <here>")')
        assert browser.evaluate('document.querySelectorAll("here").length') == 0
        frames.grow(6)
        browser.wait_for(f'{TEXT}.includes("Lava flow after 20 min of 20 min so far")')
        wait_until(lambda: picture().std() > 0.1)
        from_south = picture()
        browser.evaluate(ABOVE)
        wait_until(lambda: np.abs(picture() - from_south).max() > 0.2)
        assert {item.split('/')[2].split(':')[0] for item in browser.requested} == {'127.0.0.1'}
        refused = [item for item in browser.problems if item.startswith('Refused')]
        assert all(item.startswith("Refused to connect to 'data:") for item in refused)
    finally:
        ended.set()
        serving.join()
        browser.close()
