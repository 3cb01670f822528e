# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The hardest scene of each kind keeps every invariant; each safeguard has a scene that needs it.

``make hard`` runs all scenes at all presets; ``make safeguards`` removes the safeguards in turn.
"""

import csv
from dataclasses import replace

import numpy as np
import pytest

from hard import run
from hard.case import PHYSICS
from hard.invariants import InvariantError, Watch
from hard.play import play
from hard.safeguards import ROOT, SAFEGUARDS
from hard.scenes import FAMILIES, SCENES
from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.cells import solver as cell_solver
from lava_ros.simulation.step import stage

#: A scene of each family that violated an invariant, or cost most, in earlier versions of the
#: solver. The safeguards have others.
HARDEST = (
    'viscosity_mixed', 'dam_onto_film', 'holes', 'vent_flickers', 'piled_up_lateral',
    'freezes_in_noise', 'late',
)

#: More of them, nightly; `make hard` runs all.
HARD = (
    'viscosity_1_inertia', 'viscosity_two_vents', 'column_200_m', 'thick_200_m', 'spike', 'canyon',
    'canyon_film', 'wall_89_degrees', 'noise_level', 'vents_over_each_other', 'coincident',
    'leaving_corner', 'heated_by_fall_inertia', 'held_by_strength', 'chilled_at_once', 'far_out',
    'ground_drops', 'vents_replaced',
)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize(
    ('name', 'compare'),
    [
        *((name, False) for name in HARDEST),
        *(pytest.param(name, True, marks=pytest.mark.nightly) for name in (*HARDEST, *HARD)),
    ],
)
def test_the_hardest_scenes_keep_every_invariant(name, compare, method, device):
    """Nightly also with steps half as long."""
    outcome = play(SCENES[name], 'standard', method=method, device=device, compare=compare)
    assert outcome.verdict == 'holds', outcome.violations


def test_every_family_has_a_hardest_scene():
    assert len(SCENES) == sum(map(len, FAMILIES.values())) >= 60
    for name, family in FAMILIES.items():
        assert {item.name for item in family} & set(HARDEST), name


def _in_a_cell(count: int, device: str) -> Simulation:
    places = np.random.default_rng(1).uniform(0.0, 4.9, (count, 2))
    return Simulation(
        SCENES['no_particles'].scene, effects=PHYSICS['plain'], accuracy=Accuracy(thickness=1.0),
        device=device, particles=Particles(places, 1e-3, 1423.0),
    )


def test_rejects_too_many_particles_in_a_cell(device):
    with pytest.raises(LavaError, match=r'particles.*40000 in .* at most 32768'):
        _in_a_cell(40_000, device)


def test_rejects_lava_that_piles_up_at_its_vent(device):
    simulation = _in_a_cell(30_000, device)
    more = np.random.default_rng(2).uniform(0.0, 4.9, (5_000, 2))
    simulation.solver.add_particles([(*place, 1e-3, 1423.0) for place in more])
    with pytest.raises(LavaError, match='35000 in'):
        simulation.snapshot()


def _film(
    effects: Effects = PHYSICS['plain'], method: str = 'particles', **lava: float
) -> Simulation:
    item = SCENES['film_1_mm']
    return Simulation(
        replace(item.scene, lava=replace(item.scene.lava, **lava)), effects=effects,
        accuracy=Accuracy(method=method, thickness=0.001), device='cpu', particles=item.lava(5.0),
    )


@pytest.mark.spoils_volume
@pytest.mark.parametrize(
    ('column', 'value', 'invariant'),
    [
        (0, np.nan, 'finite'), (2, 1000.0, 'volume'), (3, 1500.0, 'temperature'),
        (3, 200.0, 'temperature'), (1, 75.0, 'energy'), (1, 75.0, 'climb'),
    ],
)
def test_watch_detects_an_invalid_particle(column, value, invariant):
    simulation = _film()
    watch = Watch(simulation)
    watch.check()
    rows = simulation.solver.state.read_particles()
    rows[0, column] = value
    simulation.solver.state.write_particles(rows)
    simulation.advance(1e-3)
    with pytest.raises(InvariantError, match=invariant):
        watch.check()


@pytest.mark.spoils_volume
@pytest.mark.parametrize(
    ('name', 'row', 'value', 'invariant'),
    [
        ('thickness', 22, np.nan, 'finite'), ('thickness', 22, 0.002, 'volume'),
        ('temperature', 22, 1500.0, 'temperature'), ('temperature', 22, 200.0, 'temperature'),
        ('thickness', 31, 0.001, 'energy'), ('thickness', 31, 0.001, 'climb'),
    ],
)
def test_watch_detects_an_invalid_cell(name, row, value, invariant):
    simulation = _film(method='cells')
    watch = Watch(simulation)
    watch.check()
    lava = simulation.solver.columns()
    if row == 31:
        # lava moves up to the edge of the map
        lava.thickness[22, 16] = 0.0
    getattr(lava, name)[row, 16] = value
    simulation.solver.put(lava)
    simulation.advance(1e-3)
    with pytest.raises(InvariantError, match=invariant):
        watch.check()


def test_watch_detects_vents_with_overdue_lava():
    simulation = _film()
    shown = simulation.snapshot()
    late = replace(shown, budget=replace(shown.budget, overdue=1.0))
    with pytest.raises(InvariantError, match='vents .* that wait in them'):
        Watch(simulation).check(late)


@pytest.mark.parametrize(('method', 'effects'), [
    *((method, PHYSICS['plain']) for method in METHODS),
    pytest.param('particles', Effects(power_law=True), marks=pytest.mark.nightly),
])
def test_watch_detects_steps_that_are_too_short(method, effects, monkeypatch):
    own = cell_solver if method == 'cells' else stage
    longest = own.longest_step
    monkeypatch.setattr(own, 'longest_step', lambda *of: 1e-3 * longest(*of))
    simulation = _film(effects, method, flow_index=0.8)
    watch = Watch(simulation)
    simulation.advance(300.0)
    with pytest.raises(InvariantError, match=r'cost .* > .*evaluations in the frame'):
        watch.check()


@pytest.mark.parametrize('safeguard', SAFEGUARDS, ids=lambda item: item.name)
def test_line_of_the_safeguard_occurs_once(safeguard):
    text = (ROOT / safeguard.file).read_text(encoding='utf-8')
    assert text.count(safeguard.line) == 1


@pytest.mark.parametrize('safeguard', [
    # lateral stress takes a second
    pytest.param(item, marks=pytest.mark.nightly if item.name in ('thickest', 'drag') else ())
    for item in SAFEGUARDS
], ids=lambda item: item.name)
def test_scene_that_misses_it(safeguard):
    """The scene does not hold if the line is removed."""
    compare = safeguard.invariant == 'halving'
    outcome = play(SCENES[safeguard.scene], safeguard.preset, compare=compare, wall_limit=600.0)
    assert outcome.verdict == 'holds', outcome.violations


WORDS = ('--scene', 'no_particles', '--preset', 'draft', '--device', 'cpu', '--jobs', '1')


@pytest.mark.nightly
def test_command_creates_the_folder_of_its_table(tmp_path):
    assert run.main([*WORDS, '--csv', str(tmp_path / 'a/b')]) == 0
    with (tmp_path / 'a/b/hard_cpu.csv').open(encoding='utf-8', newline='') as table:
        (row,) = csv.DictReader(table)
    assert (row['case'], row['verdict'], row['asymmetry']) == ('no_particles', 'holds', '')
