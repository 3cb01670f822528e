# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Any number of updates of vents and terrain does not change the flow."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from lava_ros.effects import Effects
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.output.checkpoint import from_bytes
from lava_ros.simulation.presets import preset_accuracy

#: A slope towards +x of cells of 5 m.
GROUND = Terrain(np.tile(-0.5 * np.arange(140.0), (180, 1)), 5.0)

LAVA = Lava.paper(viscosity=1e5, emissivity=0.0, convection=0.0)

#: Number of particles emitted in a run: half of them are still moving at the end.
COUNT = 200.5

MIDDLE = Vent((205.0, 455.0), 1.0, temperature=1400.0, radius=20.0)

SOURCES = {
    'disc': (MIDDLE,),
    'fissure': (Vent((205.0, 255.0), 1.0, temperature=1400.0, radius=5.0, end=(205.0, 655.0)),),
    'two in one place': (
        replace(MIDDLE, discharge=0.6),
        replace(MIDDLE, discharge=0.4, temperature=1250.0),
    ),
    'several': (
        replace(MIDDLE, discharge=0.5, name='a'),
        replace(MIDDLE, discharge=0.2, name='b', position=(205.0, 255.0), radius=5.0),
        replace(MIDDLE, discharge=0.3, name='c', position=(215.0, 475.0)),
    ),
}


class Flow(NamedTuple):
    """Result of a run: wet cells, width [m], particles, mean temperature [K]."""

    is_wet: np.ndarray
    width: float
    count: int
    temperature: float


def moved(vent: Vent, shift: float) -> Vent:
    """Return a vent at another place, ``shift`` to the north [m]."""
    (x, y), end = vent.position, vent.end
    return replace(
        vent, position=(x, y + shift), end=None if end is None else (end[0], end[1] + shift)
    )


def updated(kind: str, vents: tuple[Vent, ...], number: int) -> tuple[Vent, ...]:
    """Return the vents in message `number`, changed in one property."""
    sign = 1 - 2 * (number % 2)
    change: Callable[[Vent], Vent] = {
        'place': lambda vent: moved(vent, 5e-4 * sign),
        'temperature': lambda vent: replace(vent, temperature=vent.temperature + 0.5 * sign),
        'radius': lambda vent: replace(vent, radius=vent.radius * (1.0 + 1e-3 * sign)),
        'name': lambda vent: replace(vent, name=f'{vent.name} {number}'),
    }.get(kind, lambda vent: replace(vent, discharge=vent.discharge * (1.0 + 1e-6 * sign)))
    if kind == 'distant vent':
        return (*vents, Vent((605.0, 105.0), 1e-9 * (2 + sign), temperature=1400.0))
    result = tuple(map(change, vents))
    return result[::sign] if kind == 'order' else result


def run(source: str, kind: str, rate: float, device: str, effects: Effects) -> Flow:
    """Run a source with ``rate`` updates per emitted particle."""
    vents = SOURCES[source]
    simulation = Simulation(
        Scene(GROUND, vents, LAVA), effects=effects, device=device,
        accuracy=preset_accuracy('standard'),
    )
    duration = COUNT * simulation.accuracy.particle_volume / sum(vent.peak for vent in vents)
    updates = max(round(COUNT * rate), 1)
    for number in range(updates):
        simulation.advance(duration * (number + 1) / updates)
        if kind == 'terrain':
            noise = np.random.default_rng(number).uniform(-5e-4, 5e-4, GROUND.shape)
            simulation.set_terrain(Terrain(GROUND.elevation + noise, 5.0))
        elif kind != 'none':
            simulation.set_vents(updated(kind, vents, number))
        if kind == 'resumed':
            stored = simulation.checkpoint().to_bytes()
            simulation = Simulation.resume(from_bytes(stored), device=device)
    sample = simulation.sample()
    return Flow(
        simulation.snapshot().thickness > 0.05, float(np.ptp(sample.position[:, 1])),
        simulation.particle_count,
        float((sample.volume * sample.temperature).sum() / sample.volume.sum()),
    )


