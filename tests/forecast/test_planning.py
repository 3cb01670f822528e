# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The accuracy that a time limit affords, and `lava plan`."""

from dataclasses import replace
import itertools
import json
import math
import re

import numpy as np
import pytest

from command_line import lava, refused
from geodata import write_scene
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError
from lava_ros.forecast import pilot_runs, pilot_search
from lava_ros.forecast.partner_runs import coarser_partner_of
from lava_ros.forecast.pilot_runs import Pilot
from lava_ros.forecast.pilot_search import FINEST, PLANNING_FRACTION
from lava_ros.forecast.planning import plan_runs, PLANNED_TIME_FRACTION, USEFUL
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import Uncertainty, uncertainty_from_dict
from lava_ros.simulation.numerical_error import Areas, PARTICLE_ORDER

X, Y = np.meshgrid(np.arange(60) * 10.0, np.arange(40) * 10.0)
SCENE = Scene(
    Terrain(3.0 * np.sin(X / 48.0) * np.cos(Y / 48.0), 10.0), (Vent((200.0, 200.0), 20.0),),
    lava=Lava.paper(viscosity=1e6),
)

#: A line of the printed table.
ROW = r'^ *([0-9.]+) m +([0-9.]+) % .* m?s(?: +(<- plan|draft|standard|fine|, )*)?$'

#: Error -ln J of the inundated area at a refinement of 1 by the particles, and the ground's part.
PARTICLES, GROUND = 0.02, 0.01


def _machine(monkeypatch, base=2e-4, each=1e-7, ground=GROUND):
    """Replace runs by those of a machine of known speed; return the time that all have taken."""
    spent = [0.0]

    def run_at(
        scene, refinement, horizon, *, device, accuracy=None, effects=None, wall_limit=np.inf,
        clock=None,
    ):
        # the short run that compiles the kernels has the spacing of the planned runs
        spacing = pilot_runs.spacing_at(SCENE, refinement, 3600.0)
        assert scene.terrain is not SCENE.terrain or accuracy.spacing == spacing
        if horizon < 1.0:
            return None
        time = _wall_time(refinement, base, each)
        spent[0] += min(time, wall_limit)
        if time > wall_limit:
            return None
        # on coarser ground the difference is three times the error
        is_coarse = scene.terrain is not SCENE.terrain
        more = max(scene.vents[0].peak / 20.0, scene.lava.viscosity / 1e6) - 1.0
        error = PARTICLES * refinement**-PARTICLE_ORDER
        error += more + 3.0 * ground * is_coarse
        cells = np.log(np.maximum(np.arange(4e6).reshape(1, -1), 1.0) / 1e6)
        half = 0.5 * PARTICLES * refinement**-PARTICLE_ORDER
        areas = Areas(cells < error, cells < half)
        evaluations = round(800 * refinement)
        return Pilot(refinement, spacing, time, 0.0, evaluations, 1000, Effects(), areas)

    monkeypatch.setattr(pilot_search, 'run_at', run_at)
    monkeypatch.setattr(
        pilot_search, 'partner_of', lambda scene, accuracy, effects: coarser_partner_of(accuracy)
    )
    return spent


def _wall_time(refinement, base=2e-4, each=1e-7):
    return round(800 * refinement) * (base + each * 1000.0 * refinement**2)


def _plan(spent, within, scene=SCENE, **options):
    return plan_runs(scene, **{
        'within': within, 'horizon': 3600.0, 'device': 'cpu', 'clock': lambda: spent[0], **options
    })


@pytest.mark.parametrize('within', [1.0, 2.0, 4.0])
def test_plan_uses_its_time_and_states_both_parts_of_its_error(monkeypatch, within):
    spent = _machine(monkeypatch)
    plan = _plan(spent, within)
    assert not plan.is_finest and plan.spent == spent[0] <= PLANNING_FRACTION * within
    assert _wall_time(plan.refinement) == pytest.approx(PLANNED_TIME_FRACTION * within, rel=0.1)
    assert plan.wall_time == pytest.approx(_wall_time(plan.refinement), rel=0.1)
    area, standing = plan.numerical_error.inundated, plan.numerical_error.standing
    actual = PARTICLES * plan.refinement**-PARTICLE_ORDER
    assert area.lava == pytest.approx(actual, rel=0.02)
    assert area.ground == pytest.approx(GROUND, rel=0.02)
    half = 0.5 * PARTICLES * plan.refinement**-PARTICLE_ORDER
    assert standing.lava == pytest.approx(half, rel=0.02) and standing.ground == 0.0
    assert plan.error == area.total
    assert plan.spacing == pilot_runs.spacing_at(SCENE, plan.refinement, 3600.0)
    assert (plan.members, plan.sampling_error) == (1, 0.0)


