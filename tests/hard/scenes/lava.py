# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hard scenes of lava: viscosity from 1 to 1e11 Pa s, thickness from 1 mm to 200 m, heat.

Viscosity jumps by a million within a cell. Lava solidifies at the vent, is reheated, is as cold as
the air, or is held by its strength. Particles coincide, are single, are absent, differ vastly in
volume, or leave the map. Vents are on ridges, in pits, at borders and on each other; they are
weak, strong and flickering.
"""

from dataclasses import replace

import numpy as np

from hard.case import block, both, CELL, HardScene, material, plane, scene, terrain, vent
from hard.scenes.terrain import caldera
from lava_ros.scene import Scene, Terrain
from lava_ros.scene.lava import Lava
from lava_ros.simulation import Particles

#: Arrhenius rate for which 345 K change the viscosity by a factor of a million.
MILLION = 0.04

HOT, COLD = 1423.0, 1078.0


def _hollow(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return level ground between slopes of 79 degrees, 60 m from the middle."""
    return 5.0 * np.maximum(np.maximum(np.abs(x), np.abs(y)) - 60.0, 0.0)


def _halves(places: np.ndarray) -> np.ndarray:
    return np.where(places[:, 1] > 0.0, HOT, COLD)


def _mixed(places: np.ndarray) -> np.ndarray:
    """Return lava whose particles are hot or cold at random."""
    return np.where(np.random.default_rng(3).random(len(places)) < 0.5, HOT, COLD)


VISCOSITY = (
    HardScene('viscosity_1', 'lava like oil down a slope',
              scene(plane(0.05), (vent(0.0, 50.0),), material(viscosity=1.0)), 30.0,
              mirrored=True),
    HardScene('viscosity_1_block', 'a block of oil, 5 m thick, let go',
              scene(None, (), material(viscosity=1.0)), 0.02, lava=block(40.0, 40.0, 5.0),
              thickness=5.0, mirrored=True),
    HardScene('viscosity_1_inertia', 'the same block with inertia',
              scene(None, (), material(viscosity=1.0)), 4.0, 'inertia',
              lava=block(40.0, 40.0, 5.0), thickness=5.0, mirrored=True),
    HardScene('viscosity_1e11_dome', 'a dome so stiff that it hardly moves',
              scene(None, (), material(viscosity=1e11)), 2e4, lava=block(60.0, 60.0, 40.0),
              thickness=40.0, mirrored=True),
    HardScene('viscosity_1e11_vent', 'a spine that grows out of a vent',
              scene(plane(0.1), (vent(0.0, 20.0, 2.0),), material(viscosity=1e11)), 2e4,
              mirrored=True),
    HardScene('viscosity_jump', 'half of a block a million times stiffer than the other',
              scene(None, (), material(viscosity=100.0, arrhenius=MILLION)), 200.0,
              lava=block(50.0, 50.0, 3.0, temperature=_halves), thickness=3.0, mirrored=True,
              mirrored_until=20.0),
    HardScene('viscosity_jump_inertia', 'the same with inertia',
              scene(None, (), material(viscosity=100.0, arrhenius=MILLION)), 30.0, 'inertia',
              lava=block(50.0, 50.0, 3.0, temperature=_halves), thickness=3.0, mirrored=True),
    HardScene('viscosity_mixed', 'neighbours that differ a million times, anywhere',
              scene(plane(0.1), (), material(viscosity=100.0, arrhenius=MILLION)), 20.0,
              lava=block(50.0, 50.0, 3.0, temperature=_mixed), thickness=3.0),
    HardScene('viscosity_mixed_lateral', 'the same with lateral stress',
              scene(plane(0.1), (), material(viscosity=100.0, arrhenius=MILLION)), 0.3, 'lateral',
              lava=block(30.0, 30.0, 10.0, temperature=_mixed), thickness=10.0),
    HardScene('viscosity_two_vents', 'a hot and a cold vent in one place',
              scene(plane(0.05), (vent(0.0, 10.0, 3.0), vent(0.0, 10.0, 3.0, temperature=COLD)),
                    material(viscosity=100.0, arrhenius=MILLION)), 200.0, mirrored=True),
    HardScene('viscosity_without_end',
              'lava as stiff as the law allows, beyond the range of float32',
              scene(plane(0.3), (), material(viscosity=1e15, arrhenius=1.0)), 1e3,
              lava=block(40.0, 40.0, 20.0, temperature=701.0), thickness=20.0, mirrored=True),
)

