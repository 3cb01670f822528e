# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare the inundated areas of scenes with the two forms of the lateral stress.

The sum (`green`) and the solve (`helmholtz`) are two forms of one effect. Each named scene of
bench_scenes.py is run with its expected effects and with neither or either form. A row has the
Jaccard index of the inundated areas of two of the three, each from many runs, or of both halves of
the runs of one of them, which is the random part. The output is choice_lateral.csv:

    python docs/benchmarks/lateral.py strong --refinement 1 2 --runs 8 > choice_lateral.csv
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from itertools import combinations, product
import sys

from bench_scenes import scenes
from choice import footprint, jaccard, noise, run_copies

from lava_ros.simulation.presets import DEFAULT, preset_accuracy
from lava_ros.simulation.resolution import resolved_accuracy
from lava_ros.simulation.selection import effects_for
from lava_ros.verification.measure import machine_name

FORMS = ('neither', 'green', 'helmholtz')


def main() -> None:
    """Run the named scenes and print the rows."""
    items = {item.name: item for item in scenes()}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('scene', nargs='+', choices=items)
    parser.add_argument('--preset', default=DEFAULT)
    parser.add_argument('--refinement', type=float, nargs='+', default=[1.0],
                        help='how much finer than the preset')
    parser.add_argument('--runs', type=int, default=24)
    parser.add_argument('--device', default='cpu')
    chosen = parser.parse_args()
    preset = preset_accuracy(chosen.preset)
    table = csv.writer(sys.stdout, lineterminator='\n')
    table.writerow(['scene', 'preset', 'refinement', 'runs', 'h_over_l', 'one', 'other', 'jaccard',
                    'device', 'machine'])
    for name, finer in product(chosen.scene, chosen.refinement):
        item = items[name]
        accuracy = replace(preset, refinement=preset.refinement * finer)
        accuracy = resolved_accuracy(accuracy, item.scene, horizon=item.horizon)
        arguments = {'accuracy': accuracy, 'horizon': item.horizon}
        effects = effects_for(item.scene, **arguments)
        runs = {}
        for form in FORMS:
            only = {other: other == form for other in FORMS[1:]}
            runs[form] = run_copies(
                item.scene,
                chosen.runs,
                replace(effects, **only),
                device=chosen.device,
                duration=item.duration,
                **arguments,
            ).cells
        ratio = accuracy.thickness / (accuracy.ratio * accuracy.spacing)
        case = [name, chosen.preset, f'{finer:g}', chosen.runs, f'{ratio:.3g}']
        machine = [chosen.device, machine_name(chosen.device)]
        for form, cells in runs.items():
            table.writerow([*case, form, form, f'{noise(cells):.4f}', *machine])
        for one, other in combinations(FORMS, 2):
            index = jaccard(footprint(runs[one]), footprint(runs[other]))
            table.writerow([*case, one, other, f'{index:.4f}', *machine])
        sys.stdout.flush()


if __name__ == '__main__':
    main()
