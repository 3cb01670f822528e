# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Faults that the fuzzers found, a test each."""

from collections.abc import Iterator
from dataclasses import fields
import math
import struct
from typing import Any

import numpy as np
import pytest
from rclpy.serialization import serialize_message
import yaml

from fuzz.messages import TOPICS
from hard.invariants import Watch
from lava_ros.effects import Effects
from lava_ros.effects.insulation import EFFECT as INSULATION
from lava_ros.errors import LavaError
from lava_ros.ros import inputs
from lava_ros.ros.codec import decode, MAX_CLOUD_FIELDS
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Scene, scene_from_dict, scene_from_yaml, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.scene.terrain_files import load_terrain
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.selection import decide
from ros import graph_publisher
from solver import incline, only, simulated

GROUND = Terrain(np.zeros((4, 5)), 10.0)
MIDDLE = (25.0, 15.0)


def flow(
    ground: Any, lava: Lava, *on_it: Any, on: str = 'steep', cell: float = 1.0, **knobs: Any
) -> tuple[Simulation, Watch]:
    """Return a flow on heights with some effects, and its watch."""
    ground = Terrain(np.array(ground), cell)
    simulation = simulated(ground, lava, *on_it, effects=only(*on.split()), **knobs)
    return simulation, Watch(simulation)


def frames(simulation: Simulation, watch: Watch, until: float, count: int = 6) -> Iterator[int]:
    """Simulate up to a time [s], and check the invariants after each frame."""
    for frame in range(1, count + 1):
        simulation.advance(until * frame / count)
        watch.check()
        yield frame


def test_refuses_a_horizon_that_is_not_a_number() -> None:
    with pytest.raises(LavaError, match='^horizon'):
        decide(Scene(GROUND, lava=Lava.paper()), horizon=math.nan)


def test_refuses_lava_jammed_with_crystals_at_the_vent() -> None:
    stiff = Lava.paper(
        viscosity=2e6, arrhenius=0.04, solidus=816.0, crystals=0.9, crystal_law='einstein-roscoe'
    )
    with pytest.raises(LavaError, match=r'vents\[0\].temperature is 900.*viscosity') as caught:
        Scene(GROUND, [Vent(MIDDLE, 250.0, 900.0)], stiff)
    assert caught.value.field == 'vents[0].temperature'
    assert Scene(GROUND, [Vent(MIDDLE, 250.0, 1400.0)], stiff).vents


@pytest.mark.parametrize('scene', [
    Scene(GROUND, (), Lava.paper(reference_temperature=288.15), 288.15),
    Scene(GROUND, (), Lava.paper(reference_temperature=200.0)),
    Scene(GROUND, (), Lava.paper(reference_temperature=1100.0, solidus=1100.0)),
    Scene(
        GROUND, [Vent(MIDDLE, 1.0, 2000.0)], Lava.paper(arrhenius=1.0, reference_temperature=1.0)
    ),
    Scene(GROUND, [Vent(MIDDLE, 1e-309)], lava=Lava.paper()),
], ids=['as cold as air', 'colder than air', 'at the solidus', 'no viscosity', 'no thickness'])
def test_effects_are_chosen_for_cold_and_thin_lava(scene: Scene) -> None:
    assert all(item.reason for item in decide(scene))


@pytest.mark.parametrize(
    'name', [item.name for item in fields(Lava) if item.metadata.get('limits', (1.0,))[0] == 0.0]
)
def test_constants_too_small_for_ratios_count_as_zero(name: str) -> None:
    data = {'vents': [{'position': MIDDLE, 'effusion_rate': 5.0, 'radius': 20.0}], 'insist': True}
    tiny, zero = (
        scene_from_dict({**data, 'lava': {'latent_heat': 0.0, name: value}}, GROUND)
        for value in (5e-324, 0.0)
    )
    assert tiny.lava == zero.lava and decide(tiny) == decide(zero)


def test_no_crust_forms_in_air_above_the_solidus() -> None:
    data = {'vents': [{'position': MIDDLE, 'effusion_rate': 5.0, 'radius': 20.0}], 'insist': True}
    scene = scene_from_dict({**data, 'lava': {'solidus': 2.0}}, GROUND)
    assert all(item.reason for item in decide(scene))
    assert INSULATION.heat['crust_resistance'](scene) == 0.0


@pytest.mark.parametrize('name', ['x' * 5000, 'a\0b', [1, 2], None, 3])
def test_refuses_invalid_names_of_terrain_files(name: Any, tmp_path: Any) -> None:
    path = tmp_path / 'scene.yaml'
    path.write_text(yaml.safe_dump({'terrain': {'file': name}}))
    with pytest.raises(LavaError, match='file'):
        scene_from_yaml(path)
    if isinstance(name, str):
        with pytest.raises(LavaError, match='terrain file'):
            load_terrain(name)