THICKNESS = (
    HardScene('film_1_mm', 'a film of a millimetre down a slope',
              scene(plane(0.1), (), material(viscosity=1.0)), 2e4,
              lava=block(60.0, 60.0, 0.001, centre=(0.0, 30.0)), thickness=0.001, mirrored=True),
    HardScene('film_1_mm_inertia', 'the same with inertia',
              scene(plane(0.1), (), material(viscosity=1.0)), 500.0, 'inertia',
              lava=block(60.0, 60.0, 0.001, centre=(0.0, 30.0)), thickness=0.001, mirrored=True),
    HardScene('thick_200_m', 'a block of 200 m on cells of 5 m',
              scene(None, (), material(viscosity=1e8)), 60.0, lava=block(60.0, 60.0, 200.0),
              thickness=200.0, mirrored=True),
    HardScene('thick_200_m_fluid', 'the same, fluid: it levels out at kilometres in a second',
              scene(None, (), material(viscosity=100.0)), 1e-4, lava=block(60.0, 60.0, 200.0),
              thickness=200.0, mirrored=True),
    HardScene('thick_200_m_lateral', 'the same block, held by lateral stress',
              scene(None, (), material(viscosity=1e8)), 0.4, 'lateral',
              lava=block(20.0, 20.0, 200.0), thickness=200.0, mirrored=True),
    HardScene('pond_lateral',
              'a hollow filled fifty times as deep as was expected, lateral stress',
              scene(_hollow, (), material(viscosity=1e6)), 45.0, 'lateral', frames=60,
              lava=block(120.0, 120.0, 50.0), thickness=1.0, mirrored=True),
    HardScene('dam_wall', 'a dam of 50 m breaks', scene(None, (), material(viscosity=1e5)), 5.0,
              lava=block(60.0, 50.0, 50.0, centre=(0.0, 40.0)), thickness=50.0, mirrored=True,
              mirrored_until=2.5),
    HardScene('dam_wall_inertia', 'a dam of 50 m breaks, with inertia',
              scene(None, (), material(viscosity=1e3)), 5.0, 'inertia',
              lava=block(60.0, 50.0, 50.0, centre=(0.0, 40.0)), thickness=50.0, mirrored=True),
    HardScene('dam_onto_film', 'a dam of 50 m breaks onto a film of a millimetre',
              scene(None, (), material(viscosity=1e5)), 5.0,
              lava=both(block(60.0, 40.0, 50.0, centre=(0.0, 30.0)),
                        block(60.0, 60.0, 0.001, centre=(0.0, -30.0))), thickness=50.0,
              mirrored=True, mirrored_until=1.0),
    HardScene('column_200_m', 'a column as wide as a cell, 200 m high',
              scene(None, (), material(viscosity=1e9)), 2e4, lava=block(5.0, 5.0, 200.0),
              thickness=50.0, mirrored=True, longest_step=2e4),
)

#: A basalt that solidifies, with a crust and conduction into the ground.
BASALT = Lava.paper(
    density=2600.0, viscosity=1000.0, arrhenius=0.04, solidus=1223.0, latent_heat=3.5e5,
    conductivity=1.5, ground_conductivity=2.0, crust=True,
)


