# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Checkpoints with a valid checksum that no simulation has written."""

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import asdict, replace
import math
import re
from typing import Any

import numpy as np
import pytest

from lava_ros.errors import LavaError
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.output.checkpoint import Checkpoint, from_bytes
from lava_ros.simulation.output.checkpoint_contents import check_contents, FEW

SLOPE = Terrain(np.tile(-np.arange(40.0), (40, 1)).astype(np.float32), 10.0)
PARTICLES = 'state.particle'

_checkpoints: dict[str, Checkpoint] = {}


@pytest.fixture
def checkpoint(device: str) -> Checkpoint:
    """Return a checkpoint of lava that solidifies."""
    return checkpoint_of('particles', device)


def checkpoint_of(method: str, device: str) -> Checkpoint:
    """Return a checkpoint of a method for lava that solidifies."""
    key = f'{method} on {device}'
    if key not in _checkpoints:
        lava = Lava.paper(viscosity=1e4, solidus=1300.0)
        scene = Scene(SLOPE, (Vent((100.0, 200.0), 5.0, temperature=1360.0),), lava)
        simulation = Simulation(
            scene, effects={'solidification': True}, accuracy=Accuracy(method=method),
            device=device,
        )
        simulation.advance(600.0)
        _checkpoints[key] = simulation.checkpoint()
    return _checkpoints[key]


