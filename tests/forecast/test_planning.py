# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The accuracy one can afford: what pilots foresee, and what the command says."""

import json
import re

import numpy as np
import pytest

from lava_ros.cli import main as cli
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast import pilots
from lava_ros.forecast import planning as affordable
from lava_ros.forecast.pilots import MARKS, Pilot
from lava_ros.forecast.planning import afford, FINEST, USED
from lava_ros.scene import Lava, Scene, Terrain, Vent

EFFECTS, DEAR = Effects(), Effects(green=True)

SCENE = Scene(
    Terrain(np.zeros((40, 40)), 10.0), (Vent((200.0, 200.0), 20.0),), lava=Lava(viscosity=1e6)
)


def _machine(
    monkeypatch, base=2e-4, each=1e-7, dearer=None, slower=4.0, worse=0.0, leap=np.inf, late=1.0,
    error=lambda refinement: 0.04 / refinement,
):
    """Runs on a machine of a known speed, of a flow with a known error, without running.

    From the refinement ``dearer`` on the scene calls for physics that take ``slower`` times as
    long. Evaluations grow faster than by any power with ``worse``. Beyond the refinement ``leap``
    runs take four times as long; those from 1 on take ``late`` times as long from 0.4 on.
    """
    asked = []
    usual = pilots.spacing_at(SCENE, 1.0, 3600.0)

    def effects_for(scene, forced, *, accuracy, horizon):
        is_dear = dearer is not None and accuracy.spacing <= usual / dearer
        return DEAR if is_dear else EFFECTS

    def run_at(scene, refinement, horizon, *, device, wall_limit, effects=None, clock=None):
        accuracy = pilots.accuracy_at(scene, refinement, horizon)
        effects = effects or effects_for(scene, {}, accuracy=accuracy, horizon=horizon)
        asked.append((refinement, effects))
        particles = 1000.0 * refinement**2
        evaluations = 800.0 * refinement * np.exp(worse * refinement)
        # particles come at a constant rate
        share = np.linspace(0.0, 1.0, 41)
        times = evaluations * (base * share + each * particles * share**2)
        times *= (slower if effects == DEAR else 1.0) * (4.0 if refinement > leap else 1.0)
        if refinement >= 1.0:
            times += (late - 1.0) * np.maximum(times - np.interp(0.4, share, times), 0.0)
        progress = np.stack([share, times, evaluations * share, particles * share], axis=1)
        progress = progress[: np.count_nonzero(times <= wall_limit) + 1]
        spent = progress[-1, 1]
        # 10000 cells are right; what the coarse ones err is on one side of the border
        covered = np.arange(20_000) < 10_000.0 * (1.0 + error(refinement))
        covered = np.tile(covered, (int(MARKS * progress[-1, 0] + 1e-9), 1, 1))
        return Pilot(
            refinement, spent, progress[-1, 2], effects, covered, spent, 0.0, progress
        )

    monkeypatch.setattr(affordable, 'run_at', run_at)
    monkeypatch.setattr(affordable, 'effects_for', effects_for)
    return asked


def _wall_time(refinement, base=2e-4, each=1e-7):
    return 800.0 * refinement * (base + each * 1000.0 * refinement**2)


def _plan(within, **options):
    return afford(SCENE, **{'within': within, 'horizon': 3600.0, 'device': 'cpu', **options})


@pytest.mark.parametrize('within', [0.15, 0.4, 1.0, 2.0])
def test_a_plan_uses_its_time_and_knows_its_error(monkeypatch, within):
    """It takes the share that it is to take, and errs by half to twice as much as it says."""
    _machine(monkeypatch)
    plan = _plan(within)
    assert not plan.is_finest
    assert _wall_time(plan.refinement) == pytest.approx(USED * within, rel=0.05)
    assert plan.wall_time == pytest.approx(_wall_time(plan.refinement), rel=0.03)
    assert 0.5 < plan.error / (0.04 / plan.refinement) < 2.0
    assert plan.spacing == pilots.spacing_at(SCENE, plan.refinement, 3600.0)
    assert (plan.members, plan.sampling_error) == (1, 0.0)


def test_more_time_than_is_needed(monkeypatch):
    """The finest there is, and it is said that more time would not help."""
    _machine(monkeypatch)
    plan = _plan(1000.0)
    assert plan.is_finest and plan.refinement == pytest.approx(FINEST)
    assert plan.preset == 'fine'


