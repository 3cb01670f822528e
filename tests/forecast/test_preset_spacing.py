# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The spacing of a preset from pilot runs."""

from dataclasses import replace

import numpy as np
import pytest

from command_line import lava
from geodata import write_scene
from lava_ros.effects import Effects
from lava_ros.forecast import pilot_search
from lava_ros.forecast.partner_runs import coarser_partner_of
from lava_ros.forecast.pilot_runs import Pilot, WORK
from lava_ros.forecast.pilot_search import PLANNING_FRACTION
from lava_ros.forecast.preset_spacing import choose_spacing, MIN_ACROSS, MIN_PARTICLES
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import resolution
from lava_ros.simulation.numerical_error import Areas, PARTICLE_ORDER
from lava_ros.simulation.presets import ENOUGH, preset_accuracy, PRESETS
from lava_ros.simulation.resolution import resolution_of, resolved_accuracy

X, Y = np.meshgrid(np.arange(60) * 10.0, np.arange(40) * 10.0)
SCENE = Scene(
    Terrain(3.0 * np.sin(X / 48.0) * np.cos(Y / 48.0), 10.0), (Vent((200.0, 200.0), 20.0),),
    lava=Lava.paper(viscosity=1e6, solidus=0.0),
)
HORIZON, NAMES = 3600.0, ('draft', 'standard', 'fine')


def _runs(monkeypatch, particles, ground, *, on_cells=False):
    """Replace runs; the error -ln J is ``particles`` at 16 across. Return their accuracies.

    With ``on_cells`` their partners are on cells, whose errors have the opposite sign.
    """
    made = []

    def run_at(scene, refinement, horizon, *, accuracy, **_):
        across = resolution_of(SCENE, accuracy, horizon=HORIZON).across
        made.append(accuracy)
        if accuracy.method == 'cells':
            # as particles half as far apart as the size of the cells
            error = -particles * (2.0 * across / 16.0) ** -PARTICLE_ORDER
        else:
            error = particles * (across / 16.0) ** -PARTICLE_ORDER
        # on coarser ground the difference is three times the error
        error += 3.0 * ground * (scene.terrain is not SCENE.terrain)
        cells = np.log(np.maximum(np.arange(4e6).reshape(1, -1), 1.0) / 1e5)
        areas = Areas(cells < error, cells < error)
        evaluations, count = round(100 * across), round(across**2)
        return Pilot(
            refinement, accuracy.spacing, 1.0, 0.0, evaluations, count, Effects(), areas,
            accuracy.method,
        )

    monkeypatch.setattr(pilot_search, 'run_at', run_at)
    if not on_cells:
        monkeypatch.setattr(
            pilot_search, 'partner_of', lambda scene, accuracy, effects:
            coarser_partner_of(accuracy)
        )
    return made


def _work(accuracy):
    across = resolution_of(SCENE, accuracy, horizon=HORIZON).across
    evaluation, carrier = WORK[accuracy.method]
    return 8e-3 + round(100 * across) * (evaluation + carrier * round(across**2))


def _choose(preset, runs=1000, effects=None):
    accuracy = resolved_accuracy(preset_accuracy(preset), SCENE, horizon=HORIZON)
    return accuracy, choose_spacing(
        SCENE, preset, accuracy, effects=effects or Effects(), horizon=HORIZON, runs=runs,
        device='cpu',
    )


@pytest.mark.parametrize('on_cells', [False, True])
@pytest.mark.parametrize('ground', [0.0, 0.02, 0.2])
def test_particles_make_the_wanted_part_of_the_error(monkeypatch, ground, on_cells):
    _runs(monkeypatch, 0.15, ground, on_cells=on_cells)
    before = np.inf
    for preset in NAMES:
        _, found = _choose(preset)
        area, target = found.error.inundated, PRESETS[preset].target
        wanted = target * max(area.ground, ENOUGH)
        assert area.ground == pytest.approx(1.0 - np.exp(-ground), abs=0.01)
        assert area.lava == pytest.approx(wanted, rel=0.1)
        assert found.spacing < before
        before = found.spacing
        words = 'finer particles change the error by less than'
        assert (words in found.text()) == (area.ground > area.lava)