def test_refuses_a_cloud_with_too_many_fields() -> None:
    for order, flag in (('<', 1), ('>', 0)):
        head = bytes([0, flag, 0, 0]) + bytes(8) + struct.pack(f'{order}I', 4) + b'map\0'
        bomb = head + struct.pack(f'{order}III', 1, 1, 10**6) + bytes(2 * 10**6)
        with pytest.raises(LavaError, match='1000000 fields') as caught:
            decode(bomb, TOPICS['vents'], 'vents', max_bytes=10**9)
        assert caught.value.field == 'vents.fields'
    cloud = graph_publisher.vents()
    assert len(cloud.fields) < MAX_CLOUD_FIELDS
    data = serialize_message(cloud)
    assert decode(data, TOPICS['vents'], 'vents', max_bytes=len(data)) == cloud


def test_signalling_nan_is_refused_without_a_warning(recwarn: pytest.WarningsRecorder) -> None:
    cloud = graph_publisher.vents()
    cloud.data[0:4] = type(cloud.data)('B', b'\1\0\x80\x7f')
    with pytest.raises(LavaError, match='position'):
        inputs.vents_from_cloud(cloud, Settings())
    assert not recwarn.list


@pytest.mark.parametrize(('vent', 'viscosity', 'more', 'until', 'spacing'), [
    (Vent((0.5, 0.5), 400.0, radius=1.0, velocity=(0.0, 40.0)), 165.0, 'inertia', 0.2, 2.0),
    (Vent((20.0, 20.0), 440.0, radius=1.0), 2.5e8, '', 60.0, 1.0),
], ids=['thrown out of its vent', 'pushed by the lava behind it'])
def test_speed_and_lava_behind_may_warm_a_particle(
    vent: Vent, viscosity: float, more: str, until: float, spacing: float
) -> None:
    lava = Lava.paper(viscosity=viscosity, specific_heat=600.0)
    simulation, watch = flow(
        np.zeros((40, 40)), lava, vent, on=f'steep viscous_heating {more}', spacing=spacing
    )
    thickest = 0.0
    for _ in frames(simulation, watch, until):
        thickest = max(thickest, float(simulation.sample().thickness.max(initial=0.0)))
    warmer = float(simulation.sample().temperature.max() - simulation.scene.vents[0].temperature)
    assert warmer > 9.81 / 600.0 * 2.0 * thickest
    assert 0.0 < watch.largest['heat'] < 1.0


def test_replaced_vents_determine_the_step() -> None:
    fast, slow = (Vent((12.0, 12.0), 1.0, velocity=(0.0, speed)) for speed in (40.0, 0.0))
    # without lava there are no steps
    other = Vent((18.0, 18.0), 100.0)
    simulation, _ = flow(
        np.zeros((24, 24)), Lava.paper(viscosity=1e6), slow, other, on='steep inertia',
        spacing=1.0,
        ratio=3.5,
    )
    simulation.advance(0.5)
    assert simulation.particle_count > 0
    lengths = []
    for number, vents in enumerate([(slow,), (fast,), ()]):
        simulation.set_vents((*vents, other))
        simulation.advance(0.5 + 0.05 * (number + 1))
        lengths.append(simulation.snapshot().steps.length)
    limit = simulation.accuracy.courant_number / 40.0
    assert lengths[1] <= limit < min(lengths[0], lengths[2])


def test_heat_of_drag_that_does_not_change_the_speed_is_finite() -> None:
    rough = Terrain(np.array([[0.001257302, -0.0013210486], [0.006404227, 0.001049001]]), 1.0)
    discharge = ((0.0, 744.3195958314132), (1.0, 0.0), (5.0, 1488.6391916628263), (1000.0, 0.0))
    simulation, watch = flow(
        np.zeros((2, 2)),
        Lava.paper(viscosity=1.0, density=1000.0, specific_heat=600.0, arrhenius=0.04),
        Vent((0.5, 0.5), discharge, 1459.0, radius=1.0), on='arrhenius inertia viscous_heating',
        refinement=0.5, ratio=3.5, ambient_temperature=200.0,
    )
    for frame in frames(simulation, watch, 0.461961952225758):
        if frame == 3:
            simulation.set_terrain(rough)
            watch.renew()


def test_cost_of_lava_that_flows_only_within_a_frame() -> None:
    simulation, watch = flow(
        np.add.outer(0.5 * np.arange(20.0), np.zeros(20)),
        Lava.paper(viscosity=14.0, yield_strength=1e5, flow_index=0.5),
        Vent((10.0, 10.0), ((0.0, 100.0), (0.25, 0.0)), radius=1.0),
        on='steep yielding power_law', spacing=1.0,
    )
    simulation.advance(0.5)
    watch.check()
    # the bound is four times the required number of steps
    assert 0.2 < watch.largest['cost'] < 0.3


