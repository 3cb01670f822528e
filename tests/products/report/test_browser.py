# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of a bag in a real browser."""

from matplotlib.image import imread
import numpy as np
import pytest

from lava_ros.products.report.page import write_report
from products.report.devtools import Browser, needs_browser

pytestmark = needs_browser

PICTURES = 'document.images.length'


@pytest.mark.parametrize('size', [(1280, 900), (360, 740)])
def test_page_of_a_bag_fits_and_requests_nothing(size, run, tmp_path):
    write_report([run], tmp_path / 'report.html')
    (tmp_path / 'profile').mkdir()
    browser = Browser(tmp_path / 'profile')
    try:
        browser.resize(*size, phone=size[0] < 400)
        browser.call('Page.navigate', url=(tmp_path / 'report.html').as_uri())
        browser.wait_for(f'document.readyState === "complete" && {PICTURES} === 8')
        assert browser.evaluate('document.documentElement.scrollWidth') <= size[0]
        assert browser.evaluate('[...document.images].every(e => e.naturalWidth > 0)')
        browser.screenshot(tmp_path / 'page.png')
        assert np.std(imread(tmp_path / 'page.png')[..., :3]) > 0.05
        assert {item.rsplit('/', 1)[1] for item in browser.requested} == {'report.html'}
        assert browser.evaluate('window.broken === undefined')
        assert browser.problems == []
    finally:
        browser.close()
