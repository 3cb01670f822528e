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

"""The accuracy one can afford: what pilots foresee, and what the command says."""

from dataclasses import replace
import json

import numpy as np
import pytest

from lava_ros.cli import main as cli
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.forecast import affordable
from lava_ros.forecast.affordable import afford, FINEST, Pilot
from lava_ros.scene import Lava, Scene, Terrain, Vent

EFFECTS = Effects()

SCENE = Scene(Terrain(np.zeros((40, 40)), 10.0), (Vent((200.0, 200.0), 20.0),))


def _machine(monkeypatch, base=2e-4, each=1e-7):
    """Runs on a machine of a known speed, of a flow that errs by 0.04 / r, without running."""
    asked = []

    def run_at(scene, refinement, horizon, *, device, wall_limit):
        asked.append(refinement)
        particles = round(1000.0 * refinement**2)
        evaluations = round(800.0 * refinement)
        wall_time = evaluations * (base + each * particles)
        if wall_time > wall_limit:
            return None
        # 10000 cells are right; what the coarse ones err is on one side of the border
        covered = np.arange(20_000) < 10_000.0 * (1.0 + 0.04 / refinement)
        return Pilot(refinement, wall_time, evaluations, particles, EFFECTS, covered)

    monkeypatch.setattr(affordable, 'run_at', run_at)
    monkeypatch.setattr(affordable, 'effects_for', lambda *_, **__: EFFECTS)
    monkeypatch.setattr(affordable.Simulation, 'advance', lambda *_, **__: 0.0)
    return asked


def _wall_time(refinement, base=2e-4, each=1e-7):
    return 800.0 * refinement * (base + each * 1000.0 * refinement**2)


@pytest.mark.parametrize('within', [0.15, 0.4, 1.0, 2.0])
def test_a_plan_uses_its_time_and_knows_its_error(monkeypatch, within):
    """It takes 80 % of the time, and errs as it says."""
    _machine(monkeypatch)
    plan = afford(SCENE, within=within, horizon=3600.0, device='cpu')
    if not plan.is_finest:
        assert _wall_time(plan.refinement) == pytest.approx(0.8 * within, rel=0.03)
    assert plan.wall_time == pytest.approx(_wall_time(plan.refinement), rel=0.03)
    assert plan.error == pytest.approx(0.04 / plan.refinement, rel=0.3)
    assert plan.spacing == pytest.approx(10.0 / plan.refinement)
    assert (plan.members, plan.sampling_error) == (1, 0.0)


def test_more_time_than_is_needed(monkeypatch):
    """The finest there is, and it is said that more time would not help."""
    _machine(monkeypatch)
    plan = afford(SCENE, within=1000.0, horizon=3600.0, device='cpu')
    assert plan.is_finest and plan.refinement == pytest.approx(FINEST)
    assert plan.preset == 'fine'


def test_a_plan_has_the_effects_of_its_pilots(monkeypatch):
    """Where finer runs call for more physics it stays below, whatever time there is."""
    _machine(monkeypatch)
    more = Effects(helmholtz=True)
    monkeypatch.setattr(
        affordable,
        'effects_for',
        lambda *_, accuracy, **__: more if accuracy.spacing < 10.0 / 1.2 else EFFECTS,
    )
    plan = afford(SCENE, within=0.7, horizon=3600.0, device='cpu')
    assert plan.is_finest and 1.1 < plan.refinement <= 1.2


def test_members_share_the_time(monkeypatch):
    """Given members get what is left for each; as many as err least are neither one nor all."""
    _machine(monkeypatch)
    plan = afford(SCENE, within=10.0, horizon=3600.0, members=20, device='cpu')
    assert 20 * _wall_time(plan.refinement) == pytest.approx(8.0, rel=0.05)
    assert plan.sampling_error == pytest.approx(0.5 / np.sqrt(20))
    best = afford(SCENE, within=10.0, horizon=3600.0, members=None, device='cpu')
    assert best.wall_time <= 8.0 * 1.001
    total = np.hypot(best.error, best.sampling_error)
    for members in (2, 10, 30, 200):
        other = afford(SCENE, within=10.0, horizon=3600.0, members=members, device='cpu')
        assert total <= np.hypot(other.error, other.sampling_error) * 1.02


def test_too_little_time_is_refused(monkeypatch):
    """With what it would take, or that it is more."""
    _machine(monkeypatch)
    for within, members in ((0.01, 1), (0.1, 50)):
        with pytest.raises(LavaError) as caught:
            afford(SCENE, within=within, horizon=3600.0, members=members, device='cpu')
        assert caught.value.field == 'within'
    for arguments in ({'within': 0.0}, {'horizon': -1.0}, {'members': 0}):
        with pytest.raises(LavaError):
            afford(SCENE, **{'within': 1.0, 'horizon': 1.0, 'device': 'cpu', **arguments})


def test_the_command_says_what_to_run(tmp_path, capsys):
    """On a real scene: preset, spacing, time and error, also as JSON; wrong words are refused."""
    np.savez(tmp_path / 'hill.npz', elevation=500.0 - np.arange(900.0).reshape(30, 30) / 15.0,
             resolution=20.0)
    scene = tmp_path / 'scene.yaml'
    scene.write_text(
        'terrain: {file: hill.npz}\nlava: {viscosity: 1.0e5}\n'
        'vents: [{position: [300.0, 500.0], discharge: 20.0, radius: 40.0}]\n'
    )
    words = ['plan', str(scene), '--within', '5s', '--horizon', '10min', '--device', 'cpu']
    path = tmp_path / 'plan.json'
    assert cli.main([*words, '--json', str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith('pilot: spacing 100 m took ') for line in lines)
    plan = json.loads(path.read_text())
    assert f'preset {plan["preset"]}, spacing {plan["spacing"]:.3g} m' in lines
    assert 0.0 < plan['wall_time'] <= 5.0
    assert cli.main([*words, '--members', 'many']) == 2
    assert "--members is 'many'" in capsys.readouterr().err


def test_refinements_between_presets_have_their_accuracy():
    """All but the spacing is as the presets have it."""
    scene = replace(SCENE, lava=Lava(viscosity=1e4))
    for refinement, name in ((0.3, 'draft'), (1.0, 'standard'), (1.7, 'standard'), (2.5, 'fine')):
        accuracy = affordable.accuracy_at(scene, refinement)
        assert accuracy.spacing == pytest.approx(10.0 / refinement)
        expected = replace(affordable.PRESETS[name].accuracy, spacing=accuracy.spacing)
        assert accuracy == expected
