# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The page that compares lava codes agrees with its CSV files."""

import csv
import importlib
from pathlib import Path
import shutil

import pytest

BENCHMARKS = Path(__file__).parents[2] / 'docs/benchmarks'


def lines_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


@pytest.fixture
def scripts(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module


def test_tables_of_the_page_are_up_to_date(scripts):
    script = scripts('other_codes')
    page = script.PAGE.read_text(encoding='utf-8')
    assert script.written(page, script.TABLES) == page


@pytest.mark.skipif(shutil.which('cc') is None, reason='no C compiler')
@pytest.mark.parametrize('case', ['constant_flux', 'valley'])
def test_plain_scheme_has_the_committed_scores(case, scripts):
    codes = scripts('codes')
    flow = codes.FLOWS[case]
    thickness = codes.plain(flow, 10.0, 1).thickness
    assert thickness.sum() * 100.0 == pytest.approx(codes.DISCHARGE * flow.end)
    rows = {
        row['quantity']: float(row['value'])
        for row in lines_of(BENCHMARKS / 'codes.csv')
        if (row['case'], row['code'], row['cell_m']) == (case, 'plain scheme', '10')
    }
    found = {quantity: value for quantity, value, _ in flow.scores(flow, thickness, 10.0)}
    assert found == pytest.approx(rows, rel=1e-3)


def test_plain_scheme_is_more_accurate_than_the_presets():
    rows = [row for row in lines_of(BENCHMARKS / 'codes.csv') if row['quantity'] == 'profile']
    for case in ('constant_flux', 'valley', 'hill'):
        runs = {row['code']: row for row in rows if (row['case'], row['cell_m']) == (case, '5')}
        plain = runs['plain scheme']
        assert float(plain['cpu_s']) < float(runs['standard']['cpu_s'])
        for preset in ('draft', 'standard', 'fine'):
            assert float(plain['value']) < float(runs[preset]['value'])
