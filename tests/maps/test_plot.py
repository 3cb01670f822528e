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


"""What pictures say in words and in colours."""

import numpy as np
import pytest

from lava_ros.maps.plot import duration, scale_of


@pytest.mark.parametrize(
    ('seconds', 'words'),
    [
        (0.0, '0 s'),
        (119.0, '119 s'),
        (300.0, '5 min'),
        (7200.0, '2 h'),
        (20_400.0, '5 h 40 min'),
        (2.75 * 86_400.0, '2 d 18 h'),
    ],
)
def test_duration(seconds, words):
    """Times are said as people say them."""
    assert duration(seconds) == words


@pytest.mark.parametrize(
    ('source', 'values', 'label', 'top', 'past'),
    [
        ('thickness', [0.1, 2.2], 'm', 3.0, 'neither'),
        ('thickness', [*[1.0] * 999, 80.0], 'm', 1.0, 'max'),
        ('arrival', [90.0, 100.0], 's', 100.0, 'neither'),
        ('arrival', [60.0, 5.0 * 3600.0], 'h', 5.0, 'neither'),
        ('arrival', [86_400.0 * 9.5], 'd', 10.0, 'neither'),
        ('probability', [3.0], '%', 100.0, 'neither'),
        ('temperature', [], '°C', 100.0, 'neither'),
    ],
)
def test_scales(source, values, label, top, past):
    """They end at round numbers, in units that people read, and say what is past them."""
    scale = scale_of(source, np.array([*values, np.nan]))
    assert (scale.label, scale.norm.vmax, scale.past) == (label, top, past)
