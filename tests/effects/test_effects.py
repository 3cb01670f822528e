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

"""The key of the compiled step."""

import pytest

from lava_ros.effects import Effects
from lava_ros.errors import LavaError


def test_effects_are_a_key():
    """Equal effects hash alike: they key the compiled step."""
    assert hash(Effects(green=True)) == hash(Effects(green=True)) != hash(Effects())


@pytest.mark.parametrize(
    'pair', [('green', 'helmholtz'), ('arrhenius', 'vft'), ('inertia', 'green')]
)
def test_what_does_not_go_together_is_refused(pair):
    """Two forms of one effect, or a momentum beside a balance, are an error that names one."""
    with pytest.raises(LavaError, match='effects'):
        Effects(**{'arrhenius': False, **dict.fromkeys(pair, True)})
