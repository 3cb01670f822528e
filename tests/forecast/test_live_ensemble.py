# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles of a running simulation: members from one moment, weighed by what is seen."""

from typing import Any

import numpy as np
import pytest

from disc_flow import same
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.live_ensemble import FIRST_MAPS, LiveEnsemble, LiveEnsembles
from lava_ros.forecast.members import plan_from, run_members
from lava_ros.forecast.probability import footprint_of, reached_by, Tally
from lava_ros.forecast.sampling import draw_members
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.checkpoint import Checkpoint

SCENE = Scene(
    Terrain(np.tile(500.0 - 2.0 * np.arange(30), (20, 1)), 10.0),
    (Vent((55.0, 100.0), 20.0, radius=15.0),),
    Lava(viscosity=1e4),
    uncertainty=uncertainty_from_dict(
        {'discharge': {'distribution': 'loguniform', 'low': 0.2, 'high': 5.0}}
    ),
)

RULES: dict[str, Any] = {'horizon': 120.0, 'threshold': 0.01, 'device': 'cpu'}

MEMBERS = 5


@pytest.fixture(scope='module')
def moments() -> list[Checkpoint]:
    """Two moments of one simulation."""
    simulation = Simulation(
        SCENE, effects=Effects(), accuracy=Accuracy(spacing=10.0, thickness=1.0), device='cpu'
    )
    found = []
    for time in (30.0, 60.0):
        simulation.advance(time)
        found.append(simulation.checkpoint())
    return found


def run(ensemble: LiveEnsemble) -> LiveEnsemble:
    """Run all members."""
    while not ensemble.is_done:
        ensemble.advance(0.05)
    return ensemble


def seen_by(checkpoint: Checkpoint, index: int, after: float) -> Outline:
    """What a member has reached some time after a moment."""
    plan = plan_from(checkpoint, horizon=120.0, threshold=0.01)
    member = draw_members(SCENE, index + 1)[index]
    (fields,) = run_members(plan, [member], device='cpu')
    reached = reached_by(footprint_of(fields, plan), plan, after)
    return Outline(checkpoint.time + after, reached, np.ones_like(reached))


def test_members_are_those_of_an_ensemble(moments: list[Checkpoint]) -> None:
    """The maps are the ones that drawing, running and counting make, slice by slice or not."""
    ensemble = LiveEnsemble(moments[0], members=MEMBERS, **RULES)
    assert (ensemble.count, ensemble.asked, ensemble.progress) == (0, MEMBERS, 0.0)
    maps = run(ensemble).maps(None)
    plan = plan_from(moments[0], horizon=120.0, threshold=0.01)
    tally = Tally(plan)
    for fields in run_members(plan, draw_members(SCENE, MEMBERS), device='cpu'):
        tally.add(footprint_of(fields, plan))
    assert same(maps, tally.maps())
    assert 0.0 < np.nanmax(maps.probability[maps.probability < 100.0])


def test_members_that_would_be_late_are_left_out(moments: list[Checkpoint]) -> None:
    """One there is in any case; the maps say of how many they are. Particles are limited too."""
    ensemble = run(LiveEnsemble(moments[0], members=MEMBERS, deadline=1e-3, **RULES))
    assert (ensemble.count, ensemble.asked) == (1, MEMBERS)
    assert ensemble.maps(None).members == 1
    assert run(LiveEnsemble(moments[0], members=2, deadline=1e4, **RULES)).count == 2
    with pytest.raises(LavaError, match='member 0 is .*max_particles'):
        run(LiveEnsemble(moments[0], members=2, max_particles=3, **RULES))


class Bench:
    """Ensembles, and what they have answered."""

    def __init__(self) -> None:
        self.answers: list[dict[str, Any]] = []
        self.ensembles = LiveEnsembles(
            lambda name, **values: self.answers.append({'answer': name, **values})
        )

    def run(self, number: int, checkpoint: Checkpoint, **changes: Any) -> list[dict[str, Any]]:
        """Order an ensemble, run it and return what it answered."""
        self.order(number, checkpoint, **changes)
        while self.ensembles.is_busy:
            self.ensembles.advance(0.05)
        return self.said()

    def order(self, number: int, checkpoint: Checkpoint, **changes: Any) -> None:
        """Order an ensemble."""
        usual = {'changes': 1, 'agreement': None, 'outlines': 0, 'members': MEMBERS, **RULES}
        self.ensembles.order(checkpoint, number=number, **usual | changes)

    def said(self) -> list[dict[str, Any]]:
        """What has been answered since the last time."""
        answers, self.answers = self.answers, []
        return answers


