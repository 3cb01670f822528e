# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The page of file formats."""

from pathlib import Path

from lava_ros.files.columns import COLUMNS
from lava_ros.files.raster_formats import FORMATS
from scripts import load_script

PAGE = Path(__file__).parents[2] / 'docs/FORMATS.md'


def test_page_of_formats_is_up_to_date():
    script, text = load_script(PAGE.with_name('formats.py')), PAGE.read_text(encoding='utf-8')
    assert script.page(text) == text, 'run python docs/formats.py'
    assert all(item.name in text for item in FORMATS)
    assert set(script.MEANINGS) == set(COLUMNS)