def test_head_does_not_count_a_vent_that_opens_later() -> None:
    low, high = Vent((10.0, 10.0), 20.0, radius=1.0), Vent((10.0, 35.0), ((100.0, 20.0),))
    slope, heads = np.add.outer(3.0 * np.arange(40.0), np.zeros(20)), []
    for vents in ((low,), (low, high)):
        simulation, watch = flow(
            slope, Lava.paper(viscosity=1.0), *vents, spacing=1.0, thickness=1.0
        )
        simulation.advance(0.5)
        watch.check()
        heads.append((simulation.sample().velocity ** 2).sum(axis=1).max(initial=0.0) / 19.62)
    assert heads[0] == heads[1] > 1.0
    # a vent that opens within the next step counts
    simulation.advance(101.0)
    watch.check()
    assert simulation.solver.vents.counted == {0, 1}


def test_cost_of_lava_that_leaves_within_a_frame() -> None:
    simulation, watch = flow(
        [[0.0, 0.0], [0.1, 0.1]], Lava.paper(viscosity=10.0), Vent((1.0, 1.0), 1.0, radius=0.1),
        spacing=1.0, thickness=20.0,
    )
    simulation.advance(50.0)
    assert not len(simulation.sample().volume)
    watch.check()
    assert 0.1 < watch.largest['cost'] < 0.5


def test_head_counts_a_vent_whose_lava_has_left() -> None:
    high = Vent((10.0, 35.0), ((0.0, 20.0), (1.0, 0.0)), radius=1.0)
    low = Vent((10.0, 10.0), ((100.0, 20.0),), radius=1.0)
    slope = np.add.outer(3.0 * np.arange(40.0), np.zeros(20))
    simulation, watch = flow(
        slope, Lava.paper(viscosity=1.0), high, low, spacing=1.0, thickness=1.0
    )
    simulation.advance(100.0)
    assert not len(simulation.sample().volume)
    watch.check()
    simulation.advance(101.0)
    watch.check()
    # the fall from the low vent is 30 m
    assert (simulation.sample().velocity ** 2).sum(axis=1).max() / 19.62 > 35.0


@pytest.mark.parametrize('steep', ['steep', ''])
def test_jet_climbs_by_its_velocity_head(steep: str) -> None:
    heights = [*[0.0] * 6, 60.0, 120.0, 180.0, 240.0]
    jet = Vent((60.0, 30.0), ((0.0, 2000.0), (1.0, 0.0)), radius=5.0, velocity=(0.0, 40.0))
    simulation, watch = flow(
        np.repeat(np.array(heights)[:, None], 6, 1), Lava.paper(viscosity=100.0), jet, cell=20.0,
        on=f'inertia {steep}', spacing=10.0, ratio=3.5,
    )
    assert len(list(frames(simulation, watch, 6.0, 3))) == 3
    climbed = float(simulation.sample().position[:, 1].max()) > 140.0
    assert climbed == bool(steep)


def test_greens_function_may_raise_stiff_lava_next_to_runny_lava() -> None:
    columns = Particles([[3.5, 4.0], [4.5, 4.0]], [100.0, 20.0], [1300.0, 1100.0])
    simulation, watch = flow(
        np.zeros((8, 8)), Lava.paper(viscosity=1e6, arrhenius=0.04), columns,
        on='steep arrhenius green',
        spacing=1.0, ratio=3.5,
    )
    before = simulation.sample().thickness.sum()
    simulation.advance(2.0)
    watch.check()
    assert simulation.sample().thickness.sum() != before
    assert 0.0 < watch.largest['energy'] < 1.0


def test_vent_next_to_a_spike_emits_on_the_spline() -> None:
    elevation = np.zeros((3, 33))
    elevation[2, 25] = 235.0
    vent = Vent((26.5 * 2.4, 0.999 * 2.4), discharge=1.6, temperature=900.0, radius=2.4)
    simulation, watch = flow(
        elevation, Lava.paper(viscosity=1.0), vent, cell=2.4, on='', spacing=1.2,
        deterministic=True,
        precision='float64',
    )
    assert len(list(frames(simulation, watch, 20.0, 20))) == 20
    assert watch.largest['energy'] > 1e-3


def test_crust_without_conductivity_insulates() -> None:
    simulation = simulated(
        incline(0.05, 24, 39, 2.0), Lava.paper(conductivity=0.0), Vent((30.0, 24.0), 20.0, 1400.0),
        effects=Effects(crust=True, ground=True, conduction=True), spacing=2.0, deterministic=True,
    )
    simulation.advance(20.0)
    assert simulation.snapshot().flaw() == ''
    assert simulation.sample().temperature.min() == pytest.approx(1400.0, abs=0.01)
