# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The page that compares lava codes agrees with its CSV files."""

import importlib
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / 'docs/benchmarks'


def test_tables_of_the_page_are_up_to_date(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    script = importlib.import_module('other_codes')
    page = script.PAGE.read_text(encoding='utf-8')
    assert script.written(page, script.TABLES) == page
