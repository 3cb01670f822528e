# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Fixtures for a simulation without ROS."""

import pytest

from waiting import PATIENCE
from worker_bench import Bench


@pytest.fixture
def bench(request):
    result = Bench(**getattr(request, 'param', {}))
    yield result
    assert result.worker.stop(PATIENCE)
