# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Effects and settings that do not change what a kernel does share it: it is compiled once."""

import pytest

from lava_ros.scene import Lava, Vent
from lava_ros.simulation.backend.graph import Launches
from lava_ros.simulation.cells.worlds import steps_kernel
from solver import flat, only, simulated


class Recorder(Launches):
    """Launches that are recorded, as those of a batch, with the kernels of a simulation alone."""

    is_capturing = False


def modules(effects, settings):
    """Return the modules of the kernels of a stage, by their names; none of them is compiled."""
    solver = simulated(
        flat(20), Lava(), Vent((0.0, 0.0), 1.0), effects=only(*effects), spacing=1.0,
        thickness=1.0, longest_step=10.0, **settings,
    ).solver
    launches = solver.state.launches = Recorder(solver.state.device)
    kernels = (
        launch.kernel for part in (solver.bin, solver.take_stages)
        for launch in launches.record(part, 64)
    )
    return {kernel.key.rpartition('__')[2]: kernel.module.name for kernel in kernels}


@pytest.mark.parametrize(('name', 'effects', 'settings'), [
    # new particles have all arrays that the effects need
    ('choose_stage', ['cooling', 'viscous_heating', 'arrhenius', 'crust'], {}),
    ('choose_stage', ['inertia'], {'integrator': 'euler'}),
    # steps with inertia have one stage
    ('choose_stage', ['inertia', 'arrhenius'], {'integrator': 'euler'}),
    ('order_particles', ['arrhenius'], {}),
    ('order_particles', ['arrhenius'], {'integrator': 'euler'}),
    ('move', ['arrhenius'], {}),
    ('move', ['arrhenius'], {'integrator': 'euler'}),
    # heat that does not stiffen lava, and a crust without strength
    ('thickness_and_velocity', ['cooling', 'viscous_heating', 'crust'], {}),
    ('balanced_velocity', ['viscous_heating'], {'gradient': 'balanced'}),
])
def test_kernel_is_that_of_lava_without_effects(name, effects, settings):
    assert modules(effects, settings)[name] == modules([], settings)[name]


def test_kernels_with_inertia_are_those_of_any_integrator():
    one, *others = (
        modules(['inertia', 'arrhenius'], {'integrator': name})
        for name in ('rkl2', 'rkl1', 'euler')
    )
    assert others == [one, one]


def test_kernels_of_other_motions_differ():
    names = ('move', 'choose_stage', 'thickness_and_velocity')
    found = [
        modules(effects, {'precision': precision}) for effects in ([], ['inertia', 'cooling'])
        for precision in ('float32', 'float64')
    ]
    assert all(len({one[name] for one in found}) == 4 for name in names)


@pytest.mark.parametrize('more', [
    # it has constants only
    'wind',
    # cover loses what this does
    'cooling',
])
def test_kernel_of_cells_is_the_same_in_a_process_that_has_made_others(more):
    effects = 'steep', 'yielding', 'arrhenius', 'cover', 'crust_strength', 'solidification'
    one, other = (
        steps_kernel(only(*names), True, 1, False).module.name
        for names in (effects, (*effects, more))
    )
    assert one == other
