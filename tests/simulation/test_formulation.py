# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A formulation decides about its effects wherever effects are chosen."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.bag.description import effect_table
from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError
from lava_ros.forecast.members import make_plan
from lava_ros.forecast.sentinels import find_called
from lava_ros.scene import Lava, Scene, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.output.checkpoint import from_bytes
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.simulation.selection import decide, effects_for
from solver import incline

PRINTED = preset_accuracy('as-published', spacing=10.0)

#: Effects that the printed formulas have, and those that they exclude.
USED, EXCLUDED = 'green', ('helmholtz', 'inertia', 'steep')

PLAIN = Lava(viscosity=1e5, arrhenius=0.0, emissivity=0.0, convection=0.0)

VENT = Vent((300.0, 150.0), 500.0, radius=10.0)

#: Scenes by the effect that each calls for and the formulation excludes.
SCENES = {
    'inertia': Scene(incline(0.4, 30, 60, 10.0), (VENT,), replace(PLAIN, viscosity=1.0)),
    'steep': Scene(incline(0.4, 30, 60, 10.0), (VENT,), replace(PLAIN, viscosity=1e4)),
    'helmholtz': Scene(incline(0.1, 30, 60, 10.0), (VENT,), replace(PLAIN, viscosity=1e12)),
}


def begun(scene):
    simulation = Simulation(scene, accuracy=PRINTED, device='cpu')
    simulation.advance(0.1)
    return simulation


def with_vents(scene):
    simulation = begun(replace(scene, vents=()))
    simulation.set_vents(scene.vents)
    return simulation


def with_terrain(scene):
    level = replace(scene.terrain, elevation=np.zeros(scene.terrain.shape))
    simulation = begun(replace(scene, terrain=level))
    simulation.set_terrain(scene.terrain)
    return simulation


def with_effects(scene):
    simulation = begun(scene)
    simulation.set_effects({'cooling': True})
    return simulation


def reviewed(scene):
    simulation = begun(scene)
    simulation.review(EFFECTS)
    assert find_called(simulation, {}, member=0, start=0.0) == ()
    return simulation


def resumed(scene):
    data = begun(scene).checkpoint().to_bytes()
    simulation = Simulation.resume(from_bytes(data), device='cpu')
    simulation.review(EFFECTS)
    return simulation


ROUTES = {
    'choice': lambda scene: effects_for(scene, accuracy=PRINTED),
    'ensemble': lambda scene: make_plan(scene, horizon=60.0, accuracy=PRINTED).effects,
    'start': lambda scene: begun(scene).effects,
    'given effects': lambda scene: Simulation(
        scene, effects=Effects(), accuracy=PRINTED, device='cpu'
    ).effects,
    'vents': lambda scene: with_vents(scene).effects,
    'terrain': lambda scene: with_terrain(scene).effects,
    'effects': lambda scene: with_effects(scene).effects,
    'review': lambda scene: reviewed(scene).effects,
    'resume': lambda scene: resumed(scene).effects,
}


@pytest.mark.parametrize('name', SCENES)
@pytest.mark.parametrize('route', ROUTES)
def test_formulation_decides_about_its_effects(route, name):
    scene = SCENES[name]
    assert name in effects_for(scene)
    effects = ROUTES[route](scene)
    assert USED in effects
    assert not set(EXCLUDED) & set(effects)


@pytest.mark.parametrize('name', SCENES)
def test_decisions_name_the_formulation(name):
    simulation = begun(SCENES[name])
    for decisions in (decide(SCENES[name], accuracy=PRINTED), simulation.decisions()):
        table = effect_table(simulation.effects, decisions)
        assert table[USED] == 'on: the formulation as-published uses green'
        for other in EXCLUDED:
            assert table[other] == f'off: the formulation as-published has no {other}'
    assert next(item.cost for item in decisions if item.name == name) > 0.0


@pytest.mark.parametrize(('name', 'is_on'), [(USED, False), *((name, True) for name in EXCLUDED)])
@pytest.mark.parametrize('route', [
    lambda scene, forced: effects_for(scene, forced, accuracy=PRINTED),
    lambda scene, forced: make_plan(scene, horizon=60.0, accuracy=PRINTED, effects=forced),
    lambda scene, forced: Simulation(scene, effects=forced, accuracy=PRINTED, device='cpu'),
    lambda scene, forced: begun(scene).set_effects(forced),
], ids=['choice', 'ensemble', 'start', 'effects'])
def test_forced_effect_against_the_formulation_is_refused(route, name, is_on):
    with pytest.raises(LavaError, match='with accuracy.formulation as-published') as caught:
        route(SCENES['steep'], {name: is_on})
    assert (caught.value.field, caught.value.value) == (f'effects.{name}', is_on)


@pytest.mark.parametrize('name', ['helmholtz', 'inertia'])
def test_given_effect_against_the_formulation_is_refused(name):
    with pytest.raises(LavaError, match=f'effects.{name} .*as-published'):
        Simulation(SCENES['steep'], effects=Effects(**{name: True}), accuracy=PRINTED)
