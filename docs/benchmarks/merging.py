# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Measure the particle-steps that merging of particles saves at equal error.

Each scene is run at several spacings, with and without merging. A particle-step is one particle in
one evaluation of the velocity. The logarithm of the error as a function of the logarithm of the
particle-steps is fitted by a straight line to the runs without merging. The gain of a run with
merging is the number of particle-steps on that line at its error, divided by its own number. The
output is merging.csv:

    python docs/benchmarks/merging.py huppert > docs/benchmarks/merging.csv

* huppert: a constant flux onto a plane for an hour (Huppert 1982). Errors: the mean of |h - exact|
  on the map over the mean thickness, and the root mean square of the front's error at seven times.
  Each value is the mean of three runs, with the vent shifted by a third of a spacing.
* etna: the first day of a hindcast case (docs/VALIDATION.md), its ground on cells of 20 m, against
  the run without merging at half of the smallest spacing. Errors: the mean of |h - reference| over
  the mean thickness, and one minus the Jaccard index of the standing lava.
"""

import argparse
import csv
from dataclasses import replace
import math
from pathlib import Path
import pickle
import sys

import numpy as np

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.coarse import coarsened, refined
from lava_ros.hindcast.run import FORCED, Settings
from lava_ros.scene import Scene, Vent
from lava_ros.simulation import Simulation
from lava_ros.simulation.accuracy import COVERED
from lava_ros.simulation.output.inundation import standing_cells
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.verification import exact
from lava_ros.verification.cases.case import FLAT, GRAVITY, ISOTHERMAL, NU, plane, Trial
from lava_ros.verification.cases.spreading import FRONT
from lava_ros.verification.measure import machine_name

#: Number of samples of the particle count in a run.
N_SAMPLES = 60

#: Cells of the elevation along a side of a cell of the ground, at all spacings.
COARSENESS = 2


def counted(simulation, until, samples=N_SAMPLES):
    """Advance to a time [s], and return the number of particle-steps."""
    total, start = 0.0, simulation.time
    before, evaluations = simulation.particle_count, simulation.snapshot().steps.evaluations
    for sample in range(1, samples + 1):
        simulation.advance(start + (until - start) * sample / samples)
        now = simulation.snapshot().steps.evaluations
        total += 0.5 * (before + simulation.particle_count) * (now - evaluations)
        before, evaluations = simulation.particle_count, now
    return total


def huppert(refinement, merging, device):
    """Return errors and particle-steps of a constant flux: means of three runs."""
    discharge, end = 10.0, 3600.0
    solution = exact.ConstantFluxSpread(discharge, NU, GRAVITY)
    half = 1.3 * solution.radius(end)
    window = (-half, -half, half, half)
    spacing = 2.8 / refinement
    runs = []
    for number in range(3):
        shift = number * spacing / 3.0
        trial = Trial(
            Scene(
                plane(window, 8.0),
                (Vent((shift, 0.5 * shift), discharge, radius=10.0),),
                ISOTHERMAL,
                gravity=GRAVITY,
            ),
            preset_accuracy('standard'),
            device,
            effects=replace(FLAT, merging=merging),
            spacing=spacing,
            thickness=1.15,
        )
        steps, fronts = 0.0, []
        for time in np.geomspace(0.25 * end, end, 7):
            steps += counted(trial.simulation, float(time), samples=12)
            radius = trial.field(window).mean_radius(FRONT, half)
            fronts.append(radius / solution.radius_of_thickness(FRONT, float(time)) - 1.0)
        field = trial.field(window)
        x, y = np.meshgrid(field.x - shift, field.y - 0.5 * shift)
        # outside the vent: the solution is for a point source
        r = np.hypot(x, y)
        outside = r > 30.0
        expected = solution.thickness(r, end)[outside]
        error = np.abs(field.thickness[outside] - expected).sum() / expected.sum()
        runs.append((error, math.sqrt(np.mean(np.square(fronts))), steps, trial))
    count = np.mean([run[3].simulation.particle_count for run in runs])
    profile, front, steps = np.mean([run[:3] for run in runs], axis=0)
    return {'profile': profile, 'front': front}, steps, count


def etna(case, spacing, merging, device, duration):
    """Return the map at the end [m], the particle-steps, and the number of particles."""
    settings = Settings(preset='draft', spacing=spacing)
    scene = case.scene
    simulation = Simulation(
        replace(scene, terrain=coarsened(scene.terrain, COARSENESS)),
        effects={**FORCED, 'merging': merging},
        accuracy=settings.accuracy(case),
        device=device,
        horizon=duration,
    )
    steps = counted(simulation, duration)
    snapshot = refined(simulation.snapshot(), scene.terrain, COARSENESS)
    return np.nan_to_num(snapshot.thickness), steps, simulation.particle_count


def apart(one, other):
    """Return the errors of a map relative to another."""
    here, there = standing_cells(one, COVERED), standing_cells(other, COVERED)
    either, both = here | there, here & there
    return {
        'thickness': float(np.abs(one - other)[either].sum() / other[either].sum()),
        'covered': float(1.0 - both.sum() / either.sum()),
    }


def rows_of(case, runs, device, options=''):
    """Yield CSV rows of runs: (spacing, merging, errors, particle-steps, particles)."""
    command = f'python docs/benchmarks/merging.py {case}{options} --device {device}'
    for quantity in runs[0][2]:
        plain = [(math.log(run[3]), math.log(run[2][quantity])) for run in runs if not run[1]]
        slope, offset = np.polyfit(*zip(*plain, strict=True), 1)
        for spacing, merging, errors, steps, count in runs:
            needed = math.exp((math.log(errors[quantity]) - offset) / slope)
            yield {
                'case': case,
                'quantity': quantity,
                'spacing_m': f'{spacing:.4g}',
                'merging': 'on' if merging else 'off',
                'error': f'{errors[quantity]:.5f}',
                'particle_steps': f'{steps:.5g}',
                'particles': f'{count:.0f}',
                'gain': f'{needed / steps:.3f}',
                'order': f'{-slope:.3f}',
                'device': device,
                'machine': machine_name(device),
                'command': command,
            }


def main():
    """Run a scene and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('scene', choices=('huppert', 'etna'))
    parser.add_argument('--case', type=Path, help='etna: folder of the case, or a pickled one')
    parser.add_argument('--device', default='cpu')
    parser.add_argument('--finest', type=float, help='etna: smallest spacing [m]')
    args = parser.parse_args()
    if args.scene == 'etna' and args.case is None:
        parser.error('etna needs --case')
    runs, options = [], ''
    if args.scene == 'huppert':
        for refinement in (0.35, 0.5, 0.7, 1.0):
            for merging in (False, True):
                errors, steps, count = huppert(refinement, merging, args.device)
                runs.append((2.8 / refinement, merging, errors, steps, count))
                print(runs[-1], file=sys.stderr, flush=True)
    else:
        if args.case.is_file():
            case = pickle.loads(args.case.read_bytes())
        else:
            case = load_case(args.case)
        finest = args.finest or 10.0
        options = f' --case {args.case.stem} --finest {finest:g}'
        expected, steps, count = etna(case, 0.5 * finest, False, args.device, 86400.0)
        print('reference', steps, count, file=sys.stderr, flush=True)
        for factor in (1.0, 1.25, 1.6, 2.0):
            for merging in (False, True):
                spacing = factor * finest
                thickness, steps, count = etna(case, spacing, merging, args.device, 86400.0)
                runs.append((spacing, merging, apart(thickness, expected), steps, count))
                print(runs[-1], file=sys.stderr, flush=True)
    rows = list(rows_of(args.scene, runs, args.device, options))
    writer = csv.DictWriter(sys.stdout, fieldnames=list(rows[0]))
    writer.writeheader()
    writer.writerows(rows)


if __name__ == '__main__':
    main()
