# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The live view in 3-D, opened and driven in a real browser."""

from matplotlib.image import imread
import numpy as np
import pytest

pytest.importorskip('viser')
from pages.report.devtools import Browser, needs_browser
from watch_page import Growing, served

pytestmark = needs_browser

TEXT = '(document.body?.innerText ?? "")'
BUTTON = '[...document.querySelectorAll("button")].find(e => e.textContent === "{}").click()'


def test_the_page_shows_a_growing_run_in_3d(tmp_path):
    frames = Growing(tmp_path, 4)
    with served(frames) as server:
        browser = Browser(tmp_path)

        def wait_for(expression):
            until = f'{TEXT} && ({expression})'
            for _ in range(600):
                server.update()
                if browser.evaluate(until):
                    return
            browser.wait_for(until)

        try:
            browser.resize(700, 450)
            browser.call('Page.navigate', url=f'http://127.0.0.1:{server.port}/')
            browser.wait_for(f'{TEXT}.includes("Dev Settings")')
            wait_for(f'{TEXT}.includes("Lava flow after 13 min of 13 min so far")')
            # texts of files and nodes are not markup
            wait_for(f'{TEXT}.includes("no node answers <here>")')
            assert browser.evaluate('document.querySelectorAll("here").length') == 0
            frames.grow(6)
            wait_for(f'{TEXT}.includes("Lava flow after 20 min of 20 min so far")')
            pictures = []
            for name in ('From the south', 'From above'):
                browser.evaluate(BUTTON.format(name))
                for _ in range(50):
                    server.update()
                    browser.evaluate('0')
                browser.screenshot(tmp_path / 'page.png')
                pictures.append(imread(tmp_path / 'page.png')[..., :3])
            assert all(picture.std() > 0.1 for picture in pictures)
            assert np.abs(pictures[0] - pictures[1]).max() > 0.2
            hosts = {item.split('/')[2].split(':')[0] for item in browser.requested}
            assert hosts == {'127.0.0.1'}
            assert not [item for item in browser.problems if 'Refused' in item]
        finally:
            browser.close()
