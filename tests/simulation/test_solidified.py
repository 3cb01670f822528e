# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Solidified lava stays ground, on maps and in the budget, whatever changes during a run."""

from dataclasses import asdict, replace
from functools import lru_cache

import numpy as np
import pytest

from lava_ros.effects import compatible, EFFECTS
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.events import TerrainEvent
from lava_ros.scene.reshaping import Barrier
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.checkpoint import from_bytes
from lava_ros.simulation.output.inundation import reached_cells, standing_cells
from lava_ros.simulation.particles.solidified import THICKNESS_UNIT
from lava_ros.simulation.particles.terrain import StaggeredTerrain
from lava_ros.simulation.step.effects import parts_of
from simulation.test_stops import hill
from solver import only

#: Times of the change, of the next change, and of the last check [s]; a barrier is built between
#: the last two.
CHANGE, NEXT, END = 200.0, 210.0, 230.0

VENT = Vent((95.0, 150.0), 30.0, radius=12.0, temperature=1423.0)

#: Lava that has the constants of every effect, and begins to solidify before the change.
LAVA = Lava.paper(**{
    'viscosity': 5e3, 'liquidus': 1500.0,
    **{name: value for one in EFFECTS.values() for name, value in one.benchmark.items()
       if name not in one.environment},
    'convection': 1000.0, 'solidus': 1395.0,
})

BARRIER = Barrier(((60.0, 170.0), (200.0, 170.0)), height=3.0, width=20.0)

BASE = ('cooling', 'solidification')

#: Precision of a simulation, and whether it is deterministic.
KINDS = [('float32', False), ('float32', True), ('float64', False), ('float64', True)]


@lru_cache
def flow(precision, deterministic, device):
    """Return the checkpoint of a flow of which a part has solidified."""
    event = TerrainEvent(0.5 * (NEXT + END), 'barrier', barriers=(BARRIER,))
    simulation = Simulation(
        Scene(hill(), (VENT,), LAVA, events=(event,)), effects=asdict(only(*BASE)),
        device=device, accuracy=Accuracy(
            spacing=4.0, thickness=0.5, longest_step=20.0, precision=precision,
            deterministic=deterministic,
        ),
    )
    simulation.advance(CHANGE)
    return simulation.checkpoint().to_bytes()


def state_of(simulation):
    """Check the maps and the ground; return the snapshot and the rise of the ground [m]."""
    snapshot = simulation.snapshot()
    reached = reached_cells(snapshot.arrived)
    assert not (standing_cells(snapshot.frozen, 0.1) & ~reached).any()
    assert not snapshot.arrived[reached].max() > snapshot.time
    terrain = simulation.solver.terrain
    rise = terrain.deposit.numpy() * THICKNESS_UNIT
    height = terrain.height.numpy()
    found = height.astype(np.float64) - terrain.bare.numpy()
    np.testing.assert_allclose(found, rise, rtol=0.0, atol=np.spacing(np.abs(height).max()))
    return snapshot, rise


def volumes(snapshot, rise):
    """Return the solidified volume on the map and in the ground, on cells with data [m3]."""
    terrain = snapshot.terrain
    grids = snapshot.frozen.astype(np.float64), rise[1:-1, 1:-1]
    return [grid[terrain.has_data].sum() * terrain.resolution**2 for grid in grids]


def is_kept(before, after):
    """Return True if the solidified lava on cells that are the same has not changed."""
    (former, former_rise), (snapshot, rise) = before, after
    terrain, same = snapshot.terrain, former.terrain.has_data & snapshot.terrain.has_data
    ringed = np.pad(same, 1, constant_values=True)
    return (
        terrain.shape == former.terrain.shape
        and np.array_equal(snapshot.frozen[same], former.frozen[same])
        and np.array_equal(rise[ringed], former_rise[ringed])
    )


def switch(simulation, *names):
    """Force effects on and all others off; of those that exclude each other the first is on."""
    simulation.set_effects(asdict(compatible(names)))


def with_effects(*names):
    """Return a change that switches effects on, and solidification off and on again."""

    def change(simulation):
        before, more = state_of(simulation), (*names, *BASE)
        for on in (more, (*names, 'cooling'), BASE, ('cooling',), more):
            switch(simulation, *on)
            assert is_kept(before, state_of(simulation))
        switch(simulation, *(one for one in ('cooling', *names) if one != 'solidification'))

    return change


def sets_of_columns():
    """Yield sets of the effects without kernels of their own that can be on together."""
    rest = [name for name in EFFECTS if not [*parts_of(only(name))]]
    while rest:
        on = compatible(rest)
        yield tuple(name for name in rest if name in on)
        rest = [name for name in rest if name not in on]


def without(simulation):
    switch(simulation, 'cooling')


def on_terrain(ground, *, is_off=False):
    """Return a change that replaces the terrain, with solidification on or off."""

    def change(simulation):
        if is_off:
            without(simulation)
        simulation.set_terrain(ground(simulation.scene.terrain))

    return change


