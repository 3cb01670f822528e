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

"""The safeguards: each has a scene that misses it; ``make safeguards`` takes them out."""

import pytest

from hard.play import play
from hard.safeguards import ROOT, Safeguard, SAFEGUARDS
from hard.scenes import SCENES

ALL = pytest.mark.parametrize('safeguard', SAFEGUARDS, ids=lambda item: item.name)


@ALL
def test_the_line_is_there(safeguard: Safeguard):
    """The line that is named is in the file that is named, once."""
    text = (ROOT / safeguard.file).read_text(encoding='utf-8')
    assert text.count(safeguard.line) == 1


@ALL
def test_scene_that_misses_it(safeguard: Safeguard):
    """The scene holds; it does not when the line is taken out."""
    compare = safeguard.invariant == 'halving'
    outcome = play(SCENES[safeguard.scene], safeguard.preset, compare=compare, wall_limit=60.0)
    assert outcome.verdict == 'holds', outcome.violations
