# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The map: extent, thickness at the margin, and volume."""

import math

import numpy as np
import pytest

from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.simulation import Particles, Simulation
from lava_ros.simulation.presets import PRESETS
from lava_ros.verification.exact import FixedVolumeSpread
from solver import flat, only, simulated
from volume import SINGLE, volume_errors

RADIUS, VOLUME = 130.0, 1e5
DOME = FixedVolumeSpread(VOLUME, 1e4 / 2600.0, 9.81)
TIME = DOME.time_of_radius(RADIUS)


def mapped(count, ratio, device='cpu', cells=300):
    """Return the map of Huppert's profile given as particles, on a square of 400 m."""
    simulation = simulated(
        flat(cells, 400.0 / cells), Lava.paper(),
        Particles(DOME.particles(count, TIME), VOLUME / count, 1400.0), effects=only(),
        device=device, spacing=RADIUS * math.sqrt(math.pi / count),
        thickness=VOLUME / (math.pi * RADIUS**2), ratio=ratio,
    )
    return simulation.snapshot().thickness


def exact_means(cells, parts=8):
    """Return the mean of Huppert's profile over each of the cells."""
    places = (np.arange(cells * parts) + 0.5) * 400.0 / (cells * parts) - 200.0
    distance = np.minimum(np.hypot(places, places[:, None]), RADIUS)
    exact = DOME.thickness(distance, TIME)
    return exact.reshape(cells, parts, cells, parts).mean(axis=(1, 3))


@pytest.mark.parametrize(('count', 'ratio'), [(500, 2.5), (2000, 3.0), (8000, 3.5)])
def test_inundated_area_does_not_grow_with_the_kernel(device, count, ratio):
    """The radius is accurate to 1 %; that of a plain sum is 1 to 5 % too large."""
    maps = mapped(count, ratio, device), exact_means(300)
    wet = [np.count_nonzero(item > 0.1) for item in maps]
    assert math.sqrt(wet[0]) == pytest.approx(math.sqrt(wet[1]), rel=0.01)


def test_coarse_cells_have_the_means_of_fine_ones(device):
    fine, coarse = (mapped(2000, 3.5, device, cells=cells) for cells in (400, 80))
    means = fine.reshape(80, 5, 80, 5).mean(axis=(1, 3))
    error = np.abs(coarse - means).sum() / means.sum()
    # with all or nothing per cell 1.7 %; cells less than half covered hold no lava
    assert error < 0.0045


def slope(valley=0.0, holes=False, rows=30, columns=40, cell=5.0):
    """Return a plane that falls towards +x, with a valley of a few cells or holes on the way."""
    x, y = (np.arange(columns) + 0.5) * cell, (np.arange(rows) + 0.5) * cell
    elevation = 100.0 - 0.1 * x + valley * np.abs(y - 0.5 * rows * cell)[:, None]
    if holes:
        elevation[12:20, 14:17] = np.nan
        elevation[18:, 5] = np.nan
    return Terrain(elevation, cell)


FINER = ('standard', 'fine', 'reference')

#: Terrain, position of the vent, and lava.
SCENES = {
    'plane': (slope(), (60.0, 75.0), Lava.paper(viscosity=5e3)),
    'valley': (slope(valley=0.6), (60.0, 76.0), Lava.paper(viscosity=5e3)),
    'holes': (slope(holes=True), (62.0, 80.0), Lava.paper(viscosity=2e3)),
    'border': (slope(), (192.0, 6.0), Lava.paper(viscosity=2e3)),
    'freezing': (
        slope(),
        (60.0, 75.0),
        Lava.paper(viscosity=5e3, arrhenius=0.0, convection=2000.0, solidus=1400.0),
    ),
}


@pytest.mark.parametrize(
    'preset',
    ['draft', *(pytest.param(name, marks=pytest.mark.nightly) for name in FINER)],
)
@pytest.mark.parametrize('scene', SCENES)
def test_map_has_the_volume_of_particles_and_deposit(device, scene, preset):
    terrain, place, lava = SCENES[scene]
    simulation = Simulation(
        Scene(terrain, (Vent(place, 20.0, temperature=1423.0, radius=5.0),), lava),
        effects={'solidification': scene == 'freezing', 'insulation': False},
        accuracy=PRESETS[preset].accuracy,
        device=device,
    )
    simulation.advance(60.0)
    snapshot = simulation.snapshot()
    budget = snapshot.budget
    assert snapshot.flaw() == ''
    assert (budget.lost_in_no_data > 0.0) == (scene == 'holes')
    assert (budget.lost_over_border > 0.0) == (scene == 'border')
    assert (budget.solidified > 0.0) == (scene == 'freezing')
    volume = np.nansum(snapshot.thickness, dtype=np.float64) * terrain.resolution**2
    held = budget.flowing + budget.solidified
    assert volume == pytest.approx(held, rel=1e-5)
    assert (np.isnan(snapshot.thickness) == ~terrain.has_data).all()


