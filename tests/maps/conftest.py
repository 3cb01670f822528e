# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Bags for several test files."""

from pathlib import Path

import pytest

from recording import GRIDS, record


@pytest.fixture(scope='session')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of unrounded layers with frames at 200, 400, 600 and 800 s."""
    return record(tmp_path_factory.mktemp('floats') / 'bag')


@pytest.fixture(scope='session')
def grids(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of the same frames as grids, which are rounded."""
    return record(tmp_path_factory.mktemp('grids') / 'bag', config=GRIDS)