def test_spacing_has_limits(monkeypatch):
    made = _runs(monkeypatch, 1e-4, 0.0)
    accuracy, found = _choose('standard')
    expected = resolution_of(SCENE, accuracy, horizon=HORIZON)
    assert found.spacing == pytest.approx(expected.width / MIN_ACROSS, rel=0.05)
    assert len(made) == found.pilots
    _runs(monkeypatch, 0.2, 0.0)
    monkeypatch.setattr(resolution, 'MOST_PARTICLES', 300)
    accuracy, found = _choose('standard')
    few = resolution_of(SCENE, accuracy, horizon=HORIZON)
    assert found.spacing == pytest.approx(few.finest, rel=0.05)
    volume = 20.0 * HORIZON
    assert few.finest == pytest.approx((volume / 300.0 / few.thickness) ** 0.5)


@pytest.mark.parametrize(('preset', 'error', 'runs', 'on_cells'), [
    ('fine', 0.15, 8, False), ('fine', 0.15, 40, False), ('fine', 0.15, 1000, False),
    ('fine', 0.15, 40, True), ('draft', 0.05, 1000, True),
])
def test_pilots_take_a_small_part_of_the_work(monkeypatch, preset, error, runs, on_cells):
    made = _runs(monkeypatch, error, 0.02, on_cells=on_cells)
    accuracy, found = _choose(preset, runs)
    assert found.pilots == len(made) > 2
    chosen = replace(accuracy, spacing=found.spacing)
    assert sum(map(_work, made)) <= PLANNING_FRACTION * runs * _work(chosen)
    # none is finer than the runs
    spacings = {
        method: [item.spacing for item in made if item.method == method] for method in WORK
    }
    assert min(spacings['particles']) >= 0.999 * found.spacing
    # cells as large as the terrain's measure the ground's part, if there is time
    assert min(spacings['cells'], default=None) == (10.0 if on_cells else None)


def test_first_guess_remains_without_pilots(monkeypatch):
    made = _runs(monkeypatch, 0.15, 0.02)
    accuracy, found = _choose('standard', 1)
    expected = resolution_of(SCENE, accuracy, horizon=HORIZON)
    assert expected.particles < MIN_PARTICLES
    assert (found.spacing, found.error) == (accuracy.spacing, None)
    assert 'first guess: pilot runs would take more than 15 %' in found.text()
    accuracy, found = _choose('standard', effects=Effects(solidification=True))
    assert found.spacing == accuracy.spacing and 'where lava freezes' in found.text()
    accuracy, found = _choose('reference')
    assert found.spacing == accuracy.spacing and made == []


def test_choice_is_the_same_when_repeated(device):
    lava = replace(SCENE.lava, viscosity=1e5)
    scene = replace(SCENE, lava=lava)
    accuracy = resolved_accuracy(preset_accuracy('draft'), scene, horizon=300.0)
    one, two = (
        choose_spacing(
            scene, 'draft', accuracy, effects=Effects(), horizon=300.0, runs=100, device=device
        )
        for _ in range(2)
    )
    assert one.pilots > 2 and one.spacing == two.spacing


def test_ensemble_keeps_the_spacing_of_its_members(tmp_path):
    pytest.importorskip('rasterio')
    vent = {'position': [200.0, 200.0], 'discharge': 20.0}
    lava_of = {'viscosity': 1e6, 'solidus': 0.0, 'latent_heat': 0.0}
    scene = write_scene(
        tmp_path, SCENE.terrain.elevation, 10.0,
        {'vents': [vent], 'lava': lava_of, 'uncertainty': {'position': {'deviation': 10.0}}},
    )
    words = ('run', scene, '--until', '5min', '--device', 'cpu', '-o', tmp_path / 'runs')
    status, printed, error = lava(*words, '--members', '2', '--workers', '1')
    assert status == 0, error
    assert 'm, a first guess: ' in printed
    # with as many there would be pilots
    status, printed, error = lava(*words, '--members', '3', '--workers', '1')
    assert status == 0, error
    assert 'first guess' not in printed and '2 from before' in printed
