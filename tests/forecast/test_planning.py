# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The accuracy that a time limit affords, and `lava plan`."""

import json
import re

import numpy as np
import pytest

from command_line import lava, refused
from geodata import write_scene
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast import pilot_runs as pilots
from lava_ros.forecast import planning as affordable
from lava_ros.forecast.pilot_runs import N_COMPARISON_TIMES, Pilot
from lava_ros.forecast.planning import FINEST, plan_within, PLANNED_TIME_FRACTION
from lava_ros.scene import Lava, Scene, Terrain, Vent

EFFECTS, SLOW = Effects(), Effects(green=True)

SCENE = Scene(
    Terrain(np.zeros((40, 40)), 10.0), (Vent((200.0, 200.0), 20.0),), lava=Lava(viscosity=1e6)
)


def _machine(monkeypatch, base=2e-4, each=1e-7, slow_from=None, slower=4.0, worse=0.0):
    """Replace runs by those of a machine of known speed; return the list of pilots as they run.

    At or above the refinement ``slow_from`` the scene needs effects that take ``slower`` times
    as long. Evaluations grow exponentially with ``worse``.
    """
    asked = []
    usual = pilots.spacing_at(SCENE, 1.0, 3600.0)

    def effects_for(scene, forced, *, accuracy, horizon):
        is_slow = slow_from is not None and accuracy.spacing <= usual / slow_from
        return SLOW if is_slow else EFFECTS

    def run_at(scene, refinement, horizon, *, device, wall_limit, effects=None, clock=None):
        accuracy = pilots.accuracy_at(scene, refinement, horizon)
        effects = effects or effects_for(scene, {}, accuracy=accuracy, horizon=horizon)
        asked.append((refinement, effects))
        particles = 1000.0 * refinement**2
        evaluations = 800.0 * refinement * np.exp(worse * refinement)
        # particles are emitted at a constant rate
        fraction = np.linspace(0.0, 1.0, 41)
        times = evaluations * (base * fraction + each * particles * fraction**2)
        times *= slower if effects == SLOW else 1.0
        columns = [fraction, times, evaluations * fraction, particles * fraction]
        progress = np.stack(columns, axis=1)[: np.count_nonzero(times <= wall_limit) + 1]
        spent = progress[-1, 1]
        # 10000 cells are right; all errors are beyond their border
        covered = np.arange(20_000) < 10_000.0 * (1.0 + 0.04 / refinement)
        covered = np.tile(covered, (int(N_COMPARISON_TIMES * progress[-1, 0] + 1e-9), 1, 1))
        return Pilot(refinement, spent, progress[-1, 2], effects, covered, spent, 0.0, progress)

    monkeypatch.setattr(affordable, 'run_at', run_at)
    monkeypatch.setattr(affordable, 'effects_for', effects_for)
    return asked


def _wall_time(refinement, base=2e-4, each=1e-7):
    return 800.0 * refinement * (base + each * 1000.0 * refinement**2)


def _plan(within, **options):
    return plan_within(SCENE, **{'within': within, 'horizon': 3600.0, 'device': 'cpu', **options})


@pytest.mark.parametrize('within', [0.15, 0.4, 1.0, 2.0])
def test_plan_uses_its_time_and_predicts_its_error(monkeypatch, within):
    _machine(monkeypatch)
    plan = _plan(within)
    assert not plan.is_finest and plan.spent <= 2.2 * within
    assert _wall_time(plan.refinement) == pytest.approx(PLANNED_TIME_FRACTION * within, rel=0.05)
    assert plan.wall_time == pytest.approx(_wall_time(plan.refinement), rel=0.03)
    assert 0.5 < plan.error / (0.04 / plan.refinement) < 2.0
    assert plan.spacing == pilots.spacing_at(SCENE, plan.refinement, 3600.0)
    assert (plan.members, plan.sampling_error) == (1, 0.0)


def test_plan_with_ample_time_is_the_finest(monkeypatch):
    _machine(monkeypatch)
    plan = _plan(1000.0)
    assert plan.is_finest and plan.refinement == pytest.approx(FINEST)
    assert plan.preset == 'fine'


def test_plan_repeats_pilots_with_the_effects_of_finer_runs(monkeypatch):
    asked = _machine(monkeypatch, slow_from=0.9)
    plan = _plan(2.0)
    assert plan.refinement > 0.9
    planned = PLANNED_TIME_FRACTION * 2.0
    assert 4.0 * _wall_time(plan.refinement) == pytest.approx(planned, rel=0.05)
    assert plan.wall_time == pytest.approx(PLANNED_TIME_FRACTION * 2.0, rel=0.05)
    assert len([effects for _, effects in asked if effects == SLOW]) == 2
    assert plan.pilots == len(asked)


@pytest.mark.parametrize(('slower', 'is_finer'), [(3.4, True), (5.0, False)])
def test_plan_accepts_a_jump_in_cost_that_uses_the_time_better(monkeypatch, slower, is_finer):
    _machine(monkeypatch, slow_from=0.9, slower=slower)
    within = _wall_time(0.9) / 0.25
    plan = _plan(within)
    assert (plan.refinement > 0.9) == is_finer
    assert plan.wall_time <= 0.92 * within