def test_plan_on_cells_doubles_them():
    # pilots of a few cells, which run
    ground = Terrain(0.1 * np.add.outer(np.zeros(24), np.arange(32.0) * 10.0), 10.0)
    scene = Scene(ground, (Vent((250.0, 120.0), 5.0, radius=10.0),), Lava.paper(viscosity=1e5))
    found = plan_runs(
        scene, error=0.5, horizon=200.0, forced=dict.fromkeys(EFFECTS, False), device='cpu',
        method='cells', clock=itertools.count(0.0, 1e-3).__next__,
    )
    assert found.numerical_error.method == 'cells'
    assert {math.log2(10.0 / item.spacing) % 1.0 for item in found.options} == {0.0}
    assert found.numerical_error.inundated.total <= 0.5


@pytest.mark.parametrize('error', [0.1, 0.03])
def test_plan_finds_the_coarsest_run_below_an_error(monkeypatch, error):
    spent = _machine(monkeypatch)
    plan = plan_runs(SCENE, error=error, horizon=3600.0, device='cpu', clock=lambda: spent[0])
    assert 0.97 * error <= plan.error <= error
    coarser = [item for item in plan.options if item.refinement < 0.97 * plan.refinement]
    assert coarser and all(item.error.inundated.total > error for item in coarser)
    assert plan.wall_time == pytest.approx(_wall_time(plan.refinement), rel=0.15)


def test_error_below_that_of_the_finest_run_is_refused(monkeypatch):
    spent = _machine(monkeypatch)
    with pytest.raises(LavaError, match=r'error is 0.001, expected at least .* %, that of'):
        plan_runs(SCENE, error=0.001, horizon=3600.0, device='cpu', clock=lambda: spent[0])


def test_plan_is_no_finer_than_the_ground_makes_useful(monkeypatch):
    spent = _machine(monkeypatch)
    plan = _plan(spent, 1000.0)
    assert plan.is_finest and plan.preset == 'fine'
    area = plan.numerical_error.inundated
    assert area.lava == pytest.approx(USEFUL * area.ground, rel=0.02)
    assert 'finer particles change the error by less than' in plan.numerical_error.text()
    # neither are its pilots
    assert spent[0] < 0.04 * 1000.0
    perfect = _plan(_machine(monkeypatch, ground=0.0), 1000.0)
    assert perfect.refinement == pytest.approx(FINEST)


def test_options_show_the_error_and_the_time_of_other_spacings(monkeypatch):
    plan = _plan(_machine(monkeypatch), 2.0)
    spacings = [item.spacing for item in plan.options]
    assert len(spacings) >= 6 and spacings == sorted(spacings, reverse=True)
    assert plan.spacing in spacings
    for item in plan.options:
        assert item.wall_time == pytest.approx(_wall_time(item.refinement), rel=0.15)
        actual = PARTICLES * item.refinement**-PARTICLE_ORDER
        assert item.error.inundated.lava == pytest.approx(1.0 - np.exp(-actual), rel=0.02)
        assert item.error.inundated.ground == plan.numerical_error.inundated.ground


def test_plan_shows_what_uncertain_inputs_change(monkeypatch):
    span = {'distribution': 'uniform', 'low': 1.0, 'high': 2.0}
    uncertainty = uncertainty_from_dict({'effusion_rate': span, 'viscosity': span})
    uncertain = replace(SCENE, uncertainty=uncertainty)
    plan = _plan(_machine(monkeypatch), 1000.0, uncertain, with_inputs=True)
    assert list(plan.inputs) == ['effusion_rate', 'viscosity']
    for item in plan.inputs.values():
        assert item.mismatch == pytest.approx(1.0 - np.exp(-0.8), rel=0.02)
        assert item.area == pytest.approx(np.exp(0.8) - 1.0, rel=0.02)
    # a scene without uncertain quantities has no effects of them
    assert not _plan(_machine(monkeypatch), 1000.0, with_inputs=True).inputs


