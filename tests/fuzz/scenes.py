# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Strategies for valid scenes that are small, quick and otherwise arbitrary."""

from dataclasses import dataclass, replace
import math
from typing import Any

from hypothesis import assume
from hypothesis import strategies as st
import numpy as np

from hard.cells import without_missing
from lava_ros.effects import EFFECTS, Effects
from lava_ros.scene import MAX_VENT_VISCOSITY, Scene, Terrain, Vent
from lava_ros.scene.lava import Lava
from lava_ros.simulation.accuracy import Accuracy, expected_thickness
from lava_ros.simulation.carriers import METHODS
from lava_ros.simulation.cells.cell_size import MAX_CELLS
from lava_ros.simulation.presets import preset_accuracy

#: Effects that are compiled for every test run.
COMMON = (
    Effects(),
    Effects(yielding=True, power_law=True),
    Effects(inertia=True),
    Effects(crystals=True, crust=True, cooling=False, latent_heat=True, solidification=True),
)

#: Effects that are compatible with all others.
FREE = (
    *('yielding', 'power_law', 'crystals', 'steep', 'ground'),
    *('viscous_heating', 'latent_heat', 'conduction', 'solidification', 'merging'),
)

#: Maximum number of particles that vents emit.
MAX_PARTICLES = 300


@dataclass(frozen=True)
class Trial:
    """A scene with its physics and resolution, simulated until a time [s].

    At half of that time ``vents`` replace the vents, at two thirds ``terrain`` replaces the
    terrain; None keeps them.
    """

    scene: Scene
    effects: Effects
    accuracy: Accuracy
    until: float
    vents: tuple[Vent, ...] | None
    terrain: Terrain | None


def powers(low: float, high: float) -> st.SearchStrategy[float]:
    """Return numbers between limits whose logarithm is uniform."""
    return st.floats(math.log10(low), math.log10(high)).map(lambda power: float(10.0**power))


@st.composite
def terrains(draw: Any, largest: int = 64) -> Terrain:
    """Draw ground of any shape, some of it without data."""
    rows, columns = draw(st.integers(2, largest)), draw(st.integers(2, largest))
    resolution = draw(powers(0.5, 50.0))
    y, x = np.mgrid[0:rows, 0:columns] / max(rows, columns)
    chance = np.random.default_rng(draw(st.integers(0, 2**16)))
    slope = draw(st.sampled_from((0.0, 0.01, 0.1, 0.5, 2.0)))
    angle = draw(st.floats(0.0, 6.3))
    size = resolution * max(rows, columns)
    ground = slope * size * (x * math.cos(angle) + y * math.sin(angle))
    kinds = ('plane', 'noise', 'cliff', 'pit', 'spike', 'ridge', 'canyon', 'terraces', 'cone')
    kind = draw(st.sampled_from(kinds))
    height = size * draw(st.sampled_from((0.01, 0.1, 0.5, 3.0)))
    row, column = draw(st.integers(0, rows - 1)), draw(st.integers(0, columns - 1))
    if kind == 'noise':
        ground = ground + 0.1 * height * chance.standard_normal((rows, columns))
    elif kind == 'cliff':
        ground = ground + height * (x > x[0, column])
    elif kind in ('pit', 'spike'):
        ground[row, column] += height if kind == 'spike' else -height
    elif kind in ('ridge', 'canyon'):
        ground[:, column] += height if kind == 'ridge' else -height
    elif kind == 'terraces':
        ground = height * np.floor(5.0 * ground / (height + 1e-9)) / 5.0
    elif kind == 'cone':
        ground = ground - height * np.hypot(x - x[0, column], y - y[row, 0])
    missing = draw(st.sampled_from((0.0, 0.0, 0.0, 0.1, 0.4)))
    if missing:
        ground[chance.random((rows, columns)) < missing] = math.nan
        ground[row, column] = 0.0
    origin = draw(st.sampled_from(((0.0, 0.0), (-300.0, 40.0), (499_000.0, 4_180_000.0))))
    return Terrain(ground, resolution, origin)


