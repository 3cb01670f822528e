# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A case for several test files."""

from pathlib import Path

import pytest

from eruption import LAVA, write_case
from lava_ros.hindcast.case import Case, load_case


@pytest.fixture
def etna(tmp_path: Path) -> Case:
    """Return a case of three hours with the lava of Etna."""
    return load_case(write_case(tmp_path / 'valley'))


@pytest.fixture(scope='module')
def valley(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Return a case of a valley down which lava flows for an hour."""
    return load_case(write_case(tmp_path_factory.mktemp('run') / 'valley', hours=1, yaml=LAVA))
