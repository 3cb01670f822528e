# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Effects as a key; an effect that is off leaves no trace."""

from dataclasses import replace

import pytest
import warp as wp

from effects.copies import copy_package, output_of
from lava_ros.effects import EFFECTS, Effects
from lava_ros.effects.effect import Effect, join_names, number
from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Vent
from lava_ros.verification.cases.case import plane
from solver import only, simulated

#: Arrays of a step without effects, and of a map.
BARE_ARRAYS = {
    'particle', 'ordered', 'flow', 'cell', 'rank', 'remainder', 'ordered_remainder', 'clock',
    'counts', 'chosen', 'rates', 'stage', 'top', 'left', 'limit_time', 'base', 'drift',
    'ordered_base', 'ordered_drift', 'share', 'home', 'arrived',
}

#: Kernels of that step in their order.
BARE_KERNELS = [
    'rank_particles', 'scan', 'order_particles', 'thickness_and_velocity', 'choose_stage', 'move',
]

#: Arrays and kernels that effects add.
ADDED = dict.fromkeys(
    ('', 'power_law', 'steep', 'cooling', 'latent_heat'), (set(), set())
) | dict.fromkeys(
    ('yielding', 'arrhenius', 'vft', 'crystals'),
    ({'mean_temperature', 'ordered_mean_temperature'}, set()),
)
ADDED['green'] = {'source', 'area'}, {'green_motion'}
ADDED['helmholtz'] = (
    {'layer', 'solution', 'next_solution', 'correction'}, {'start', 'sweep', 'finish'}
)

#: An effect that declares a name of the solver.
TOY = """
from lava_ros.effects.effect import Array, Effect, number
EFFECT = Effect(rank=200, title='toy', {})
"""


@pytest.fixture
def launched(monkeypatch):
    """Return the list of names of launched kernels, in their order."""
    names = []
    launch, launch_again = wp.launch, wp.Launch.launch

    def record(kernel, *args, **kwargs):
        # a recorded command is launched by ``record_again``
        if not kwargs.get('record_cmd'):
            names.append(kernel.key.rpartition('__')[2])
        return launch(kernel, *args, **kwargs)

    def record_again(command):
        names.append(command.kernel.key.rpartition('__')[2])
        launch_again(command)

    monkeypatch.setattr(wp, 'launch', record)
    monkeypatch.setattr(wp.Launch, 'launch', record_again)
    return names


@pytest.mark.parametrize('name', ADDED)
def test_effect_allocates_and_launches_only_its_own(launched, name):
    arrays, kernels = ADDED[name]
    lava = Lava(solidus=1000.0, yield_strength=100.0, conductivity=2.0)
    ground, vent = plane((-50.0, -50.0, 50.0, 50.0), 5.0, 0.2), Vent((0.0, 0.0), 2.0)
    simulation = simulated(ground, lava, vent, effects=only(name), spacing=4.0)
    state = vars(simulation.solver.state)
    # attributes that begin with _ are views of other arrays
    arrays_of_it = {key for key, value in state.items() if isinstance(value, wp.array)}
    allocated = {key for key in arrays_of_it if key[0] != '_'}
    assert allocated == BARE_ARRAYS | arrays
    simulation.advance(60.0)
    assert simulation.particle_count > 0
    # only the first stage sorts particles into cells before it moves them
    simulation.solver.stage.take(simulation.scene, simulation.solver.vents)
    launched.clear()
    simulation.solver.stage.take(simulation.scene, simulation.solver.vents)
    without = {'move'} if name == 'green' else set()
    assert set(launched) == set(BARE_KERNELS) - without | kernels
    assert name or launched == BARE_KERNELS


@pytest.mark.parametrize(
    'pair',
    [('green', 'helmholtz'), ('arrhenius', 'vft'), ('inertia', 'green'), ('inertia', 'helmholtz')],
)
def test_rejects_effects_that_exclude_each_other(pair):
    with pytest.raises(LavaError, match='effects'):
        Effects(**{'arrhenius': False, **dict.fromkeys(pair, True)})


@pytest.mark.parametrize('part', ['constants', 'environment', 'law', 'heat', 'arrays'])
def test_rejects_a_name_of_another_effect(part):
    names = [(one, key) for one, item in EFFECTS.items() for key in getattr(item, part)]
    for owner, key in names:
        toy = Effect(rank=200, title='toy', **{part: {key: number(0.0, '', 0.0, 1.0)}})
        words = rf"^effects.toy.{part} is '{key}', expected a name that effects.{owner} does not"
        with pytest.raises(LavaError, match=words):
            join_names(part, {**EFFECTS, 'toy': toy})
        assert join_names(part, {**EFFECTS, 'toy': replace(toy, adds_to=(key,))})


@pytest.mark.parametrize(
    ('part', 'key', 'value'),
    [
        ('environment', 'gravity', "number(1.0, '', 0.0, 2.0)"),
        ('law', 'viscosity', 'lambda lava: 1.0'),
        ('heat', 'ambient', 'lambda scene: 1.0'),
        ('arrays', 'ground', "Array('real')"),
    ],
)
def test_rejects_a_name_of_the_solver(tmp_path, part, key, value):
    copy_package(tmp_path)
    (tmp_path / 'lava_ros/effects/toy.py').write_text(TOY.format(f"{part}={{'{key}': {value}}}"))
    with pytest.raises(AssertionError, match=f"effects.toy.{part} is '{key}', expected a name"):
        output_of('import lava_ros.simulation.simulation', (), tmp_path)