def test_what_is_seen_weighs_members_now_and_later(moments: list[Checkpoint]) -> None:
    """Maps are told again at once; the next ensemble keeps the weights, another scene does not."""
    bench, outline = Bench(), seen_by(moments[0], 2, 60.0)
    first = bench.run(1, moments[0])
    assert [item['maps'].members for item in first] == [FIRST_MAPS, MEMBERS]
    assert [item['is_done'] for item in first] == [False, True]
    assert first[-1]['maps'].effective_members == pytest.approx(MEMBERS)

    bench.ensembles.observe(7, outline)
    weighed, again = bench.said()
    assert (weighed['answer'], weighed['number'], weighed['outlines']) == ('weighed', 7, 1)
    assert int(np.argmax(weighed['agreement'])) == 2
    assert 0.0 < weighed['jaccard_mean'] < 1.0
    assert (again['answer'], again['number'], again['outlines']) == ('ensemble', 1, 1)
    assert again['maps'].effective_members < MEMBERS - 1.0

    later = bench.run(2, moments[1])
    # one at a time would be worse than the one there is
    assert [(item['number'], item['maps'].members) for item in later] == [(2, MEMBERS)]
    assert later[0]['maps'].effective_members == pytest.approx(again['maps'].effective_members)
    # the ensemble that has gone on for longest tells members best
    bench.ensembles.observe(8, seen_by(moments[0], 2, 90.0))
    sharper, told = bench.said()
    assert (sharper['outlines'], told['number']) == (2, 2)
    assert int(np.argmax(sharper['agreement'])) == 2

    other = bench.run(3, moments[0], changes=2)
    assert other[-1]['maps'].effective_members == pytest.approx(MEMBERS)
    assert other[-1]['outlines'] == 0
    # a process that has just been started is told what was known
    restarted = Bench().run(
        1, moments[0], agreement=sharper['agreement'], outlines=sharper['outlines']
    )
    assert restarted[-1]['maps'].effective_members < MEMBERS - 1.0


def test_an_outline_waits_for_an_ensemble_or_is_refused(moments: list[Checkpoint]) -> None:
    """It is judged when all members are there; none covers a time before the first."""
    bench, outline = Bench(), seen_by(moments[1], 1, 60.0)
    bench.ensembles.observe(1, outline)
    (nothing,) = bench.said()
    assert nothing['answer'] == 'outline_refused' and 'there is none' in nothing['error'].expected
    bench.order(1, moments[1])
    bench.ensembles.advance(0.05)
    bench.ensembles.observe(2, outline)
    bench.ensembles.observe(3, Outline(moments[1].time - 5.0, outline.lava, outline.known))
    (early,) = [item for item in bench.said() if item['answer'] == 'outline_refused']
    assert early['number'] == 3 and early['error'].field == 'observed_outline.header.stamp'
    while bench.ensembles.is_busy:
        bench.ensembles.advance(0.05)
    assert [item['answer'] for item in bench.said()][-2:] == ['weighed', 'ensemble']
    elsewhere = np.zeros_like(outline.lava)
    elsewhere[0, -1] = True
    bench.ensembles.observe(4, Outline(outline.time, elsewhere, outline.known))
    (refused,) = bench.said()
    assert 'no member touches' in refused['error'].value
    # what waits when the scene changes is not forgotten without a word
    bench.order(2, moments[0], changes=2)
    bench.ensembles.advance(0.05)
    bench.ensembles.observe(5, seen_by(moments[0], 1, 60.0))
    bench.said()
    bench.ensembles.drop()
    (dropped,) = bench.said()
    assert (dropped['answer'], dropped['number']) == ('outline_refused', 5)
