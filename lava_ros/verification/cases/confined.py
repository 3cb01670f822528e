# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava between walls: lateral stress in a channel, and rest in a rough bowl."""

from dataclasses import replace
import math
from typing import Any

import numpy as np

from lava_ros.effects.laws import LATERAL_DRAG
from lava_ros.scene import Scene, Terrain
from lava_ros.simulation import Particles
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases import case
from lava_ros.verification.cases.case import FLAT, GRAVITY, ISOTHERMAL, NU

#: Widths of the channel over the thickness, and particles across half of it, for helmholtz.
WIDTHS = {1.0: 10, 2.5: 15, 5.0: 15}

#: Slope of the channel's floor.
SLOPE = 0.01

#: Length of the channel, and of its middle where the velocity is read, over the thickness.
LENGTH, MIDDLE = 12.0, 2.0

#: Side of the terrain and of its cells [m].
SIDE, CELL = 100.0, 2.0

#: Times of measuring the pond [s]: an hour after filling, and after a further hour of rest. Films
#: that run off the shores slow down in proportion to 1 / t, whatever their viscosity.
HOUR, REST = 3600.0, 30.0 * 3600.0


def channel_velocity(
    width: float, *, effect: str, accuracy: Accuracy, device: str = 'cpu'
) -> tuple[case.Trial, case.Measurement]:
    """Return mean over local velocity in a channel of lava 1 m thick, by green or helmholtz.

    The channel lies between mirror images with the opposite slope. The flow is odd about the
    walls, so it vanishes there, as on a wall without slip. ``width`` [m] must be an even multiple
    of the spacing in ``accuracy``, so that no particle is on a wall.
    """
    spacing = accuracy.spacing
    assert spacing is not None
    across, cell = 4.0 * width, min(0.1, 0.5 * spacing)
    rows, columns = round(1.4 * across / cell), round(1.4 * LENGTH / cell)
    y, x = ((np.arange(count) + 0.5 - 0.5 * count) * cell for count in (rows, columns))
    sign = np.where(np.floor(y / width + 0.5) % 2 == 0, 1.0, -1.0)
    terrain = Terrain(
        -SLOPE * np.outer(sign, x), cell, origin=(-0.5 * columns * cell, -0.5 * rows * cell)
    )
    ticks = [
        (np.arange(round(side / spacing)) + 0.5) * spacing - 0.5 * side
        for side in (LENGTH, across)
    ]
    trial = case.Trial(
        Scene(terrain, lava=ISOTHERMAL), accuracy, device, effects=replace(FLAT, **{effect: True}),
        particles=Particles(case.places(*ticks), spacing**2, 1400.0), thickness=1.0,
    )
    sample = trial.sample()
    inside = (np.abs(sample.position) < (0.5 * MIDDLE, 0.5 * width)).all(axis=1)
    local = exact.sheet_velocity(1.0, math.asin(SLOPE), NU, GRAVITY)
    mean = float(sample.velocity[inside, 0].mean())
    expected = exact.channel_mean_velocity(width, 1.0)
    return trial, case.Measurement(f'{effect} W/h {width:g}', mean / local, expected, '1')


def _run_channel(accuracy: Accuracy, device: str) -> case.Run:
    """Compare the solve in three channels, and the Green's function in a wide one.

    The model's own limit is the parabolic profile: full Stokes flow has means of 0.1715, 0.5152,
    0.7481 and 0.7896 at W/h 1, 2.5, 5 and 6 where its equation has 0.1668, 0.5131, 0.7472 and
    0.7889, which is 2.8, 0.4, 0.1 and 0.1 % less.
    """

    def run(width: float, effect: str, across_half: float, **knobs: Any) -> case.Run:
        spacing = 0.5 * width / max(2, round(across_half))
        if effect == 'green':
            # the kernel radius is fixed, so a finer spacing has more neighbours
            knobs['ratio'] = 6.25 / math.sqrt(LATERAL_DRAG) / spacing
        finer = replace(accuracy, spacing=spacing, **knobs)
        trial, found = channel_velocity(width, effect=effect, accuracy=finer, device=device)
        return trial.run(found)

    finer = accuracy.refinement
    runs = [run(width, 'helmholtz', count * finer) for width, count in WIDTHS.items()]
    # up to a limit, because differences would smooth the jump of the slope at a wall over the
    # kernel
    return case.joined([*runs, run(6.0, 'green', 9 * min(1.0, finer), gradient='energy')])


