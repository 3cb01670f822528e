# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Score paths of steepest descent over the mapped area of eruptions with one outline.

python docs/benchmarks/references.py OUT.csv --case DIR [--case DIR ...]

Cases with several outlines have this reference in the table of ``outlines.py``.
"""

import argparse
from pathlib import Path

from eruptions import version

from lava_ros.hindcast.case import load_case
from lava_ros.hindcast.score import count_visits, jaccard, most_visited
from lava_ros.verification.rows import write_csv


def main() -> None:
    """Write a row for each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--case', action='append', required=True, metavar='DIR')
    args = parser.parse_args()
    rows = []
    for folder in args.case:
        case = load_case(folder)
        visits = count_visits(case.scene.terrain.elevation, case.vent_cells)
        covered = most_visited(visits, int(case.footprint.sum()))
        rows.append({
            'case': case.name, 'descent': jaccard(covered, case.footprint), 'version': version(),
            'command': 'python docs/benchmarks/references.py',
        })
    write_csv(rows, args.output)


if __name__ == '__main__':
    main()