@pytest.mark.parametrize('within', [1.0, 3.0])
@pytest.mark.parametrize('worse', [1.0, 3.0])
def test_pilot_near_the_plan_corrects_it(monkeypatch, within, worse):
    asked = _machine(monkeypatch, worse=worse)
    plan = _plan(within)
    time = np.exp(worse * plan.refinement) * _wall_time(plan.refinement)
    assert 0.6 * within < time < 0.95 * within
    assert plan.wall_time == pytest.approx(time, rel=0.2)
    nearest = min(abs(np.log(refinement / plan.refinement)) for refinement, _ in asked)
    assert nearest <= np.log(affordable.PARTIAL_RUN_REFINEMENT_RATIO)
    assert plan.pilots == len(asked)


def test_plan_may_switch_off_a_slow_effect(monkeypatch):
    for fraction, gain in ((0.3, 1.2), (0.1, 1.5)):
        _machine(monkeypatch, slow_from=0.9, slower=40.0)
        within = _wall_time(0.9) / fraction
        kept = _plan(within)
        assert kept.refinement < 0.9 and kept.forced == {}
        plan = _plan(within, may_force=True)
        assert plan.forced == {'green': False}
        assert plan.refinement >= gain * kept.refinement
        assert plan.refinement <= affordable.WITHOUT * 0.9
        assert plan.wall_time == pytest.approx(_wall_time(plan.refinement), rel=0.05)
        assert plan.wall_time <= 1.01 * PLANNED_TIME_FRACTION * within


def test_members_divide_the_time(monkeypatch):
    _machine(monkeypatch)
    plan = _plan(10.0, members=20)
    planned = PLANNED_TIME_FRACTION * 10.0
    assert 20 * _wall_time(plan.refinement) == pytest.approx(planned, rel=0.05)
    assert plan.sampling_error == pytest.approx(0.5 / np.sqrt(20))
    best = _plan(10.0, members=None)
    assert best.wall_time <= PLANNED_TIME_FRACTION * 10.0 * 1.001
    total = np.hypot(best.error, best.sampling_error)
    for members in (2, 10, 30, 200):
        other = _plan(10.0, members=members)
        assert total <= np.hypot(other.error, other.sampling_error) * 1.02


def test_too_little_time_is_refused(monkeypatch):
    _machine(monkeypatch)
    for within, members in ((0.01, 1), (0.5, 50)):
        with pytest.raises(LavaError) as caught:
            _plan(within, members=members)
        assert caught.value.field == 'within'
    with pytest.raises(LavaError, match=r'the coarsest run reaches 32 % of the horizon'):
        _plan(0.01)
    for arguments in ({'within': 0.0}, {'horizon': -1.0}, {'members': 0}):
        with pytest.raises(LavaError):
            _plan(**{'within': 1.0, **arguments})


@pytest.fixture
def scene_file(tmp_path):
    """Write `SCENE` to a file."""
    vent = {'position': [200.0, 200.0], 'discharge': 20.0}
    scene = {'vents': [vent], 'lava': {'viscosity': 1e6}}
    return write_scene(tmp_path, SCENE.terrain.elevation, 10.0, scene)


def test_command_names_a_time_that_is_too_short_as_typed(monkeypatch, scene_file):
    _machine(monkeypatch)
    words = ('plan', scene_file, '--within', '0.01s', '--horizon', '1h', '--device', 'cpu')
    assert "--within is '0.01s'" in refused(*words)


@pytest.mark.nightly
def test_command_plans_with_real_pilots(scene_file, tmp_path):
    words = ['plan', scene_file, '--within', '3s', '--horizon', '10min', '--device', 'cpu']
    assert lava(*words, '--json', tmp_path / 'plan.json')[0] == 0
    assert 0.0 < json.loads((tmp_path / 'plan.json').read_text())['wall_time'] <= 3.0


def test_command_prints_the_plan_and_effects_that_are_off(monkeypatch, scene_file, tmp_path):
    _machine(monkeypatch, slow_from=0.45, slower=40.0)
    words = ['plan', scene_file, '--within', '1s', '--device', 'cpu']
    status, printed, _ = lava(*words, '--json', tmp_path / 'plan.json')
    assert status == 0
    plan = json.loads((tmp_path / 'plan.json').read_text())
    assert plan['forced'] == {'green': False}
    assert 'effect green off: the choice for the scene takes too long' in printed
    assert re.search(r'^pilot: spacing [0-9.]+ m took ', printed, re.MULTILINE)
    assert f'preset {plan["preset"]}, spacing {plan["spacing"]:.3g} m\n' in printed
    for option, value in (('--json', tmp_path / 'none/plan.json'), ('--members', 'many')):
        status, printed, error = lava(*words, option, value)
        assert (status, printed) == (2, '') and f'{option} is' in error
