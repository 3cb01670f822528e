# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles of the live simulation: requests, cancellation, maps, and observed outlines."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Mask
from lava_ros.forecast.sampling import Member, Posterior
from lava_ros.layers.forecast import HazardMaps, QUANTILES
from lava_ros.live.ensemble_forecasts import EnsembleForecasts, ForecastRules
from lava_ros.live.session import Fork
from lava_ros.scene import Lava, Scene, Terrain

SCENE = Scene(Terrain(np.zeros((4, 5)), 10.0), lava=Lava.paper())

RULES = ForecastRules(horizon=60.0, threshold=0.01, max_age=30.0, share=1.0, max_particles=1000)

POSTERIOR = Posterior((Member(0), Member(1), Member(2)), np.array([0.0, 1.0, 2.0]))

MASK = Mask(np.eye(4, 5) > 0.0, np.ones((4, 5), dtype=bool), 10.0, (0.0, 0.0))


def fork(clock, time, changes=1):
    """Return a copy of the state at a time of the clock [s]."""
    return Fork(SimpleNamespace(scene=SCENE, time=time), changes, clock, 0.01)


def order(ensembles, number, made, members=8):
    return ensembles.request(made, number, replace(RULES, members=members))


def sent(ensembles, changes=1, now=1e9):
    """Return the outlines that are sent to the process at a simulated time [s]."""
    orders = []
    ensembles.send(
        lambda name, **values: orders.append((name, values)), changes=changes, time_scale=2.0,
        now=now,
    )
    return orders


def test_stamp_of_an_outline_becomes_simulated_time():
    ensembles, numbers = EnsembleForecasts(), set()
    for number, (clock, time) in enumerate(((100.0, 20.0), (110.0, 30.0), (120.0, 30.0)), 1):
        order(ensembles, number, fork(clock, time))
    for clock, time in ((105.0, 25.0), (115.0, 30.0), (123.0, 36.0)):
        done = ensembles.observe(MASK, clock)
        ((name, order_of_it),) = sent(ensembles)
        outline = order_of_it['outline']
        assert name == 'outline' and outline.time == pytest.approx(time)
        np.testing.assert_array_equal(outline.lava, MASK.lava)
        assert outline.known.all() and not done.done()
        numbers.add(order_of_it['number'])
        ensembles.handle_reply(
            'weighed', number=order_of_it['number'], posterior=POSTERIOR, outlines=1,
            jaccard_mean=0.4, effective_before=3.0,
        )
        assert 'of 3 members that counted like 3.0 of equal weight, 1.8' in done.result(0.0)
    assert len(numbers) == 3
    early = ensembles.observe(MASK, 99.0)
    assert sent(ensembles) == []
    with pytest.raises(LavaError, match='1.0 s before the first forecast of this scene'):
        early.result(0.0)
    assert (ensembles.status.outlines, ensembles.status.jaccard_mean) == (1, 0.4)
    assert ensembles.status.members_left == pytest.approx(1.8)
    # the next ensemble draws new members, even from the same state
    assert ensembles.is_busy and not ensembles.is_wanted(1, 30.0)
    ensembles.cancel('it is replaced')
    assert order(ensembles, 4, fork(120.0, 30.0))['posterior'] is POSTERIOR
    assert order(ensembles, 5, fork(130.0, 40.0, changes=2)) is None
    assert ensembles.status.members_left is None
    # a time of the previous scene
    early = ensembles.observe(MASK, 125.0)
    assert sent(ensembles, changes=2) == []
    with pytest.raises(LavaError, match='5.0 s before the first forecast of this scene'):
        early.result(0.0)


@pytest.mark.parametrize(
    ('forks', 'clock', 'time'),
    [
        # the simulation is paused at 26 s, or slower than its clock
        (((100.0, 20.0),), 2000.0, 26.0),
        # the clock has gone back, and ahead by more than simulated time follows
        (((100.0, 20.0), (50.0, 22.0)), 51.0, 24.0),
        (((100.0, 20.0), (50.0, 22.0), (90.0, 24.0)), 70.0, 23.0),
        (((100.0, 20.0), (50.0, 22.0)), 49.0, None),
    ],
)
def test_outline_is_not_compared_with_a_time_that_is_not_simulated(forks, clock, time):
    ensembles = EnsembleForecasts()
    for number, (stamp, reached) in enumerate(forks, 1):
        order(ensembles, number, fork(stamp, reached))
    ensembles.observe(MASK, clock)
    times = [values['outline'].time for _, values in sent(ensembles, now=26.0)]
    assert times == ([] if time is None else [pytest.approx(time)])


def test_one_ensemble_is_requested_per_state():
    ensembles = EnsembleForecasts()
    assert order(ensembles, 1, fork(1.0, 0.0), members=0) is None
    first = order(ensembles, 2, fork(2.0, 5.0))
    assert (first['members'], first['posterior']) == (8, None)
    assert order(ensembles, 3, fork(3.0, 6.0)) is None
    ensembles.handle_reply('progress', progress=0.9, ensemble=0.5)
    assert ensembles.status.progress == 0.5
    known = np.zeros(SCENE.terrain.shape)
    quantiles = dict.fromkeys(QUANTILES, known)
    maps = HazardMaps(known, quantiles, quantiles, known, 8, 8.0, 0.5)
    answer = {
        'number': 2, 'stamp_ns': first['stamp_ns'], 'time': 5.0, 'horizon': 60.0,
        'threshold': 0.01, 'maps': maps, 'asked': 8, 'is_done': True, 'outlines': 0,
        'duration': 3.0,
    }
    assert not ensembles.handle_reply('ensemble', changes=0, **answer)
    # maps of its first members, and of an earlier ensemble with new weights, do not end it
    for part in ({'is_done': False}, {'number': 1}):
        assert ensembles.handle_reply('ensemble', changes=1, **(answer | part))
        assert ensembles.is_busy and ensembles.status.count == 0
    assert ensembles.handle_reply('ensemble', changes=1, **answer)
    ensembles.handle_reply('progress', progress=0.9, ensemble=0.5)
    assert ensembles.status.progress is None
    latest = ensembles.latest
    assert (latest.time, latest.stamp_ns, latest.changes) == (5.0, 2_000_000_000, 1)
    assert ensembles.status.count == 1
    assert ensembles.is_wanted(1, 6.0) and not ensembles.is_wanted(1, 5.0)
    order(ensembles, 4, fork(4.0, 7.0))
    ensembles.handle_reply('ensemble_refused', reason='nothing is uncertain')
    assert ensembles.status.error == 'nothing is uncertain'
    assert ensembles.handle_reply('ensemble', changes=1, **answer)
    assert ensembles.status.error == ''
    assert not ensembles.is_wanted(1, 9.0) and ensembles.is_wanted(2, 9.0)
    assert order(ensembles, 5, fork(5.0, 9.0, changes=2))['members'] == 8
    assert ensembles.status.error == ''


def test_pending_outlines_fail_when_the_process_ends():
    ensembles = EnsembleForecasts()
    order(ensembles, 1, fork(1.0, 0.0))
    gone = ensembles.observe(MASK, 2.0)
    assert len(sent(ensembles)) == 1
    kept = ensembles.observe(MASK, 3.0)
    assert sent(ensembles, changes=2) == []
    ensembles.cancel('the process has ended')
    for future in (gone, kept):
        with pytest.raises(LavaError, match='the process has ended'):
            future.result(0.0)
