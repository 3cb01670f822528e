# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure what a kernel radius that grows, or shifted particles, gain at equal computing time.

    python docs/benchmarks/kernel_radius.py > docs/benchmarks/kernel_radius.csv

A constant flux onto a plane for 3,000 s (Huppert 1982), on cells of 4 m. Each row is the mean of
three runs, whose vents are shifted by a third of a cell, and the least CPU time of the three.

* fixed: the kernel radius is 3.5 spacings, as in the presets.
* growing: 3.5 spacings at a refinement of 1, and in proportion to the square root of the
  refinement, so that the number of neighbours grows as particles come closer.
* shifted: the fixed radius. After each part of the run, particles move against the gradient of
  their concentration, the sum over the neighbours of V W / h (Lind et al. 2012), by at most a
  tenth of the radius. They move along circles around the vent only, which no shift that does not
  know the solution could do without moving the flow.

Errors are the mean of |h - exact| over the mean thickness: of the thickness at the particles, and
of the map, both between a quarter and four fifths of the radius of the flow; and of the whole map.
The noise is the root mean square of the velocity along the circles over that of the velocity
outwards, between the same radii.
"""

import csv
from dataclasses import replace
import math
import sys
import time

import numpy as np
from scipy.spatial import cKDTree

from lava_ros.scene import Scene, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases.case import FLAT, GRAVITY, ISOTHERMAL, NU, plane
from lava_ros.verification.measure import machine_name

DISCHARGE, END, CELL = 1.0, 3000.0, 4.0

#: Parts of a run, after each of which particles are shifted.
PARTS = 200

FLOW = exact.ConstantFluxSpread(DISCHARGE, NU, GRAVITY)
RADIUS = FLOW.radius(END)

#: Kernel radius over spacing by rule and refinement.
RULES = {
    'fixed': lambda refinement: 3.5,
    'growing': lambda refinement: 3.5 * math.sqrt(refinement),
    'shifted': lambda refinement: 3.5,
}


def shift(simulation: Simulation, vent: np.ndarray) -> None:
    """Move the particles towards an even distribution, at the same distances from the vent."""
    radius = simulation.accuracy.radius
    simulation.solver.evaluate()
    share = simulation.sample().volume / simulation.sample().thickness
    rows = simulation.solver.state.read_particles()
    place = rows[:, :2] - vent
    one, other = cKDTree(place).query_pairs(radius, output_type='ndarray').T
    apart = place[one] - place[other]
    distance = np.hypot(*apart.T) + 1e-9
    # derivative of Wendland's C2 kernel over the distance
    slope = -140.0 / (math.pi * radius**4) * (1.0 - distance / radius) ** 3
    gradient = np.zeros_like(place)
    np.add.at(gradient, one, (slope * share[other])[:, None] * apart)
    np.add.at(gradient, other, -(slope * share[one])[:, None] * apart)
    out = np.hypot(*place.T)
    along = np.column_stack([-place[:, 1], place[:, 0]]) / out[:, None]
    way = -0.1 * radius**2 * (gradient * along).sum(axis=1)
    angle = np.arctan2(*place.T[::-1]) + np.clip(way, -0.1 * radius, 0.1 * radius) / out
    rows[:, :2] = vent + out[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    simulation.solver.state.write_particles(rows)


def measure(rule: str, refinement: float, ratio: float, vent: np.ndarray) -> dict[str, float]:
    """Return the errors and the CPU time of a run."""
    accuracy = replace(
        preset_accuracy('standard'), ratio=ratio, spacing=RADIUS / 8.0 / refinement,
        thickness=float(FLOW.thickness(np.array([0.5 * RADIUS]), END)[0]),
    )
    half = CELL * math.ceil(1.2 * RADIUS / CELL)
    lava = replace(ISOTHERMAL, reference_temperature=1400.0)
    vents = (Vent(tuple(vent), DISCHARGE, radius=2.0, temperature=1400.0),)
    scene = Scene(plane((-half, -half, half, half), CELL), vents, lava, gravity=GRAVITY)
    simulation = Simulation(scene, accuracy=accuracy, device='cpu', effects=FLAT, horizon=END)
    simulation.advance(1e-3)
    begun = time.process_time()
    for part in range(1, PARTS + 1):
        simulation.advance(END * part / PARTS)
        if rule == 'shifted':
            shift(simulation, vent)
    spent = time.process_time() - begun
    simulation.solver.evaluate()
    found = simulation.sample()
    place = found.position - vent
    out = np.hypot(*place.T)
    inner = (out > 0.25 * RADIUS) & (out < 0.8 * RADIUS)
    outwards = (found.velocity * place).sum(axis=1)[inner] / out[inner]
    speed = (found.velocity[inner] ** 2).sum(axis=1)
    right = FLOW.thickness(out[inner], END)
    map_error, whole_error = map_errors(simulation, vent)
    return {
        'particles': len(out),
        'cpu_s': spent,
        'particle_error': float(np.abs(found.thickness[inner] - right).sum() / right.sum()),
        'map_error': map_error,
        'whole_error': whole_error,
        'noise': math.sqrt((speed - outwards**2).sum() / (outwards**2).sum()),
    }


def map_errors(simulation: Simulation, vent: np.ndarray) -> tuple[float, float]:
    """Return the error of the map between two radii, and of the whole map."""
    terrain = simulation.scene.terrain
    rows, columns = terrain.shape
    x = terrain.origin[0] + (np.arange(columns) + 0.5) * CELL - vent[0]
    y = terrain.origin[1] + (np.arange(rows) + 0.5) * CELL - vent[1]
    # the mean over a cell from 8 x 8 places
    parts = (np.arange(8) - 3.5) / 8.0 * CELL
    fine_x, fine_y = (x[:, None] + parts).ravel(), (y[:, None] + parts).ravel()
    fine = FLOW.thickness(np.hypot(fine_x, fine_y[:, None]).ravel(), END)
    right = fine.reshape(rows, 8, columns, 8).mean(axis=(1, 3))
    apart = np.abs(np.nan_to_num(simulation.snapshot().thickness) - right)
    out = np.hypot(x, y[:, None])
    inner = (out > 0.25 * RADIUS) & (out < 0.8 * RADIUS)
    return float(apart[inner].sum() / right[inner].sum()), float(apart.sum() / right.sum())


def main() -> None:
    """Write the rows."""
    writer = None
    for rule, ratio_at in RULES.items():
        for refinement in (1.0, 1.414, 2.0, 2.83, 4.0):
            ratio = ratio_at(refinement)
            vents = [np.full(2, CELL * third / 3.0) for third in range(3)]
            runs = [measure(rule, refinement, ratio, vent) for vent in vents]
            row = {'rule': rule, 'refinement': refinement, 'ratio': round(ratio, 2)}
            for name in runs[0]:
                join = np.min if name == 'cpu_s' else np.mean
                row[name] = f'{join([run[name] for run in runs]):.4g}'
            row |= {'machine': machine_name('cpu'), 'repetitions': 3}
            if writer is None:
                writer = csv.DictWriter(sys.stdout, list(row), lineterminator='\n')
                writer.writeheader()
            writer.writerow(row)
            sys.stdout.flush()


if __name__ == '__main__':
    main()