def test_a_plan_goes_on_with_the_effects_of_finer_runs(monkeypatch):
    """Where the time reaches them two pilots are run again with them, and the time is kept."""
    asked = _machine(monkeypatch, dearer=0.9)
    plan = _plan(2.0)
    assert plan.refinement > 0.9
    assert 4.0 * _wall_time(plan.refinement) == pytest.approx(USED * 2.0, rel=0.05)
    assert plan.wall_time == pytest.approx(USED * 2.0, rel=0.05)
    assert len([effects for _, effects in asked if effects == DEAR]) == 2
    assert plan.pilots == len(asked)


def test_a_plan_stays_below_effects_that_are_too_dear(monkeypatch):
    """As fine as it can be without them, and it does not say that this is the finest."""
    _machine(monkeypatch, dearer=0.9, slower=40.0)
    plan = _plan(0.5)
    assert 0.88 < plan.refinement < 0.9 and not plan.is_finest
    assert plan.wall_time == pytest.approx(_wall_time(plan.refinement), rel=0.05)


@pytest.mark.parametrize(('slower', 'is_finer'), [(3.4, True), (5.0, False)])
def test_rather_near_to_the_time_than_half_of_it(monkeypatch, slower, is_finer):
    """A leap in cost that ends below nine tenths is taken where less than half would be used."""
    _machine(monkeypatch, dearer=0.9, slower=slower)
    within = _wall_time(0.9) / 0.25
    plan = _plan(within)
    assert (plan.refinement > 0.9) == is_finer
    assert plan.wall_time <= 0.92 * within


@pytest.mark.parametrize('within', [1.0, 3.0])
@pytest.mark.parametrize('worse', [1.0, 3.0])
def test_a_pilot_near_to_the_plan_corrects_it(monkeypatch, within, worse):
    """A flow whose cost leaves the law of the coarse pilots keeps its time as well."""
    asked = _machine(monkeypatch, worse=worse)
    plan = _plan(within)
    time = np.exp(worse * plan.refinement) * _wall_time(plan.refinement)
    assert 0.6 * within < time < 0.95 * within
    assert plan.wall_time == pytest.approx(time, rel=0.2)
    nearest = min(abs(np.log(refinement / plan.refinement)) for refinement, _ in asked)
    assert nearest <= np.log(affordable.NEAR)
    assert plan.pilots == len(asked)


def test_a_plan_may_do_without_what_does_not_fit(monkeypatch):
    """Where most of the time would be left it is finer, and says what it leaves out."""
    for share, gain in ((0.3, 1.2), (0.1, 1.5)):
        _machine(monkeypatch, dearer=0.9, slower=40.0)
        within = _wall_time(0.9) / share
        kept = _plan(within)
        assert kept.refinement < 0.9 and kept.forced == {}
        plan = _plan(within, may_force=True)
        assert plan.forced == {'green': False}
        assert plan.refinement >= gain * kept.refinement
        assert plan.refinement <= affordable.WITHOUT * 0.9
        assert plan.wall_time == pytest.approx(_wall_time(plan.refinement), rel=0.05)
        assert plan.wall_time <= 1.01 * USED * within


def test_a_leap_in_cost_is_seen_by_a_run_that_is_stopped(monkeypatch):
    """Where runs take four times as long from some refinement on, the plan stays below."""
    _machine(monkeypatch, leap=0.7)
    within = 4.0 * _wall_time(0.7) / 2.0
    plan = _plan(within)
    assert 0.5 < plan.refinement < 0.7 and plan.spent < 3.0 * within


@pytest.mark.parametrize('late', [0.3, 3.0])
def test_what_comes_late_in_fine_runs_alone_is_seen_by_a_whole_one(monkeypatch, late):
    """Neither coarse runs nor the beginning of fine ones show it; the plan keeps its time."""
    _machine(monkeypatch, late=late)
    plan = _plan(1.0)
    whole = affordable.run_at(SCENE, plan.refinement, 3600.0, device='cpu', wall_limit=np.inf)
    assert plan.refinement > 1.0 and plan.spent < 3.0
    assert plan.wall_time == pytest.approx(whole.wall_time, rel=0.15)
    assert 0.6 < whole.wall_time < 0.9