@st.composite
def materials(draw: Any) -> Lava:
    """Draw lava from water to rhyolite, with any of the laws."""
    choices: dict[str, tuple[Any, ...]] = {
        'arrhenius': (0.0, 8e-3, 0.04),
        'emissivity': (0.0, 0.9, 1.0),
        'convection': (0.0, 50.0, 300.0),
        'yield_strength': (0.0, 0.0, 100.0, 1e4, 1e7),
        'yield_rate': (0.0, 0.01, 0.05),
        'flow_index': (1.0, 1.0, 0.5, 2.0),
        'conductivity': (0.0, 1.5),
        'ground_conductivity': (0.0, 2.0),
        'crust': (False, True),
    }
    values: dict[str, Any] = {
        'viscosity': draw(powers(1.0, 1e9)),
        'density': draw(st.floats(1000.0, 3500.0)),
        'specific_heat': draw(st.floats(600.0, 1600.0)),
        'liquidus': draw(st.floats(1350.0, 1550.0)),
    }
    if draw(st.booleans()):
        values['solidus'] = draw(st.floats(800.0, 1200.0))
        choices['crystals'] = (0.0, 0.3, 0.9)
        choices['crystal_law'] = ('none', 'einstein-roscoe', 'maron-pierce')
        choices['latent_heat'] = (0.0, 3.5e5)
    values |= {name: draw(st.sampled_from(words)) for name, words in choices.items()}
    values['crust'] &= values['conductivity'] > 0.0
    if not values['crust']:
        values['crust_cover'] = draw(st.sampled_from((0.0, 0.5, 1.0)))
        values['crust_cover_decay'] = draw(st.sampled_from((0.0, 0.16)))
    return Lava.paper(**values)


@st.composite
def vents_on(draw: Any, terrain: Terrain, lava: Lava, limit: int = 3) -> tuple[Vent, ...]:
    """Draw vents anywhere on the ground, next to each other and on its border too."""
    known = np.argwhere(terrain.has_data)
    corner = np.array(terrain.extent[:2])
    inside = st.sampled_from((0.5, 0.5, 0.0, 0.001, 0.25, 0.999))

    def place() -> tuple[float, float]:
        cell = known[draw(st.integers(0, len(known) - 1))][::-1]
        position = corner + terrain.resolution * np.add(cell, [draw(inside), draw(inside)])
        if not terrain.covers(*position):
            position = corner + terrain.resolution * (cell + 0.5)
        return float(position[0]), float(position[1])

    vents = []
    for _ in range(draw(st.integers(0, limit))):
        discharge: Any = draw(powers(1e-2, 1e3))
        if draw(st.integers(0, 3)) == 0:
            discharge = [(0.0, discharge), (1.0, 0.0), (5.0, 2.0 * discharge), (1e3, 0.0)]
        temperature = draw(st.floats(max(lava.solidus + 1.0, 900.0), 1600.0))
        # lava jammed with crystals does not flow out of a vent
        assume(lava.viscosity_at(temperature) <= MAX_VENT_VISCOSITY)
        vents.append(
            Vent(
                place(), discharge, temperature=temperature,
                radius=draw(powers(0.1, 3.0)) * terrain.resolution,
                end=place() if draw(st.integers(0, 3)) == 0 else None,
                velocity=draw(st.sampled_from(((0.0, 0.0), (0.0, 0.0), (3.0, -1.0), (0.0, 40.0)))),
            )
        )
    return tuple(vents)