def vents(simulation):
    simulation.set_vents((replace(VENT, discharge=5.0), Vent((60.0, 140.0), 3.0)))


def review(simulation):
    """Let a review switch solidification on again."""
    simulation.set_effects({}, horizon=1.0)
    assert 'solidification' not in simulation.effects
    simulation.review(['solidification'])
    assert 'solidification' in simulation.effects


def resumed(**changes):
    """Return a change that resumes the simulation with other fields of its checkpoint."""

    def change(simulation):
        checkpoint = from_bytes(simulation.checkpoint().to_bytes())
        return Simulation.resume(replace(checkpoint, **changes), device=simulation.device)

    return change


def resumed_without(simulation):
    """Resume after solidification has been switched off."""
    without(simulation)
    return resumed()(simulation)


def holed(terrain):
    """Return a terrain with a hole in which lava has solidified, and without its first hole."""
    elevation = np.where(terrain.has_data, terrain.elevation, 880.0)
    elevation[14:17, 12:14] = np.nan
    return replace(terrain, elevation=elevation)


def raised(terrain):
    return replace(terrain, elevation=terrain.elevation + np.linspace(0.0, 5.0, 28))


def finer(terrain):
    return replace(
        terrain, elevation=np.kron(terrain.elevation, np.ones((2, 2))), resolution=5.0,
    )


def coarser(terrain):
    elevation = np.nan_to_num(terrain.elevation, nan=880.0).reshape(15, 2, 14, 2)
    return replace(terrain, elevation=elevation.mean(axis=(1, 3)), resolution=20.0)


def shifted(terrain):
    elevation = np.pad(np.nan_to_num(terrain.elevation, nan=880.0), 1, mode='edge')
    return replace(terrain, elevation=elevation, origin=(-3.7, -6.1))


GROUNDS = {
    'same': lambda terrain: Terrain(terrain.elevation.copy(), terrain.resolution),
    'raised': raised, 'holed': holed, 'finer': finer, 'coarser': coarser, 'shifted': shifted,
}

CHANGES = {
    'no change': lambda simulation: None,
    'off': without,
    'vents': vents,
    'review': review,
    'resumed': resumed(),
    'resumed when off': resumed_without,
    'resumed with other effects': resumed(effects=only('cooling', 'steep'), forced=None),
    **{f'{name} terrain': on_terrain(ground) for name, ground in GROUNDS.items()},
    **{f'{name} terrain when off': on_terrain(ground, is_off=True)
       for name, ground in GROUNDS.items()},
    **{name: with_effects(name) for name in EFFECTS},
    **{' '.join(names): with_effects(*names) for names in sets_of_columns()},
}

#: Changes of which each compiles kernels, and that another one contains.
CONTAINED = {name for names in sets_of_columns() for name in names if len(names) > 1}


def test_scene_without_solidification_has_no_grids_for_it(device):
    simulation = Simulation(
        Scene(hill(), (VENT,), LAVA), effects=only('cooling'), device=device,
        accuracy=Accuracy(spacing=4.0, thickness=0.5),
    )
    ground = StaggeredTerrain(simulation.scene.terrain, 'float32', device)
    assert simulation.solver.raised is None and simulation.solver.terrain.height is ground.bare
    assert simulation.snapshot().frozen is None
    assert not [name for name in simulation.checkpoint().arrays if name.startswith('solidified')]


#: Changes that are tried with every kind in each run.
SAMPLE = ('off', 'resumed when off', 'holed terrain when off')


def cases():
    """Yield the changes with the first kind, and the rest of all combinations as nightly."""
    for kind in KINDS:
        for change in CHANGES:
            is_nightly = change in CONTAINED or (kind != KINDS[0] and change not in SAMPLE)
            yield pytest.param(change, *kind, marks=[pytest.mark.nightly] * is_nightly)


@pytest.mark.parametrize(('change', 'precision', 'deterministic'), [*cases()])
def test_solidified_lava_is_kept(change, precision, deterministic, device):
    """It is while the flow continues with the changed effects, without solidification, and on."""
    data = flow(precision, deterministic, device)
    simulation = Simulation.resume(from_bytes(data), device=device)
    before = state_of(simulation)
    assert 0.1 < before[0].budget.solidified / before[0].budget.emitted < 0.9
    simulation = CHANGES[change](simulation) or simulation
    after = state_of(simulation)
    lost = after[0].budget.lost - before[0].budget.lost
    if len(before[1]) == len(after[1]):
        assert is_kept(before, after)
        assert (lost > 0.0) == change.startswith('holed')
    else:
        assert lost == 0.0
        assert volumes(*after) == pytest.approx(volumes(*before), rel=1e-6)
    for time, names in ((NEXT, None), (END, ('cooling',)), (END + 10.0, BASE)):
        if names is not None:
            switch(simulation, *names)
            assert is_kept(after, state_of(simulation))
        simulation.advance(time)
        before, after = after, state_of(simulation)
        if 'solidification' not in simulation.effects:
            assert is_kept(before, after)
    assert not simulation.scene.events
    assert after[0].budget.solidified > before[0].budget.solidified