def test_changed_inputs_take_no_more_than_the_time_of_the_pilots(monkeypatch):
    uncertain = replace(SCENE, uncertainty=Uncertainty(material='etna_basalt'))
    spent = _machine(monkeypatch)
    plan = _plan(spent, 2.0, uncertain, with_inputs=True)
    assert plan.spent == spent[0] <= PLANNING_FRACTION * 2.0
    assert plan.pilots >= 3 + 2 * len(plan.inputs)


def test_members_divide_the_time(monkeypatch):
    spent = _machine(monkeypatch)
    plan = _plan(spent, 10.0, members=20)
    planned = PLANNED_TIME_FRACTION * 10.0
    assert 20 * _wall_time(plan.refinement) == pytest.approx(planned, rel=0.1)
    assert plan.sampling_error == pytest.approx(0.5 / np.sqrt(20))
    best = _plan(spent, 10.0, members=None)
    assert best.wall_time <= PLANNED_TIME_FRACTION * 10.0 * 1.001
    total = np.hypot(best.error, best.sampling_error)
    for members in (2, 10, 30, 60):
        other = _plan(spent, 10.0, members=members)
        assert total <= np.hypot(other.error, other.sampling_error) * 1.02


def test_too_little_time_is_refused(monkeypatch):
    spent = _machine(monkeypatch)
    for within, members in ((0.01, 1), (0.5, 50)):
        with pytest.raises(LavaError) as caught:
            _plan(spent, within, members=members)
        assert caught.value.field == 'within'
    for arguments in ({'within': 0.0}, {'horizon': -1.0}, {'members': 0}):
        with pytest.raises(LavaError):
            _plan(spent, **{'within': 1.0, **arguments})


@pytest.fixture
def scene_file(tmp_path):
    """Write `SCENE` to a file."""
    vent = {'position': [200.0, 200.0], 'discharge': 20.0}
    scene = {'vents': [vent], 'lava': {'viscosity': 1e6}}
    return write_scene(tmp_path, SCENE.terrain.elevation, 10.0, scene)


def test_command_names_a_time_that_is_too_short_as_typed(monkeypatch, scene_file):
    _machine(monkeypatch)
    words = ('plan', scene_file, '--within', '0.01s', '--until', '1h', '--device', 'cpu')
    assert "--within is '0.01s'" in refused(*words)


@pytest.mark.nightly
def test_command_plans_with_real_pilots(scene_file, tmp_path):
    words = ['plan', scene_file, '--within', '3s', '--until', '10min', '--device', 'cpu']
    assert lava(*words, '--json', tmp_path / 'plan.json')[0] == 0
    assert 0.0 < json.loads((tmp_path / 'plan.json').read_text())['wall_time_s'] <= 3.0


def test_command_prints_a_table_and_the_plan(monkeypatch, scene_file, tmp_path):
    _machine(monkeypatch)
    words = ['plan', scene_file, '--within', '2s', '--until', '1h', '--device', 'cpu']
    status, printed, _ = lava(*words, '--json', tmp_path / 'plan.json')
    assert status == 0
    plan = json.loads((tmp_path / 'plan.json').read_text())
    assert f'plan: preset {plan["preset"]}, spacing {plan["spacing_m"]:.3g} m\n' in printed
    rows = re.findall(ROW, printed, re.MULTILINE)
    assert [float(spacing) for spacing, *_ in rows] == pytest.approx(
        [item['spacing_m'] for item in plan['options']], rel=5e-3
    )
    assert printed.count('<- plan') == 1
    for name, item in plan['inputs'].items():
        area = f'{100.0 * item["area"]:+.0f} %'
        assert re.search(rf'^{name.replace("_", " ")} +{re.escape(area)} ', printed, re.MULTILINE)
    assert ('what decides' in printed) == bool(plan['inputs'])
    assert re.search(r'^numerical error: [0-9.]+ % of the inundated area', printed, re.MULTILINE)
    total = plan['numerical_error']['inundated']['total']
    assert any(item['error']['inundated']['total'] == total for item in plan['options'])
    for option, value in (('--json', tmp_path / 'none/plan.json'), ('--members', 'many')):
        status, printed, error = lava(*words, option, value)
        assert (status, printed) == (2, '') and f'{option} is' in error
