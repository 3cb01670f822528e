# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Session of a simulation: its newest snapshot, and effects that its method does not have."""

from dataclasses import replace

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.live.session import SimulationSession
from lava_ros.scene import constants_of, Lava, Scene, Terrain, Vent
from lava_ros.scene.terrain import Georeference
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.method import settled_method


def test_older_snapshot_never_replaces_a_newer_one() -> None:
    session = SimulationSession(
        lambda scene: Simulation(scene, accuracy=Accuracy(spacing=10.0), device='cpu')
    )
    ground = Terrain(np.zeros((20, 20)), 10.0)
    session.start(Scene(ground, (Vent((100.0, 100.0), 5.0),), lava=Lava.paper()))
    pending = []
    for until in (1.0, 2.0):
        session.advance(until, wall_limit=60.0, max_particles=1000)
        pending.append(session.begin_snapshot())
    first, second = pending
    assert first is not None and second is not None
    second()
    assert session.latest is not None
    newest = session.latest.time
    assert newest > 1.0
    first()
    assert session.latest.time == newest


#: Lava of one temperature, a vent from which it creeps, and one from which it rushes.
LAVA = Lava.paper(viscosity=100.0, emissivity=0.0, convection=0.0, arrhenius=0.0)
SLOW = Vent((100.0, 100.0), 1.0)
FAST = replace(SLOW, discharge=100.0)


def settled(scene: Scene) -> Simulation:
    """Return a simulation by the method that its scene needs."""
    choice = settled_method('auto', scene, Accuracy(), {}, horizon=3600.0)
    accuracy = Accuracy(method=choice.method, spacing=20.0)
    return Simulation(scene, effects={}, accuracy=accuracy, device='cpu', horizon=3600.0)


def method_of(session: SimulationSession) -> str:
    assert session.view.accuracy is not None
    return session.view.accuracy.method


def test_change_that_needs_an_effect_of_particles_is_warned_about() -> None:
    x, _ = np.meshgrid(np.arange(40) * 20.0, np.arange(20))
    scene = Scene(Terrain(100.0 - 0.1 * x, 20.0), lava=LAVA)
    session = SimulationSession(settled)
    session.start(scene)
    # the first vents start it again, with the method that they need
    session.set_vents((SLOW,))
    assert (session.view.starts, method_of(session), session.view.missed) == (2, 'cells', ())
    session.set_vents((FAST,))
    (text,) = session.view.missed
    assert 'the flow needs inertia (' in text and 'only method particles' in text
    assert method_of(session) == 'cells'
    with pytest.raises(LavaError, match='which have no merging. Set method to particles or auto'):
        session.set_effects({'merging': True}, horizon=3600.0)
    session.set_effects({'inertia': False}, horizon=3600.0)
    assert session.view.missed == ()
    session.reset()
    assert (method_of(session), session.view.missed) == ('particles', ())


SLOPE = Terrain(100.0 - 0.1 * np.arange(40)[None, :] * 20.0 + np.zeros((20, 1)), 20.0)


@pytest.mark.parametrize('constants', [
    {'lava': replace(LAVA, viscosity=7.0)}, {'ambient_temperature': 250.0}, {'gravity': 3.7},
    {'wind_speed': 5.0},
])
@pytest.mark.parametrize('restart', ['reset', 'first vents'])
def test_constants_are_those_of_the_scene_only_after_the_next_start(constants, restart):
    session = SimulationSession(settled)
    vents = (SLOW,) if restart == 'reset' else ()
    session.start(Scene(SLOPE, vents, lava=LAVA))
    session.set_constants(constants_of(None) | {'lava': LAVA} | constants)
    for scene in (session.view.scene, session.view.repeatable):
        assert scene is not None and session.simulation is not None
        assert constants_of(scene) == constants_of(session.simulation.scene)
        assert all(getattr(scene, name) != value for name, value in constants.items())
    if restart == 'reset':
        session.reset()
    else:
        session.set_vents((SLOW,))
    for scene in (session.view.scene, session.simulation.scene):
        assert scene is not None
        assert all(getattr(scene, name) == value for name, value in constants.items())


@pytest.mark.parametrize('interface', ['session', 'simulation'])
@pytest.mark.parametrize('has_lava', [True, False])
@pytest.mark.parametrize(('georeference', 'moves'), [
    (Georeference(32633, (4e5, 4e6)), False), (Georeference(32633, (4e5 + 1e-6, 4e6)), False),
    (Georeference(32633, (4e5, 4e6 + 1.0)), True), (Georeference(32634, (4e5, 4e6)), True),
    (Georeference(), False),
])
def test_terrain_in_another_map_frame_is_refused_under_lava(
    georeference, moves, has_lava, interface
):
    session = SimulationSession(settled)
    ground = SLOPE.with_georeference(Georeference(32633, (4e5, 4e6)))
    session.start(Scene(ground, (SLOW,) if has_lava else (), lava=LAVA))
    session.advance(60.0, wall_limit=60.0, max_particles=1000)
    other = replace(SLOPE, elevation=SLOPE.elevation + 1.0).with_georeference(georeference)
    user = session if interface == 'session' else session.simulation
    if moves and has_lava:
        with pytest.raises(LavaError, match='The map frame of the terrain .* is not that of the'):
            user.set_terrain(other)
    else:
        user.set_terrain(other)
    used = ground if moves and has_lava else other
    assert session.simulation.scene.terrain is used
    assert session.view.scene.terrain is (used if user is session else ground)
    # the frame of a terrain whose frame is unknown may be learnt later
    session.start(Scene(SLOPE, (SLOW,), lava=LAVA))
    session.advance(60.0, wall_limit=60.0, max_particles=1000)
    assert session.set_terrain(other)


def test_refused_constants_leave_those_of_the_next_start():
    session = SimulationSession(settled)
    session.start(Scene(SLOPE, (SLOW,), lava=LAVA))
    before = session.constants
    with pytest.raises(LavaError, match='temperature'):
        session.set_constants({'lava': replace(LAVA, solidus=1450.0)})
    assert session.constants is before
    session.reset()
    assert session.view.scene is not None and session.view.scene.lava == LAVA