@st.composite
def extreme_scenes(draw: Any) -> tuple[Scene, Accuracy, float]:
    """Draw a scene of any size and rate, its method and resolution, and a horizon [s]."""
    side, cell = draw(st.sampled_from((2, 3, 40))), draw(powers(1e-3, 1e4))
    slope = draw(st.sampled_from((0.0, 1e-3, 0.1, 5.0)))
    z = np.clip(slope * cell * np.mgrid[0:side, 0:side][1], 0.0, 9e4)
    inside = st.floats(0.01, 0.99).map(lambda part: part * side * cell)

    def rates() -> Any:
        peak = draw(powers(1e-12, 1e7))
        return draw(st.sampled_from((peak, ((0.0, peak), (draw(powers(1e-3, 1e3)), 0.0)))))

    radii = powers(1e-2, 1e2).map(lambda cells: min(cells * cell, 1e5))
    vents = tuple(
        Vent((draw(inside), draw(inside)), rates(), radius=draw(radii))
        for _ in range(draw(st.sampled_from((1, 2, 20))))
    )
    lava = Lava.paper(
        viscosity=draw(powers(1e-3, 1e15)), density=draw(powers(10.0, 1e5)), arrhenius=0.0,
        yield_strength=draw(st.sampled_from((0.0, 1e3, 1e7))),
    )
    accuracy = preset_accuracy(draw(st.sampled_from(('draft', 'standard', 'fine'))))
    method, spacing = draw(st.sampled_from(METHODS)), draw(st.none() | powers(1e-5, 1e5))
    if method == 'cells' and spacing and 1e6 < (side * cell / spacing) ** 2 <= MAX_CELLS:
        # a grid that fits into the memory, but takes seconds and gigabytes
        spacing = None
    accuracy = replace(
        accuracy, method=method, spacing=spacing, thickness=draw(st.none() | powers(1e-6, 3e3))
    )
    scene = Scene(Terrain(z, cell), vents, lava, gravity=draw(powers(0.1, 30.0)))
    return scene, accuracy, draw(powers(1.0, 1e9))


@st.composite
def any_effects(draw: Any) -> Effects:
    """Draw effects that are compatible."""
    # at most one of each group
    one_of = (('none', 'arrhenius', 'arrhenius', 'vft'), ('none', 'green', 'helmholtz', 'inertia'),
              ('none', 'cooling', 'cover', 'crust'))
    on = {draw(st.sampled_from(names)) for names in one_of}
    on |= {name for name in FREE if draw(st.booleans())}
    return Effects(**{name: name in on for name in EFFECTS})


def _fitting(effects: Effects, lava: Lava) -> Lava:
    """Return the material with the constants that forced effects need."""
    changes: dict[str, Any] = {}
    if effects.vft and not lava.is_vft:
        changes['vft_b'] = 6000.0
    if effects.crust and not lava.conductivity:
        changes['conductivity'] = 1.5
    needs = effects.solidification or effects.crystals or effects.latent_heat
    if needs and not lava.solidus:
        changes['solidus'] = 1100.0
    if effects.crystals and lava.crystal_law == 'none':
        changes['crystal_law'] = 'einstein-roscoe'
    return replace(lava, **changes)


@st.composite
def trials(draw: Any, *, all_effects: bool) -> Trial:
    """Draw a scene, its physics, method, resolution and duration, and changes of the run."""
    effects = draw(any_effects() if all_effects else st.sampled_from(COMMON))
    terrain = draw(terrains())
    lava = _fitting(effects, draw(materials()))
    vents = draw(vents_on(terrain, lava))
    scene = Scene(
        terrain, vents, lava, ambient_temperature=draw(st.floats(200.0, 330.0)),
        gravity=draw(st.sampled_from((9.81, 9.81, 1.8, 3.7))),
    )
    accuracy = preset_accuracy(draw(st.sampled_from(('draft', 'standard'))))
    if all_effects and draw(st.integers(0, 3)) == 0:
        accuracy = preset_accuracy('reference')
    spacing, method = terrain.resolution / accuracy.refinement, draw(st.sampled_from(METHODS))
    accuracy = replace(accuracy, spacing=spacing, method=method)
    if method == 'cells':
        effects = without_missing(effects)
    flux = sum(max(q for _, q in vent.series) for vent in vents) or 1.0
    fraction = draw(st.just(0.0) | st.floats(0.01, 1.0))
    particle = spacing**2 * expected_thickness(scene)
    until = min(fraction * MAX_PARTICLES * particle / flux, 1e6)
    other = draw(st.none() | vents_on(terrain, lava))
    ground = None
    if draw(st.integers(0, 2)) == 0:
        chance = np.random.default_rng(draw(st.integers(0, 2**16)))
        change = terrain.resolution * draw(st.sampled_from((0.01, 1.0)))
        moved = terrain.elevation + change * chance.standard_normal(terrain.shape)
        ground = replace(terrain, elevation=moved)
    return Trial(scene, effects, accuracy, until, other, ground)