@pytest.mark.parametrize('cell', [0.5, 4.0, 30.0])
@pytest.mark.parametrize('place', [(60.0, 60.0), (60.1, 71.3), (0.2, 119.9)])
def test_single_particle_keeps_its_volume_on_any_cell(device, cell, place):
    ground, lone = Terrain(np.zeros((round(120.0 / cell),) * 2), cell), [place]
    knobs = {'device': device, 'spacing': 4.0, 'thickness': 1.0}
    snapshot = simulated(ground, Lava.paper(), Particles(lone, 16.0, 1400.0), **knobs).snapshot()
    assert snapshot.thickness.sum() * cell**2 == pytest.approx(16.0, rel=1e-5)
    assert snapshot.temperature[snapshot.thickness > 0.0] == pytest.approx(1400.0, rel=1e-6)


@pytest.mark.parametrize('thickness', [0.1266, 0.4642, 1.343])
def test_map_conserves_volume_where_a_kernel_covers_all_cells(device, thickness):
    """A plain sum over 1,600 alike cells rounds in one direction: the error was 2e-5."""
    lava = Particles([(0.01, 0.02)], thickness * 880.0**2, 1400.0)
    knobs = {'device': device, 'spacing': 880.0, 'thickness': 1.0}
    snapshot = simulated(flat(40, 0.088), Lava.paper(), lava, **knobs).snapshot()
    assert volume_errors(snapshot, SINGLE) == []


def test_narrow_stream_is_in_the_cells_that_contain_it(device):
    x = np.arange(1.0, 119.0, 2.0)
    lava = Particles(np.column_stack([x, np.full_like(x, 47.0)]), 4.0, 1400.0)
    knobs = {'device': device, 'spacing': 2.0, 'thickness': 1.0}
    simulation = simulated(Terrain(np.zeros((6, 6)), 20.0), Lava.paper(), lava, **knobs)
    exact = np.zeros((6, 6))
    exact[2] = np.bincount((x / 20.0).astype(int), minlength=6) * 4.0 / 400.0
    assert simulation.snapshot().thickness == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize(
    ('count', 'cells', 'error'),
    [(500, 40, 0.04), (500, 100, 0.035), (2000, 100, 0.016), (8000, 40, 0.012), (8000, 100, 8e-3)],
)
def test_error_of_the_thickness_falls_with_the_spacing(count, cells, error):
    """Plain sums of V W over their cover had 4.5, 4.2, 1.9, 1.6 and 0.9 %."""
    wrong = np.abs(mapped(count, 3.5, cells=cells) - exact_means(cells)).sum()
    assert wrong * (400.0 / cells) ** 2 < error * VOLUME


@pytest.mark.parametrize('wavelength', [2.4, 3.0])
def test_map_restores_the_height_of_waves(wavelength):
    """To first order the map undoes the kernel's smoothing (docs/MODEL.md).

    If T is the kernel's transform, a plain sum of V W scales a wave by T, and the map by
    T + (1 - T^2) (T^2 - T / 2).
    """
    radius, side, thickness = 3.5, 80.0, 1.0
    wave = 2.0 * math.pi / (wavelength * radius)
    q = (np.arange(20000) + 0.5) / 20000
    angle = (np.arange(400) + 0.5) * math.pi / 400
    bessel = np.cos(np.outer(wave * radius * q, np.cos(angle))).mean(axis=1)
    smoothed = 14.0 * np.mean((1.0 - q) ** 4 * (1.0 + 4.0 * q) * q * bessel)
    # columns of equal volume, moved so that their density has the wave
    steps = np.linspace(0.0, side, 100001)
    held = steps + 0.1 / wave * np.sin(wave * (steps - 0.5 * side))
    places = (np.arange(round(side)) + 0.5) / round(side)
    x = np.interp(held[0] + places * (held[-1] - held[0]), held, steps)
    y = np.arange(0.5, side)
    rows = np.column_stack([np.tile(x, len(y)), np.repeat(y, len(x))])
    simulation = simulated(
        Terrain(np.zeros((160, 160)), 0.5), Lava.paper(),
        Particles(rows, thickness * (held[-1] - held[0]) / side, 1400.0), spacing=1.0,
        thickness=thickness, ratio=radius, raster_ratio=1.0,
    )
    middle = (np.arange(160) + 0.5) * 0.5 - 0.5 * side
    inside = np.abs(middle) < wavelength * radius
    line = simulation.snapshot().thickness[60:100].mean(axis=0)[inside]
    gain = np.polyfit(np.cos(wave * middle[inside]), line, 1)[0] / 0.1
    exact = smoothed + (1.0 - smoothed**2) * (smoothed**2 - 0.5 * smoothed)
    assert smoothed < 0.9
    assert gain == pytest.approx(exact, abs=0.01)
    assert abs(1.0 - gain) < 0.65 * (1.0 - smoothed)
