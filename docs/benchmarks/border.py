# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A kernel radius that shrinks at the border of the flow: what it would change.

It is a prototype in numpy, apart from the solver: explicit steps, float64, the local balance.
The radius of a particle is l (1 - (1 - least) min(1, q / 0.2)), q the length of
sum V W (x_i - x_j) over l h: 0 inside, about 0.2 where lava ends in a cliff. The kernel of a pair
is the mean of both radii's, so that what one gives the other gets. It makes border.csv:

    python docs/benchmarks/border.py 'machine' > docs/benchmarks/border.csv
"""

import csv
import math
import sys
import time

import numpy as np
from scipy.spatial import cKDTree

from lava_ros.verification import exact
from lava_ros.verification.cases.case import GRAVITY, NU

#: g / (3 nu): speed is this times h^2 times slope.
ALPHA = GRAVITY / (3.0 * NU)

#: Wendland C2: norm and the stiffest wave's rate, as in simulation/kernels.py.
NORM, STIFFNESS = 7.0 / math.pi, 10.18

#: Offset q at which the radius has its least value, and the diffusion and Courant numbers.
OFFSET, DIFFUSION, COURANT = 0.2, 1.6, 0.25

#: (ratio of kernel radius to spacing, least radius over it).
SETTINGS = ((3.5, 1.0), (3.5, 0.8), (3.5, 0.7), (3.5, 0.6), (3.5, 0.5), (2.5, 1.0))


def kernel(r, radius):
    """W and its derivative over r."""
    q = np.minimum(r / radius, 1.0)
    return (
        NORM / radius**2 * (1.0 - q) ** 4 * (1.0 + 4.0 * q),
        -20.0 * NORM / radius**4 * (1.0 - q) ** 3,
    )


def flow(place, volume, radius, least, box):
    """Thickness, velocity and the reciprocal of the longest step."""
    first, second = cKDTree(place, boxsize=box).query_pairs(radius, output_type='ndarray').T
    gap = place[first] - place[second]
    if box is not None:
        gap -= np.round(gap / box) * box
    r = np.hypot(*gap.T)
    count = len(place)

    def pair_sum(values, sign=1.0):
        given = np.bincount(first, volume[second] * values, count)
        return given + sign * np.bincount(second, volume[first] * values, count)

    shape, slope = kernel(r, radius)
    thickness = pair_sum(shape) + volume * NORM / radius**2
    own = np.full(count, radius)
    if least < 1.0:
        offset = np.hypot(*(pair_sum(shape * part, -1.0) for part in gap.T))
        share = np.minimum(offset / (radius * thickness) / OFFSET, 1.0)
        own = radius * (1.0 - (1.0 - least) * share)
        both = [kernel(r, own[which]) for which in (first, second)]
        shape, slope = (0.5 * (a + b) for a, b in zip(*both, strict=True))
        thickness = pair_sum(shape) + volume * NORM / own**2
    rise = np.column_stack([pair_sum(slope * part, -1.0) for part in gap.T])
    velocity = -ALPHA * thickness[:, None] ** 2 * rise
    decay = STIFFNESS * ALPHA * thickness**3 / (DIFFUSION * own**2)
    speed = np.hypot(*velocity.T) / (COURANT * own)
    return thickness, velocity, max(decay.max(), speed.max())


def advance(place, volume, radius, least, until, box=None):
    """Let lava flow; returns places, thickness and the number of steps."""
    now, steps = 0.0, 0
    while now < until:
        _, velocity, rate = flow(place, volume, radius, least, box)
        step = min(1.0 / rate, until - now)
        place = place + step * velocity
        if box is not None:
            place %= box
        now += step
        steps += 1
    return place, flow(place, volume, radius, least, box)[0], steps


def fixed_volume(ratio, least, count=2000):
    """Errors of a fixed volume that spreads by 1.3 (Huppert 1982), in %."""
    total, first_radius = 1e5, 100.0
    solution = exact.FixedVolumeSpread(total, NU, GRAVITY)
    start = solution.time_of_radius(first_radius)
    end = start * 1.3**8
    radius = solution.radius(end)
    spacing = radius * math.sqrt(math.pi / count)
    place, thickness, steps = advance(
        solution.particles(count, start),
        np.full(count, total / count),
        ratio * spacing,
        least,
        end - start,
    )
    r = np.hypot(*place.T)
    exact_r = np.hypot(*solution.particles(100 * count, end).T)
    centre = 0.53113 * (3.0 * NU * total / (GRAVITY * end)) ** 0.25
    error = np.abs(thickness - centre * np.maximum(1.0 - (r / radius) ** 2, 0.0) ** (1.0 / 3.0))
    mean = total / (math.pi * radius**2)

    def edge(values):
        return np.sort(values)[-len(values) // 50 :].mean()

    yield 'fixed_volume', 'rms radius', rms(r) / rms(exact_r) - 1.0, steps
    yield 'fixed_volume', 'mean radius of the outer 2 %', edge(r) / edge(exact_r) - 1.0, steps
    yield 'fixed_volume', 'profile', error.mean() / mean, steps
    yield 'fixed_volume', 'profile beyond 0.85 R', error[r > 0.85 * radius].mean() / mean, steps


def rms(values):
    """Root of the mean square."""
    return math.sqrt((values**2).mean())


def dam_break(ratio, least, rows=40):
    """Error of the outermost row of a dam break (Cordonnier et al. 2015), in %."""
    height, length, front = 2.0, 30.0, 8.0
    spacing = length / rows
    across = max(12, int(2.0 * ratio) + 2)
    width = across * spacing
    index = np.arange(rows * across)
    x = (index + 0.5) / len(index) * length
    y = np.modf(index * 0.5 * (math.sqrt(5.0) - 1.0))[0] * width
    # a symmetric block of twice the length, ends far apart round the periodic box
    place = np.column_stack([np.r_[x, -x] + 4.0 * length, np.r_[y, y]])
    end = (front / (0.28430 * height)) ** 2 * NU / (GRAVITY * height)
    place, _, steps = advance(
        place,
        np.full(len(place), height * spacing**2),
        ratio * spacing,
        least,
        end,
        np.array([8.0 * length, width]),
    )
    last = np.sort(place[:, 0])[-across:].mean() - 5.0 * length
    yield 'dam_break', 'mean place of the outermost row', last / front - 1.0, steps


def main():
    """Print the table."""
    machine = sys.argv[1]
    table = csv.writer(sys.stdout, lineterminator='\n')
    names = 'case,quantity,ratio,least_radius,value,unit,steps,wall_s,machine,command'
    table.writerow(names.split(','))
    for case in (fixed_volume, dam_break):
        for ratio, least in SETTINGS:
            begin = time.perf_counter()
            rows = list(case(ratio, least))
            wall = f'{time.perf_counter() - begin:.2f}'
            for name, quantity, error, steps in rows:
                value = f'{100.0 * error:.3f}'
                row = [name, quantity, ratio, least, value, '%', steps, wall, machine]
                table.writerow([*row, f"python docs/benchmarks/border.py '{machine}'"])


if __name__ == '__main__':
    main()
