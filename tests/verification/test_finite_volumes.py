# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The finite volumes of docs/benchmarks, on flows with an exact solution."""

from importlib import import_module
import platform
import shutil

import pytest

from project import ROOT

pytestmark = pytest.mark.skipif(
    shutil.which('cc') is None or platform.machine() not in ('x86_64', 'AMD64'),
    reason='needs a C compiler for x86',
)


@pytest.fixture
def codes(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / 'docs/benchmarks')
    return import_module('codes')


@pytest.mark.parametrize(('name', 'cell', 'most'), [
    ('constant_flux', 5.0, 0.4), ('constant_flux', 2.5, 0.2), ('valley', 5.0, 2.0),
])
def test_both_schemes_approach_the_exact_thickness(codes, name, cell, most):
    flow = codes.FLOWS[name]
    plain, staged = (
        codes.volumes(scheme)(flow, cell, 1).thickness
        for scheme in (codes.finite_volumes.plain, codes.staged)
    )
    scores = {
        quantity: value
        for quantity, value, _ in flow.scores(flow, codes.on_map(flow, staged, cell))
    }
    assert scores['profile'] < most
    assert codes.distance(staged, plain) < 0.05


def test_staged_scheme_conserves_volume_on_rough_ground(codes):
    flow = codes.FLOWS['rougher']
    # in_stages raises if the volume is wrong by more than 0.01 %
    thickness = codes.volumes(codes.staged)(flow, 10.0, 1).thickness
    assert thickness.min() > -1e-3
