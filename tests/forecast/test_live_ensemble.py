# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles of a running simulation: members from one state, weighted by outlines."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from disc_flow import same
from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Outline
from lava_ros.forecast.live_ensemble import FIRST_MAPS, LiveEnsemble, LiveEnsembles
from lava_ros.forecast.members import plan_from, run_members
from lava_ros.forecast.probability import EnsembleAccumulator, footprint_by, footprint_of
from lava_ros.forecast.sampling import draw_members, Posterior
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.output.checkpoint import Checkpoint
from live_scene import checkpoints_at, MEMBERS, RULES, SCENE


@pytest.fixture(scope='module', params=['particles'])
def moments(request: pytest.FixtureRequest) -> list[Checkpoint]:
    """Return two checkpoints of one simulation, by default of particles."""
    return checkpoints_at((30.0, 60.0), request.param)


def run(ensemble: LiveEnsemble) -> LiveEnsemble:
    while not ensemble.is_done:
        ensemble.advance(0.05)
    return ensemble


def outline_of(checkpoint: Checkpoint, index: int, after: float) -> Outline:
    """Return the outline of a member some time after a checkpoint."""
    plan = plan_from(checkpoint, horizon=120.0, threshold=0.01)
    member = draw_members(SCENE, index + 1)[index]
    (fields,) = run_members(plan, [member], device='cpu')
    reached = footprint_by(footprint_of(fields, plan), plan, after)
    return Outline(checkpoint.time + after, reached, np.ones_like(reached))


@pytest.mark.parametrize('moments', METHODS, indirect=True)
def test_live_members_equal_those_of_an_ensemble(moments: list[Checkpoint]) -> None:
    ensemble = LiveEnsemble(moments[0], members=MEMBERS, **RULES)
    assert (ensemble.count, ensemble.asked, ensemble.progress) == (0, MEMBERS, 0.0)
    maps = run(ensemble).maps()
    plan = plan_from(moments[0], horizon=120.0, threshold=0.01)
    tally = EnsembleAccumulator(plan)
    for fields in run_members(plan, draw_members(SCENE, MEMBERS), device='cpu'):
        tally.add(footprint_of(fields, plan))
    assert same(maps, tally.maps())
    assert 0.0 < np.nanmax(maps.probability[maps.probability < 100.0])


def test_ensemble_raises_for_too_many_particles(moments: list[Checkpoint]) -> None:
    with pytest.raises(LavaError, match='member 0 is .*max_particles'):
        run(LiveEnsemble(moments[0], members=2, max_particles=3, **RULES))


@pytest.mark.parametrize(('exact', 'drawn'), [
    ((), {'effusion_rate', 'temperature', 'viscosity', 'position', 'density'}),
    (('viscosity', 'effusion_rate'), {'temperature', 'position', 'density'}),
    (('all',), {'effusion_rate'}),
])
def test_live_members_draw_what_is_neither_given_nor_exact(
    moments: list[Checkpoint], exact: tuple[str, ...], drawn: set[str]
) -> None:
    scene = moments[0].scene
    open_ = replace(scene, uncertainty=replace(scene.uncertainty, material='etna_basalt'))
    ensemble = LiveEnsemble(replace(moments[0], scene=open_), members=2, exact=exact, **RULES)
    assert set(ensemble.plan.scene.uncertainty.drawn) == set(ensemble.inputs['drawn']) == drawn
    assert run(ensemble).maps().members == 2


class Bench:
    """Ensembles, and their answers."""

    def __init__(self) -> None:
        self.answers: list[dict[str, Any]] = []
        self.ensembles = LiveEnsembles(
            lambda name, **values: self.answers.append({'answer': name, **values})
        )

    def run(self, number: int, checkpoint: Checkpoint, **changes: Any) -> list[dict[str, Any]]:
        """Order an ensemble, run it and return its answers."""
        self.order(number, checkpoint, **changes)
        while self.ensembles.is_busy:
            self.ensembles.advance(0.05)
        return self.take_answers()

    def order(self, number: int, checkpoint: Checkpoint, **changes: Any) -> None:
        usual = {'changes': 1, 'posterior': None, 'outlines': 0, 'members': MEMBERS, **RULES}
        self.ensembles.order(checkpoint, number=number, **usual | changes)

    def take_answers(self) -> list[dict[str, Any]]:
        """Return the answers since the last call."""
        answers, self.answers = self.answers, []
        return answers


def discharges(posterior: Posterior) -> np.ndarray:
    """Return the logarithms of the factors of the next members."""
    drawn = draw_members(SCENE, 64, posterior=posterior)
    return np.log([member.discharge for member in drawn])