def _pit(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return y - 1000.0 * ((np.abs(x) < CELL) & (np.abs(y) < CELL))


HEAT = (
    HardScene('freezes_at_vent', 'lava that is all but solid when it comes out',
              scene(plane(0.1), (vent(0.0, 40.0, 0.5, temperature=1223.5),), BASALT), 3600.0,
              'freezing', mirrored=True),
    HardScene('freezes_as_it_spreads', 'a thin layer that freezes from its rim',
              scene(None, (), BASALT), 3e4, 'freezing',
              lava=block(50.0, 50.0, 0.3, temperature=1300.0), thickness=0.3, mirrored=True),
    HardScene('freezes_at_border', 'lava that freezes at the border and in the corner',
              scene(plane(0.1, towards=(0.7, 0.7)), (), BASALT), 2e4, 'freezing',
              lava=block(30.0, 30.0, 0.3, centre=(60.0, 60.0), temperature=1240.0), thickness=0.3),
    HardScene('freezes_in_noise', 'lava that may freeze on noise of 5 m, and not at its vent',
              scene(lambda x, y: 5.0 * np.random.default_rng(5).normal(size=x.shape),
                    (vent(0.0, 0.0, 1.0, temperature=1250.0),), BASALT), 3600.0, 'freezing',
              solidified=0.1),
    HardScene('reheated', 'hot lava onto cold, then cold onto hot',
              scene(None, (), replace(BASALT, solidus=0.0, latent_heat=0.0, crust=False)), 300.0,
              lava=both(block(60.0, 60.0, 1.0, temperature=900.0),
                        lambda spacing: block(60.0, 60.0, 1.0)(0.83 * spacing)), thickness=1.0),
    HardScene('as_cold_as_the_air', 'lava that has the temperature of the air',
              scene(plane(0.2), (), Lava.paper(viscosity=1.0, arrhenius=0.004),
                    ambient_temperature=600.0), 1000.0,
              lava=block(40.0, 40.0, 1.0, temperature=600.0), thickness=1.0, mirrored=True,
              mirrored_until=100.0),
    HardScene('chilled_at_once', 'heat transfer so strong that a step takes all of it',
              scene(plane(0.1), (vent(0.0, 30.0, 2.0),),
                    Lava.paper(viscosity=100.0, arrhenius=0.002, convection=1e5),
                    ambient_temperature=100.0), 200.0, mirrored=True),
    HardScene('heated_by_fall',
              'lava that its fall over a cliff of 1000 m warms, and nothing cools',
              scene(caldera, (vent(0.0, 40.0, 20.0),), material(viscosity=1.0)), 20.0, 'heating',
              mirrored=True, mirrored_until=6.0),
    HardScene('heated_by_fall_inertia',
              'the same with inertia: into the foot of the cliff at speed',
              scene(caldera, (vent(0.0, 40.0, 20.0),), material(viscosity=1.0)), 40.0,
              'heating_inertia', mirrored=True),
    HardScene('heated_in_pit_inertia', 'the same into a pit, whose far wall it runs against',
              scene(_pit, (vent(0.0, 50.0),), material(viscosity=1.0)), 40.0, 'heating_inertia'),
    HardScene('held_by_strength', 'a yield strength that holds everything where it is',
              scene(plane(0.3), (), material(viscosity=1.0, yield_strength=1e6)), 1e4, 'strong',
              lava=block(40.0, 40.0, 2.0), thickness=2.0, mirrored=True, still=True),
    HardScene('held_at_vent', 'lava that cannot leave its vent until it is piled up',
              scene(plane(0.1), (vent(0.0, 0.0, 2.0),),
                    material(viscosity=10.0, yield_strength=3e4)), 100.0, 'strong', mirrored=True),
    HardScene('strength_from_cliff', 'strong lava over a cliff of 100 m',
              scene(lambda x, y: np.where(y > 0.0, 100.0 + 0.3 * y, 0.0), (vent(0.0, 40.0, 20.0),),
                    material(viscosity=10.0, yield_strength=3e3)), 20.0, 'strong', mirrored=True,
              mirrored_until=12.0),
)

SLOPE = 0.2

#: Half the radius of 1000 m3 of that lava after 100 s, 31 m (Huppert 1982) [m].
HALFWAY = 15.0


def _in_one_place(count: int, volume: float):
    return lambda spacing: Particles(np.zeros((count, 2)), volume, 1423.0)


def _pairs(spacing: float) -> Particles:
    """Return a block, each of its particles twice."""
    lava = block(40.0, 40.0, 1.0)(spacing)
    return Particles(np.repeat(lava.position, 2, axis=0), np.repeat(lava.volume, 2), 1423.0)


def _in_a_row(spacing: float) -> Particles:
    """Return particles along a line: the slope across it is undefined."""
    x = np.linspace(-40.0, 40.0, 41)
    return Particles(np.stack([x, np.zeros_like(x)], axis=1), spacing * spacing, 1423.0)


def _far_apart(spacing: float) -> Particles:
    """Return volumes from a millionth of the usual one to a hundred times it."""
    lava = block(50.0, 50.0, 1.0)(spacing)
    exponents = np.random.default_rng(2).uniform(-6.0, 2.0, len(lava.volume))
    return Particles(lava.position, lava.volume * 10.0**exponents, 1423.0)


def _hole() -> Terrain:
    ground = terrain().elevation.copy()
    ground[12:20, 12:20] = np.nan
    return Terrain(ground, 5.0, (-80.0, -80.0))


def _around_the_hole(spacing: float) -> Particles:
    lava = block(90.0, 90.0, 3.0)(spacing)
    outside = np.abs(lava.position).max(axis=1) > 20.5
    return Particles(lava.position[outside], lava.volume[outside], 1423.0)


BORDERS = {
    'west': (-1.0, 0.0), 'east': (1.0, 0.0), 'south': (0.0, -1.0), 'north': (0.0, 1.0),
    'corner': (0.7071, 0.7071),
}

PARTICLES = (
    HardScene('coincident', 'a hundred particles in exactly one place', scene(), 100.0,
              lava=_in_one_place(100, 10.0), thickness=1.0, reaches=HALFWAY),
    HardScene('coincident_inertia', 'the same with inertia', scene(), 20.0, 'inertia',
              lava=_in_one_place(100, 10.0), thickness=1.0),
    HardScene('coincident_lateral', 'the same with lateral stress', scene(), 0.2, 'lateral',
              lava=_in_one_place(100, 10.0), thickness=1.0),
    HardScene('piled_up_lateral',
              'a pile fifty times as thick as was expected, with lateral stress', scene(), 10.0,
              'lateral', lava=block(10.0, 10.0, 50.0), thickness=1.0,
              dry=lambda places: np.hypot(*places.T) > 60.0, mirrored=True, mirrored_until=0.4),
    HardScene('piled_higher_lateral',
              'a pile a thousand times as thick as was expected, with lateral stress',
              scene(None, (), material(viscosity=1e8)), 3e5, 'lateral',
              lava=block(30.0, 30.0, 100.0), thickness=0.1, mirrored=True, mirrored_until=3e4,
              most_steps={'fine': 90}, longest_step=1e5),
    HardScene('coincident_pairs', 'every particle twice in its place', scene(), 100.0, lava=_pairs,
              thickness=1.0),
    HardScene('one_particle', 'one particle on a slope', scene(plane(0.1)), 1000.0,
              lava=_in_one_place(1, 25.0), thickness=1.0, halved=False),
    HardScene('no_particles', 'no lava at all', scene(), 1e5, halved=False, mirrored=True),
    HardScene('no_discharge', 'vents that give nothing',
              scene(None, (vent(0.0, 0.0, 0.0), vent(0.0, 9.0, ((0.0, 0.0), (10.0, 0.0))))), 1e4,
              halved=False, mirrored=True),
    HardScene('in_a_row', 'particles along a line', scene(), 100.0, lava=_in_a_row, thickness=1.0),
    HardScene('volumes_far_apart',
              'particles of a millionth and of a hundred times the usual volume',
              scene(plane(0.05)), 10.0, lava=_far_apart, thickness=1.0),
    HardScene('two_by_two_cells', 'the smallest terrain there is',
              Scene(Terrain(np.zeros((2, 2)), 40.0, (-40.0, -40.0)), (vent(),), material()), 500.0,
              mirrored=True),
    *(
        HardScene(f'leaving_{name}', f'lava runs over the border: {name}',
                  scene(plane(SLOPE, towards=direction)), 60.0,
                  lava=block(40.0, 40.0, 1.0, centre=(55.0 * direction[0], 55.0 * direction[1])),
                  thickness=1.0, halved=False)
        for name, direction in BORDERS.items()
    ),
    HardScene('leaving_everywhere', 'a layer over the whole map runs off at each border',
              scene(None, (), material(viscosity=100.0)), 5.0, lava=block(160.0, 160.0, 5.0),
              thickness=5.0, mirrored=True, mirrored_until=0.2),
    HardScene('leaving_into_a_hole', 'lava around cells without data runs in',
              Scene(_hole(), (), material()), 60.0, lava=_around_the_hole, thickness=3.0,
              mirrored=True, mirrored_until=15.0),
    HardScene('leaving_inertia', 'lava shoots over the border',
              scene(plane(SLOPE), (), material(viscosity=10.0)), 15.0, 'inertia',
              lava=block(40.0, 40.0, 1.0, centre=(0.0, -40.0)), thickness=1.0, halved=False),
)

#: On and off, for one second each.
FLICKER = tuple((float(second), 10.0 if second % 2 == 0 else 0.0) for second in range(40))

VENTS = (
    HardScene('vent_on_ridge', 'a vent on a knife ridge: half goes either way',
              scene(lambda x, y: -2.0 * np.abs(x), (vent(),)), 60.0, mirrored=True),
    HardScene('fissure_on_ridge', 'a fissure along a knife ridge',
              scene(lambda x, y: -2.0 * np.abs(x), (vent(0.0, -30.0, 20.0, end=(0.0, 30.0)),)),
              60.0, mirrored=True),
    HardScene('vent_in_pit', 'a vent in a pit of two cells, 30 m deep',
              scene(lambda x, y: np.where((np.abs(x) < CELL) & (np.abs(y) < CELL), -30.0, 0.0),
                    (vent(),)), 40.0, mirrored=True),
    HardScene('vent_at_border', 'a vent half off the map', scene(plane(0.05), (vent(0.0, 79.9),)),
              200.0, mirrored=True),
    HardScene('vent_in_corner', 'a vent on the last corner, lava runs off the map',
              scene(plane(0.1, towards=(0.7, 0.7)), (vent(79.99, 79.99),)), 100.0, halved=False),
    HardScene('vents_over_each_other', 'twelve vents in one place',
              scene(None, (vent(0.0, 0.0, 1.0),) * 12), 100.0, mirrored=True, distinct=True),
    HardScene('vent_1e-3', 'a litre a second',
              scene(plane(0.05), (vent(0.0, 20.0, 1e-3, radius=0.5),)), 2e4, mirrored=True),
    HardScene('vent_1e5', 'a hundred thousand cubic metres a second',
              scene(plane(0.05), (vent(0.0, 20.0, 1e5),)), 0.3, mirrored=True),
    HardScene('vent_1e5_inertia', 'the same with inertia',
              scene(plane(0.05), (vent(0.0, 20.0, 1e5),)), 0.5, 'inertia', mirrored=True),
    HardScene('vent_1e5_narrow', 'the same out of a hole of 10 cm, stiff',
              scene(None, (vent(0.0, 0.0, 1e5, radius=0.1),), material(viscosity=1e7)), 1.0,
              mirrored=True),
    HardScene('vent_flickers', 'a vent that is on each other second',
              scene(plane(0.05), (vent(0.0, 30.0, FLICKER),)), 40.0, mirrored=True),
    HardScene('vents_strong_and_weak', '1e-3 and 1e3 m3/s next to each other',
              scene(plane(0.05), (vent(0.0, 40.0, 1e-3), vent(0.0, 0.0, 1e3))), 10.0,
              mirrored=True),
    HardScene('fissure_from_border_to_border', 'a fissure across the whole map',
              scene(plane(0.05), (vent(-79.9, 40.0, 50.0, end=(79.9, 40.0)),)), 100.0,
              mirrored=True),
    HardScene(
        'vents_everywhere', 'a vent in every third cell',
        scene(None, tuple(vent(x, y, 0.05) for x in np.arange(-67.5, 75.0, 15.0)
                          for y in np.arange(-67.5, 75.0, 15.0))),
        600.0, mirrored=True,
    ),
)
