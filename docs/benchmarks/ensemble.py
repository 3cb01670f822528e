# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the quality of an ensemble's probabilities in twin experiments on an artificial slope.

Truths are drawn like members, with another seed, so that a correct ensemble is reliable. The
output is ensemble.csv and ensemble.png, the reliability diagram:

    python docs/benchmarks/ensemble.py 'machine'
"""

import csv
from pathlib import Path
import sys
import time

import matplotlib
import numpy as np

from lava_ros.files import file_to_write
from lava_ros.forecast.assimilation import jaccard, Outline, weigh
from lava_ros.forecast.members import make_plan, run_members
from lava_ros.forecast.probability import EnsembleAccumulator, footprint_by, footprint_of
from lava_ros.forecast.sampling import draw_members
from lava_ros.forecast.scores import (
    brier_parts,
    brier_score,
    reliability,
    reliability_error,
)
from lava_ros.scene import Lava, Scene, Terrain, Vent
from lava_ros.scene.uncertainty import uncertainty_from_dict
from lava_ros.simulation.presets import preset_accuracy

matplotlib.use('Agg')

HORIZON, SEEN_AT = 2.0 * 3600.0, 2400.0

MEMBERS, TRUTHS = 256, 32

#: Sizes of the ensembles that are compared with all members.
SIZES = (8, 16, 32, 64)

FOLDER = Path(__file__).parent


def scene() -> Scene:
    """Return a slope with gentle valleys and a flow with uncertain quantities."""
    y, x = np.mgrid[0:60, 0:60] * 20.0
    ground = Terrain(1500.0 - 0.15 * y + 20.0 * np.sin(x / 150.0), 20.0)
    return Scene(
        ground,
        (Vent((600.0, 240.0), 20.0, radius=30.0),),
        Lava.paper(viscosity=1e4),
        uncertainty=uncertainty_from_dict({
            'discharge': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'temperature': {'distribution': 'normal', 'mean': 0.0, 'deviation': 15.0},
            'viscosity': {'distribution': 'lognormal', 'median': 1.0, 'factor': 1.5},
            'position': {'deviation': 40.0},
            'terrain': {'deviation': 2.0, 'correlation': 60.0},
        }),
    )


def probability(plan, footprints, weights=None):
    """Return the probability of a set of members, 0 to 1."""
    tally = EnsembleAccumulator(plan)
    for place, footprint in enumerate(footprints):
        tally.add(footprint, 1 if weights is None else int(weights[place]))
    return tally.maps().probability.astype(np.float64) / 100.0


def measure():
    """Return quantities with members and units, and the bins of the diagram."""
    plan = make_plan(scene(), horizon=HORIZON, accuracy=preset_accuracy('draft'))
    begin = time.perf_counter()
    members = [
        footprint_of(fields, plan)
        for fields in run_members(plan, draw_members(plan.scene, MEMBERS), device='cpu')
    ]
    pace = MEMBERS / (time.perf_counter() - begin)
    truths = [
        footprint_of(fields, plan)
        for fields in run_members(plan, draw_members(plan.scene, TRUTHS, seed=1), device='cpu')
    ]
    rows = [('members one after the other', MEMBERS, pace, '1/s')]

    whole = probability(plan, members)
    spread = np.sqrt((whole * (1.0 - whole)).mean())
    for size in SIZES:
        parts = [members[start : start + size] for start in range(0, MEMBERS, size)]
        error = np.sqrt(np.mean([(probability(plan, part) - whole) ** 2 for part in parts]))
        rows.append(('error of the probability, rms', size, 100.0 * error, '%'))
        rows.append(('binomial error, rms', size, 100.0 * spread / np.sqrt(size), '%'))

    observed = np.stack([footprint_by(truth, plan, HORIZON) for truth in truths])
    before = np.broadcast_to(whole, observed.shape)
    after = np.empty(observed.shape)
    effective = []
    for place, truth in enumerate(truths):
        cells = footprint_by(truth, plan, SEEN_AT)
        outline = Outline(SEEN_AT, cells, np.ones_like(cells))
        agreement = [jaccard(footprint_by(item, plan, SEEN_AT), outline) for item in members]
        weights = weigh(agreement)
        effective.append(weights.effective_members)
        after[place] = probability(plan, members, weights.values)
    # cells that any member or truth has inundated
    near = (whole > 0.0) | observed.any(axis=0)
    for name, forecast in (('', before), (', outline seen at a third of the time', after)):
        parts = brier_parts(forecast[:, near], observed[:, near])
        rows += [
            (f'Brier score{name}', MEMBERS, parts.score, '1'),
            (f'Brier skill{name}', MEMBERS, parts.skill, '1'),
        ]
        error = reliability_error(forecast[:, near], observed[:, near])
        rows.append((f'reliability error, rms{name}', MEMBERS, 100.0 * error, '%'))
    better = np.mean([
        brier_score(after[place], observed[place]) < brier_score(before[place], observed[place])
        for place in range(TRUTHS)
    ])
    rows.append(('truths forecast better with an outline', MEMBERS, 100.0 * better, '%'))
    rows.append(('effective members with an outline', MEMBERS, np.mean(effective), '1'))
    diagrams = [reliability(item[:, near], observed[:, near]) for item in (before, after)]
    return rows, diagrams


def draw(diagrams, path):
    """Draw the reliability diagram."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(4.6, 4.2), layout='constrained')
    axes.plot([0, 100], [0, 100], color='0.7', linewidth=1)
    for bins, label, marker in zip(
        diagrams, ('equal weights', 'weighted by an outline'), 'os', strict=True
    ):
        axes.plot(
            [100 * item.forecast for item in bins], [100 * item.observed for item in bins],
            marker=marker, label=label,
        )
    axes.set_xlabel('forecast probability [%]')
    axes.set_ylabel('observed frequency [%]')
    axes.legend(frameon=False)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure, write the table, and draw the diagram."""
    machine = sys.argv[1]
    table, picture = FOLDER / 'ensemble.csv', FOLDER / 'ensemble.png'
    for path in (table, picture):
        file_to_write('output', path)
    rows, diagrams = measure()
    with table.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(['quantity', 'members', 'value', 'unit', 'machine', 'command'])
        for quantity, members, value, unit in rows:
            command = f'python docs/benchmarks/ensemble.py {machine!r}'
            writer.writerow([quantity, members, f'{value:.4g}', unit, machine, command])
            print(f'{quantity:60} {members:4} {value:9.4g} {unit}')
    draw(diagrams, picture)


if __name__ == '__main__':
    main()