@cache
def undisturbed(source: str, device: str) -> Flow:
    return run(source, 'none', 0.0, device, Effects(steep=True))


KINDS = ('place', 'temperature', 'radius', 'name', 'distant vent', 'order', 'terrain', 'resumed')


def streams() -> Iterator[Any]:
    """Return every kind of update for every source, most of them nightly."""
    rates = [('discharge', rate) for rate in (10.0, 1.0, 0.1)]
    for source in SOURCES:
        for kind, rate in (*rates, *((kind, 1.0) for kind in KINDS)):
            some = ('discharge', 'place', 'distant vent', 'terrain')
            is_for_every_run = source == 'several' and rate == 1.0 and kind in some
            yield pytest.param(
                source, kind, rate, marks=() if is_for_every_run else pytest.mark.nightly
            )


@pytest.mark.parametrize(('source', 'kind', 'rate'), list(streams()))
def test_updates_of_vents_and_terrain_do_not_change_the_flow(
    source: str, kind: str, rate: float, device: str
) -> None:
    expected = undisturbed(source, device)
    flow = run(source, kind, rate, device, Effects(steep=True))
    both, either = flow.is_wet & expected.is_wet, flow.is_wet | expected.is_wet
    assert both.sum() >= 0.97 * either.sum() > 40
    assert flow.width == pytest.approx(expected.width, rel=0.03)
    assert flow.count == pytest.approx(expected.count, rel=0.05)
    assert flow.temperature == pytest.approx(expected.temperature, abs=1.5)


def test_vent_that_reopens_often_does_not_emit_from_one_place(device: str) -> None:
    expected = undisturbed('disc', device)
    simulation = Simulation(
        Scene(GROUND, (MIDDLE,), LAVA), effects=Effects(steep=True), device=device,
        accuracy=preset_accuracy('standard'),
    )
    duration, updates = COUNT * simulation.accuracy.particle_volume, 200
    for number in range(updates):
        # closed for half of the time, and twice the discharge for the other half
        for vents, end in (((replace(MIDDLE, discharge=2.0),), 0.5), ((), 1.0)):
            simulation.set_vents(vents)
            simulation.advance(duration * (number + end) / updates)
    assert np.ptp(simulation.sample().position[:, 1]) == pytest.approx(expected.width, rel=0.1)
    assert simulation.budget().emitted == pytest.approx(duration)


@pytest.mark.parametrize('kind', ['terrain', pytest.param('vents', marks=pytest.mark.nightly)])
def test_updates_do_not_stop_slow_lava(kind: str, device: str) -> None:
    """A displacement below the resolution of float32 is kept across updates."""
    ground = Terrain(np.tile(-0.5 * np.arange(40.0), (3, 1)), 1000.0)
    slow = Vent((1500.0, 1500.0), ((0.0, 100.0), (1e4, 0.0)), temperature=1400.0)
    other = Vent((30500.0, 1500.0), 0.1, temperature=1400.0)

    def advance_front(updates: int) -> float:
        simulation = Simulation(
            Scene(ground, (slow,), replace(LAVA, viscosity=1e10)), effects=Effects(),
            accuracy=replace(preset_accuracy('standard'), spacing=100.0, thickness=5.0),
            device=device,
        )
        fronts = []
        for number in range(100):
            if number < updates and kind == 'terrain':
                simulation.set_terrain(replace(ground, elevation=ground.elevation + number % 2))
            elif number < updates:
                # its emitted volume becomes a particle when it closes
                simulation.set_vents((slow, other) if number % 2 else (slow,))
            simulation.advance(1e4 + 2000.0 * number)
            x = simulation.sample().position[:, 0]
            fronts.append(x[x < 10_000.0].max())
        return float(fronts[-1] - fronts[0])

    expected = advance_front(0)
    assert expected > 0.05
    assert advance_front(100) == pytest.approx(expected, rel=0.01)
