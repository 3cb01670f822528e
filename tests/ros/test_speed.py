# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""How fast simulated time passes, over the last seconds and over all runs."""

import pytest

from lava_ros.ros import speed
from lava_ros.ros.speed import SpeedMeter


def test_the_mean_leaves_pauses_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs of 10 s at 3x and 1x with a long pause between them are 2x."""
    now = 0.0
    monkeypatch.setattr(speed.time, 'monotonic', lambda: now)
    meter = SpeedMeter()
    assert (meter.value, meter.mean) == (0.0, 0.0)
    meter.note(0.0)
    now = 10.0
    meter.note(30.0)
    meter.clear()
    now = 500.0
    meter.note(30.0)
    now = 507.0
    meter.note(37.0)
    now = 510.0
    meter.note(40.0)
    assert meter.mean == pytest.approx(2.0)
    # What is older than the window no longer counts.
    assert meter.value == pytest.approx(1.0)
    assert now - 507.0 < speed.SPEED_WINDOW