def test_the_error_is_of_runs_as_fine_as_the_plan(monkeypatch):
    """Also where coarse ones err by quite another law."""
    asked = _machine(
        monkeypatch, error=lambda refinement: 0.04 / refinement + 0.5 * (refinement < 0.45)
    )
    plan = _plan(2.0)
    error = 0.04 / plan.refinement
    assert error / 2.0 < plan.error < 2.0 * error
    near = [refinement for refinement, _ in asked if 0.5 < refinement / plan.refinement < 1.3]
    assert len(near) >= 3


def test_pilots_take_no_longer_than_there_is(monkeypatch):
    """Also where finer runs cost hardly more, as on a GPU."""
    for within in (1.0, 5.0):
        _machine(monkeypatch, base=1e-3, each=1e-9)
        plan = _plan(within)
        assert plan.spent <= 2.2 * within
        time = _wall_time(plan.refinement, 1e-3, 1e-9)
        assert plan.is_finest or 0.5 * within <= time <= 1.1 * within


def test_members_share_the_time(monkeypatch):
    """Given members get what is left for each; as many as err least are neither one nor all."""
    _machine(monkeypatch)
    plan = _plan(10.0, members=20)
    assert 20 * _wall_time(plan.refinement) == pytest.approx(USED * 10.0, rel=0.05)
    assert plan.sampling_error == pytest.approx(0.5 / np.sqrt(20))
    best = _plan(10.0, members=None)
    assert best.wall_time <= USED * 10.0 * 1.001
    total = np.hypot(best.error, best.sampling_error)
    for members in (2, 10, 30, 200):
        other = _plan(10.0, members=members)
        assert total <= np.hypot(other.error, other.sampling_error) * 1.02


def test_too_little_time_is_refused(monkeypatch):
    """With what it would take, or that it is more."""
    _machine(monkeypatch)
    for within, members in ((0.01, 1), (0.5, 50)):
        with pytest.raises(LavaError) as caught:
            _plan(within, members=members)
        assert caught.value.field == 'within'
    for arguments in ({'within': 0.0}, {'horizon': -1.0}, {'members': 0}):
        with pytest.raises(LavaError):
            _plan(**{'within': 1.0, **arguments})


def test_the_command_says_what_to_run(tmp_path, capsys):
    """On a real scene: preset, spacing, time and error, also as JSON; wrong words are refused."""
    np.savez(tmp_path / 'hill.npz', elevation=500.0 - np.arange(900.0).reshape(30, 30) / 15.0,
             resolution=20.0)
    scene = tmp_path / 'scene.yaml'
    scene.write_text(
        'terrain: {file: hill.npz}\nlava: {viscosity: 1.0e5}\n'
        'vents: [{position: [300.0, 500.0], discharge: 20.0, radius: 40.0}]\n'
    )
    words = ['plan', str(scene), '--within', '3s', '--horizon', '10min', '--device', 'cpu']
    path = tmp_path / 'plan.json'
    assert cli.main([*words, '--json', str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(re.match(r'pilot: spacing [0-9.]+ m took ', line) for line in lines)
    plan = json.loads(path.read_text())
    assert f'preset {plan["preset"]}, spacing {plan["spacing"]:.3g} m' in lines
    assert 0.0 < plan['wall_time'] <= 3.0
    assert cli.main([*words, '--members', 'many']) == 2
    assert "--members is 'many'" in capsys.readouterr().err


def test_the_command_says_what_is_left_out(monkeypatch, tmp_path, capsys):
    """A plan that does without an effect names it, also in JSON."""
    _machine(monkeypatch, dearer=0.45, slower=40.0)
    np.savez(tmp_path / 'flat.npz', elevation=np.zeros((40, 40)), resolution=10.0)
    scene = tmp_path / 'scene.yaml'
    scene.write_text(
        'terrain: {file: flat.npz}\nvents: [{position: [200.0, 200.0], discharge: 20.0}]\n'
        'lava: {viscosity: 1.0e+6}\n'
    )
    path = tmp_path / 'plan.json'
    words = ['plan', str(scene), '--within', '1s', '--device', 'cpu', '--json', str(path)]
    assert cli.main(words) == 0
    told = capsys.readouterr().out
    assert 'effect green off: what the scene calls for takes too long' in told
    assert json.loads(path.read_text())['forced'] == {'green': False}
    assert cli.main([*words[:-1], str(tmp_path / 'none/plan.json')]) == 2
    told = capsys.readouterr()
    assert '--json' in told.err
    assert 'pilot' not in told.out