def test_outline_weighs_members_and_the_next_are_drawn_near_them(
    moments: list[Checkpoint],
) -> None:
    bench, outline = Bench(), outline_of(moments[0], 2, 60.0)
    first = bench.run(1, moments[0])
    assert [item['maps'].members for item in first] == [FIRST_MAPS, MEMBERS]
    assert [item['is_done'] for item in first] == [False, True]
    assert first[-1]['maps'].effective_members == pytest.approx(MEMBERS)

    bench.ensembles.observe(7, outline)
    weighed, again = bench.take_answers()
    assert (weighed['answer'], weighed['number'], weighed['outlines']) == ('weighed', 7, 1)
    parents, weights = weighed['posterior'].parents, weighed['posterior'].weights
    assert len(parents) == MEMBERS and weights[2] == weights.max()
    assert 0.0 < weighed['jaccard_mean'] < 1.0
    assert weighed['effective_before'] == MEMBERS
    assert (again['answer'], again['number'], again['outlines']) == ('ensemble', 1, 1)
    assert again['maps'].effective_members < MEMBERS - 1.0

    posterior = weighed['posterior']
    assert posterior.effective_members == pytest.approx(again['maps'].effective_members)
    truth, drawn = np.log(parents[2].discharge), discharges(posterior)
    before = np.log([member.discharge for member in draw_members(SCENE, 64)])
    assert np.abs(drawn - truth).mean() < 0.7 * np.abs(before - truth).mean()

    later = bench.run(2, moments[1])
    # maps of fewer members would be worse than the current ones
    assert [(item['number'], item['maps'].members) for item in later] == [(2, MEMBERS)]
    assert later[0]['maps'].effective_members == MEMBERS
    assert later[0]['outlines'] == 1
    # the members of the newest population are those that have learnt from the first outline
    bench.ensembles.observe(8, outline_of(moments[0], 2, 90.0))
    sharper, latest = bench.take_answers()
    assert (sharper['outlines'], latest['number'], latest['outlines']) == (2, 2, 2)
    assert sharper['posterior'].parents == draw_members(SCENE, MEMBERS, posterior=posterior)
    assert latest['maps'].effective_members < MEMBERS
    assert np.abs(discharges(sharper['posterior']) - truth).mean() < np.abs(drawn - truth).mean()
    # an outline from before their start weights the earlier members
    bench.ensembles.observe(9, outline_of(moments[0], 2, 29.0))
    old, _ = bench.take_answers()
    assert old['posterior'].parents == parents and old['outlines'] == 2
    assert old['posterior'].generation == sharper['posterior'].generation + 1

    other = bench.run(3, moments[0], changes=2)
    assert [member.discharge for member in parents] == [
        member.discharge for member in draw_members(SCENE, MEMBERS)
    ]
    assert other[-1]['outlines'] == 0
    assert other[-1]['maps'].probability.tolist() == first[-1]['maps'].probability.tolist()
    # a restarted process receives the known distribution
    restarted = Bench().run(
        1, moments[1], posterior=posterior, outlines=sharper['outlines']
    )
    assert same(restarted[-1]['maps'], later[0]['maps'])
    assert restarted[-1]['outlines'] == 2


def test_outlines_that_come_late_are_not_forgotten(moments: list[Checkpoint]) -> None:
    bench = Bench()
    bench.run(1, moments[0])
    bench.ensembles.observe(1, outline_of(moments[0], 2, 20.0))
    bench.run(2, moments[1])
    # from before the start of the new members, which therefore know nothing of it
    bench.ensembles.observe(2, outline_of(moments[0], 2, 29.0))
    bench.take_answers()
    bench.ensembles.observe(3, outline_of(moments[0], 2, 90.0))
    weighed, _ = bench.take_answers()
    assert weighed['outlines'] == 3
    assert weighed['posterior'].parents == draw_members(SCENE, MEMBERS)


def test_an_outline_waits_for_an_ensemble_or_is_refused(moments: list[Checkpoint]) -> None:
    bench, outline = Bench(), outline_of(moments[1], 1, 60.0)
    bench.ensembles.observe(1, outline)
    (nothing,) = bench.take_answers()
    assert nothing['answer'] == 'outline_refused' and 'there is none' in nothing['error'].expected
    bench.order(1, moments[1])
    bench.ensembles.advance(0.05)
    bench.ensembles.observe(2, outline)
    bench.ensembles.observe(3, Outline(moments[1].time - 5.0, outline.lava, outline.known))
    (early,) = [item for item in bench.take_answers() if item['answer'] == 'outline_refused']
    assert early['number'] == 3 and early['error'].field == 'observed_outline.header.stamp'
    while bench.ensembles.is_busy:
        bench.ensembles.advance(0.05)
    assert [item['answer'] for item in bench.take_answers()][-2:] == ['weighed', 'ensemble']
    elsewhere = np.zeros_like(outline.lava)
    elsewhere[0, -1] = True
    bench.ensembles.observe(4, Outline(outline.time, elsewhere, outline.known))
    (refused,) = bench.take_answers()
    assert 'No member touches' in refused['error'].value
    # an outline that waits when the scene changes is refused
    bench.order(2, moments[0], changes=2)
    bench.ensembles.advance(0.05)
    bench.ensembles.observe(5, outline_of(moments[0], 1, 60.0))
    bench.take_answers()
    bench.ensembles.drop()
    (dropped,) = bench.take_answers()
    assert (dropped['answer'], dropped['number']) == ('outline_refused', 5)
