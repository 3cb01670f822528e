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

"""The node's side of ensembles: what is ordered, when an outline was, what is dropped."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Mask
from lava_ros.maps.forecast import HazardMaps, QUANTILES
from lava_ros.ros.ensemble_forecasts import ForecastRules, Outlooks
from lava_ros.ros.session import Fork
from lava_ros.scene import Lava, Scene, Terrain

SCENE = Scene(Terrain(np.zeros((4, 5)), 10.0), lava=Lava())

RULES = ForecastRules(
    horizon=60.0, threshold=0.01, max_age=30.0, share=1.0, max_particles=1000
)

MASK = Mask(np.eye(4, 5) > 0.0, np.ones((4, 5), dtype=bool), 10.0, (0.0, 0.0))


def fork(clock, time, changes=1):
    """A copy of the state at a time of the clock [s]."""
    return Fork(SimpleNamespace(scene=SCENE, time=time), changes, clock, 0.01)


def order(outlooks, number, made, members=8):
    """Order an ensemble."""
    return outlooks.order(made, number, replace(RULES, members=members))


def sent(outlooks, changes=1):
    """What is passed on to the process."""
    orders = []
    outlooks.send(
        lambda name, **values: orders.append((name, values)), changes=changes, time_scale=2.0
    )
    return orders


def test_a_stamp_becomes_simulated_time():
    """Between two forks evenly, whatever held the simulation up; after them by its scale."""
    outlooks = Outlooks()
    for number, (clock, time) in enumerate(((100.0, 20.0), (110.0, 30.0), (120.0, 30.0)), 1):
        order(outlooks, number, fork(clock, time))
    for clock, time in ((105.0, 25.0), (115.0, 30.0), (123.0, 36.0)):
        done = outlooks.observe(MASK, clock)
        ((name, order_of_it),) = sent(outlooks)
        outline = order_of_it['outline']
        assert name == 'outline' and outline.time == pytest.approx(time)
        np.testing.assert_array_equal(outline.lava, MASK.lava)
        assert outline.known.all() and not done.done()
        outlooks.hear(
            'weighed', number=order_of_it['number'], agreement=[1.0], outlines=1, jaccard_mean=0.4
        )
        assert done.result(0.0) is None
    early = outlooks.observe(MASK, 99.0)
    assert sent(outlooks) == []
    with pytest.raises(LavaError, match='1.0 s before the first forecast of this scene'):
        early.result(0.0)
    assert (outlooks.status.outlines, outlooks.status.jaccard_mean) == (1, 0.4)


def test_an_ensemble_is_ordered_when_there_is_none():
    """One at a time, and one for each state; what has failed is not tried again."""
    outlooks = Outlooks()
    assert order(outlooks, 1, fork(1.0, 0.0), members=0) is None
    first = order(outlooks, 2, fork(2.0, 5.0))
    assert (first['members'], first['agreement'], first['deadline']) == (8, None, None)
    assert order(outlooks, 3, fork(3.0, 6.0)) is None
    known = np.zeros(SCENE.terrain.shape)
    maps = HazardMaps(known, dict.fromkeys(QUANTILES, known), known, 8, 8.0, 0.5)
    answer = {
        'number': 2, 'stamp_ns': first['stamp_ns'], 'time': 5.0, 'horizon': 60.0,
        'threshold': 0.01, 'maps': maps, 'asked': 8, 'is_done': True, 'outlines': 0,
        'duration': 3.0,
    }
    assert not outlooks.hear('outlook', changes=0, **answer)
    assert outlooks.hear('outlook', changes=1, **answer)
    latest = outlooks.latest
    assert (latest.shown.time, latest.stamp_ns, latest.changes) == (5.0, 2_000_000_000, 1)
    assert outlooks.status.count == 1
    assert outlooks.is_wanted(1, 6.0) and not outlooks.is_wanted(1, 5.0)
    order(outlooks, 4, fork(4.0, 7.0))
    outlooks.hear('ensemble_refused', reason='nothing is uncertain')
    assert outlooks.status.error == 'nothing is uncertain'
    assert not outlooks.is_wanted(1, 9.0) and outlooks.is_wanted(2, 9.0)
    assert order(outlooks, 5, fork(5.0, 9.0, changes=2))['members'] == 8
    assert outlooks.status.error == ''


def test_outlines_never_wait_for_nothing():
    """Those on their way are refused when the process ends; those of a new scene wait for it."""
    outlooks = Outlooks()
    order(outlooks, 1, fork(1.0, 0.0))
    gone, kept = outlooks.observe(MASK, 2.0), None
    assert len(sent(outlooks)) == 1
    kept = outlooks.observe(MASK, 3.0)
    assert sent(outlooks, changes=2) == []
    outlooks.drop('the process has ended')
    for future in (gone, kept):
        with pytest.raises(LavaError, match='the process has ended'):
            future.result(0.0)