def rough_bowl() -> Terrain:
    """Return a paraboloid with bumps of a few decimetres: 16 waves of 6 cm.

    Wavelengths [m], directions and phases of the waves cover their ranges evenly, in an irregular
    order: multiples of irrational numbers, modulo 1.
    """
    count = round(SIDE / CELL)
    ticks = (np.arange(count) + 0.5 - 0.5 * count) * CELL
    x, y = np.meshgrid(ticks, ticks)
    elevation = 0.003 * (x**2 + y**2)
    shortest, longest = 14.0, 40.0
    for index in range(1, 17):
        length, turn, phase = np.modf(index * np.sqrt([2.0, 3.0, 5.0]))[0]
        q = 2.0 * math.pi / (shortest * (longest / shortest) ** length)
        angle = 2.0 * math.pi * turn
        place = x * math.cos(angle) + y * math.sin(angle)
        elevation += 0.06 * np.sin(q * place + 2.0 * math.pi * phase)
    return Terrain(elevation, CELL, origin=(-0.5 * SIDE, -0.5 * SIDE))


def ground_at(terrain: Terrain, position: np.ndarray) -> np.ndarray:
    """Return the elevation [m] of the quadratic B-spline whose gradient drives the lava.

    ``position`` [m], shape [count, 2], must be at least two cells away from the terrain's border.
    """
    place = (position - np.asarray(terrain.origin)) / terrain.resolution
    cell = np.floor(place).astype(int)
    t = place - cell - 0.5
    weights = np.stack([0.5 * (0.5 - t) ** 2, 0.75 - t**2, 0.5 * (0.5 + t) ** 2])
    total = np.zeros(len(position))
    for i, j in np.ndindex(3, 3):
        values = terrain.elevation[cell[:, 1] + i - 1, cell[:, 0] + j - 1]
        total += weights[i, :, 1] * weights[j, :, 0] * values
    return total


def pond(accuracy: Accuracy, device: str = 'cpu') -> case.Trial:
    """Return lava filled into the rough bowl up to 3 m; this sets spacing and thickness."""
    terrain = rough_bowl()
    spacing = 2.0 / accuracy.refinement
    # not on the grid of the terrain's cells
    ticks = np.arange(-0.4 * SIDE, 0.4 * SIDE, spacing) + 0.15 * CELL
    position = case.places(ticks, ticks)
    depth = 3.0 - ground_at(terrain, position)
    wet = depth > 0.05
    return case.Trial(
        Scene(terrain, lava=ISOTHERMAL), accuracy, device,
        particles=Particles(position[wet], depth[wet] * spacing**2, 1400.0),
        spacing=spacing, thickness=float(depth[wet].mean()),
    )


def stillness(
    trial: case.Trial, when: str = ''
) -> tuple[case.Measurement, case.Measurement]:
    """Return speed of the fastest particle and scatter of the surface of a pond.

    The speed is relative to the speed of a fall from the surface to the bottom; the scatter of the
    surface, where the pond is deeper than 1 m, is relative to the largest depth. ``when`` is
    appended to the names of the quantities.
    """
    sample = trial.sample()
    deep, depth = sample.thickness > 1.0, float(sample.thickness.max())
    surface = sample.thickness + ground_at(trial.simulation.scene.terrain, sample.position)
    fastest, fall = float(np.hypot(*sample.velocity.T).max()), math.sqrt(2.0 * GRAVITY * depth)
    return (
        case.Measurement(f'speed{when}', fastest, 0.0, 'm/s', scale=fall),
        case.Measurement(f'flatness{when}', float(surface[deep].std()), 0.0, 'm', scale=depth),
    )


def _run_pond(accuracy: Accuracy, device: str) -> case.Run:
    # only stability limits the steps of a pond at rest
    trial = pond(replace(accuracy, longest_step=HOUR), device)
    trial.advance(HOUR)
    filled = stillness(trial, ' after an hour')
    trial.advance(REST)
    before, _ = stillness(trial, ' at rest')
    trial.advance(REST + HOUR)
    after, flatness = stillness(trial, ' at rest')
    return trial.run(*filled, max(before, after, key=lambda item: item.measured), flatness)


CASES = (
    case.Case('channel', 'lateral stress in a channel with walls', 'Boussinesq 1868',
              _run_channel, ('green', 'helmholtz')),
    case.Case('pond', 'pond in a rough bowl', 'hydrostatics', _run_pond),
)
