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

"""Random valid scenes keep the invariants of every flow."""

from collections import Counter
import time

from hypothesis import given, note, settings
import pytest

from fuzz.scenes import Trial, trials
from hard.invariants import Watch
from lava_ros.simulation import Simulation

#: Wall time after which a scene of a test run is left as it is [s].
PATIENCE = {True: 0.4, False: 10.0}

#: Moments at which the invariants are checked.
FRAMES = 6



def play(trial: Trial, device: str, patience: float) -> bool:
    """Simulate a trial under watch; returns whether it came to its end."""
    simulation = Simulation(
        trial.scene, effects=trial.effects, accuracy=trial.accuracy, device=device
    )
    watch = Watch(simulation)
    end = time.monotonic() + patience
    for frame in range(1, FRAMES + 1):
        if frame == FRAMES // 2 and trial.vents is not None:
            simulation.set_vents(trial.vents)
            watch.renew()
        if frame == 2 * FRAMES // 3 and trial.terrain is not None:
            simulation.set_terrain(trial.terrain)
            watch.renew()
        moment = trial.until * frame / FRAMES
        left = end - time.monotonic()
        if left <= 0.0 or simulation.advance(moment, wall_limit=left) < moment:
            # where the clock cuts a frame off differs from run to run
            return False
        watch.check()
    return True


@pytest.fixture(scope='module')
def tried(figures):
    """Counts of what was tried."""
    result = Counter()
    yield result
    figures['scenes'] = dict(result)


@given(trial=trials(all_effects=not settings().derandomize))
def test_random_scenes_keep_the_invariants(trial, device, tried):
    """Whatever ground, lava, vents and physics: nothing is lost, made, heated or lifted."""
    note(repr(trial))
    is_whole = play(trial, device, PATIENCE[settings().derandomize])
    tried['played' if is_whole else 'cut off by the clock'] += 1