def column(number: int, edit: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that changes a column of an array."""

    def change(values: np.ndarray) -> np.ndarray:
        values = values.copy()
        values[:, number] = edit(values[:, number])
        return values

    return change


def with_array(checkpoint: Checkpoint, name: str, edit: Callable[[Any], Any]) -> Checkpoint:
    """Return a checkpoint with a changed array, as read from its bytes."""
    arrays = {**checkpoint.arrays, name: edit(checkpoint.arrays[name])}
    return from_bytes(replace(checkpoint, arrays=arrays).to_bytes())


@pytest.mark.parametrize(('name', 'edit'), [
    (PARTICLES, column(2, lambda volume: 10.0 * volume)),
    (PARTICLES, column(2, lambda volume: 0.5 * volume)),
    (PARTICLES, column(2, lambda volume: 0.0 * volume)),
    (PARTICLES, column(2, lambda volume: 1e30 + volume)),
    (PARTICLES, column(3, lambda temperature: 0.0 * temperature)),
    (PARTICLES, column(3, lambda temperature: -temperature)),
    (PARTICLES, column(3, lambda temperature: 1e6 + temperature)),
    (PARTICLES, column(0, lambda x: x + 1e5)),
    (PARTICLES, column(1, lambda y: y + 1e30)),
    ('state.remainder', lambda values: values + 1e30),
    ('state.temperature_remainder', lambda values: values + 1e30),
    ('state.left', lambda values: values + 1e300),
    ('state.left', lambda values: values - 100.0),
    ('vents.volume', lambda values: values + 1e300),
    ('vents.released', lambda values: 3 * values),
    ('arrived.times', lambda values: values + 1e6),
    ('solidified.deposit', lambda values: values + 2**62),
    ('solidified.placed', lambda values: values + 2**50),
])
def test_refuses_numbers_that_no_simulation_has(name, edit, checkpoint, device):
    changed = with_array(checkpoint, name, edit)
    with pytest.raises(LavaError, match='checkpoint[.]') as caught:
        Simulation.resume(changed, device=device)
    assert re.search(f'{name}|checkpoint.volume', str(caught.value))


@pytest.mark.parametrize(('name', 'edit'), [
    ('arrived.half_inundated', lambda values: values + 1e6),
    ('arrived.half_inundated', lambda values: values - 1e6),
    ('arrived.squares', lambda values: values + 2**30),
    ('arrived.squares', lambda values: -values),
    ('arrived.bounds', lambda values: values + 1000),
    ('arrived.bounds', lambda values: -values),
])
@pytest.mark.parametrize('method', METHODS)
def test_refuses_covered_cells_that_no_simulation_has(name, edit, method, device):
    changed = with_array(checkpoint_of(method, device), name, edit)
    with pytest.raises(LavaError, match=name):
        Simulation.resume(changed, device=device)


@pytest.mark.parametrize(('name', 'edit'), [
    ('cells.left', lambda values: values - 100.0),
    ('cells.fluidity', lambda values: -values),
    ('cells.peaks', lambda values: -values),
    ('cells.peaks', lambda values: 0.0 * values),
    ('heat.temperature', lambda values: -values),
    ('heat.temperature', lambda values: 0.0 * values),
    ('heat.temperature', lambda values: values + 1e300),
])
def test_refuses_columns_that_no_simulation_has(name, edit, device):
    changed = with_array(checkpoint_of('cells', device), name, edit)
    with pytest.raises(LavaError, match=name):
        Simulation.resume(changed, device=device)


def spoiled(values: np.ndarray, number: float) -> Iterator[np.ndarray]:
    """Yield an array filled with a number, and arrays with the number in one of a few items.

    Integers that have no such number get the largest or the smallest of their type.
    """
    if values.dtype.kind == 'i':
        limits = np.iinfo(values.dtype)
        number = int(min(max(np.nan_to_num(number), limits.min), limits.max))
    yield np.full_like(values, number)
    for index in range(values.size) if values.size <= 12 else (values.size // 2,):
        changed = values.copy()
        changed.flat[index] = number
        yield changed


OTHER_TYPES = {
    'float32': 'float64', 'float64': 'float32', 'int32': 'float64', 'int64': 'int32'
}

#: Wrong values of every array: numbers, and functions that change its shape or type.
SPOILED = {
    'not a number': math.nan, 'infinite': math.inf, 'negative': -1.0, 'huge': 1e30,
    'huge and negative': -1e30,
    'one more': lambda values: np.append(values, values.flat[:1]),
    'one less': lambda values: values[:-1],
    'one more axis': lambda values: values[None],
    'of another type': lambda values: values.astype(OTHER_TYPES[str(values.dtype)]),
}

#: Methods, effects with arrays of their own, and constants that these need.
RUNS = {
    'particles': ('particles', {'solidification': True, 'inertia': True}, {}),
    'particles with merging': (
        'particles', {'merging': True, 'conduction': True},
        {'conductivity': 1.0, 'ground_conductivity': 1.0},
    ),
    'cells': ('cells', {'solidification': True}, {'yield_strength': 100.0}),
}

#: Sums and times that an array has to agree with, and arrays by which cells are checked.
TOGETHER = 'volume|time|cells.peaks|state.remainder'


@pytest.mark.spoils_volume
@pytest.mark.parametrize('wrong', SPOILED)
@pytest.mark.parametrize('run', RUNS)
def test_spoiled_arrays_are_refused_or_harmless(run, wrong, device):
    whole = spoiled_run(run, device)
    for name, values in whole.arrays.items():
        change = SPOILED[wrong]
        for changed in [change(values)] if callable(change) else spoiled(values, change):
            if changed.shape == values.shape and np.array_equal(changed, values):
                continue
            try:
                simulation = Simulation.resume(
                    with_array(whole, name, lambda _, new=changed: new), device=device
                )
            except LavaError as error:
                assert re.match(f'checkpoint[.]({name}|{TOGETHER})', str(error)), name
                continue
            assert changed.shape[1:] == values.shape[1:], name
            simulation.advance(whole.time + 10.0)
            assert simulation.snapshot().flaw() == '', name


def spoiled_run(run: str, device: str) -> Checkpoint:
    """Return a checkpoint of ``RUNS``, with two vents."""
    key = f'{run} of RUNS on {device}'
    if key not in _checkpoints:
        method, effects, constants = RUNS[run]
        lava = Lava.paper(viscosity=1e4, solidus=1300.0, **constants)
        vents = (
            Vent((100.0, 200.0), 5.0, temperature=1360.0),
            Vent((200.0, 200.0), 5.0, temperature=1360.0),
        )
        simulation = Simulation(
            Scene(SLOPE, vents, lava), effects=effects, accuracy=Accuracy(method=method),
            device=device,
        )
        simulation.advance(600.0)
        _checkpoints[key] = simulation.checkpoint()
    return _checkpoints[key]


@pytest.mark.parametrize('axis', [0, 1])
@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_accepts_lava_that_has_crossed_the_border_by_less_than_a_cell(axis, sign, checkpoint):
    spacing = checkpoint.accuracy.spacing
    assert spacing is not None
    # the sides are 400 m long, a cell 10 m
    for beyond, is_valid in ((10.0 + 0.9 * spacing, True), (10.0 + 1.1 * spacing, False)):
        place = sign * (200.0 + beyond)
        moved = with_array(checkpoint, PARTICLES, column(axis, lambda x, to=place: 0.0 * x + to))
        with nullcontext() if is_valid else pytest.raises(LavaError, match='from the centre'):
            check_contents(moved)


@pytest.mark.parametrize('change', [
    {'emitted': -1e9}, {'emitted': 1e9}, {'since': -1e9}, {'since': 1e9}, {'since': 601.0},
    {'time': 0.0},
])
def test_refuses_volumes_and_times_that_do_not_add_up(change, checkpoint, device):
    changed = from_bytes(replace(checkpoint, **change).to_bytes())
    with pytest.raises(LavaError, match='checkpoint[.]'):
        Simulation.resume(changed, device=device)


@pytest.mark.parametrize('capacity', [2**31 - 1, 200_000_000])
def test_capacity_is_bounded_by_the_particles(capacity, checkpoint, device):
    changed = from_bytes(replace(checkpoint, capacity=capacity).to_bytes())
    simulation = Simulation.resume(changed, device=device)
    assert simulation.solver.state.capacity == FEW
    simulation.advance(900.0)
    expected = Simulation.resume(checkpoint, device=device)
    expected.advance(900.0)
    # the order in which a GPU adds up volumes varies
    assert asdict(simulation.budget()) == pytest.approx(asdict(expected.budget()), rel=1e-9)
