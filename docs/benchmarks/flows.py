# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Score sets of constants on all mapped flows.

python docs/benchmarks/flows.py OUT.csv --case DIR [--case DIR ...] [--set NAME ...] [--device D]
    [--from-outline TIME] [--vents FILE] [--spacing METRES] [--mobility-limit SPEED] [--machine M]

Each row is a set on a flow, or on one of the dated outlines of a flow: runs at `draft`, and two
references without a model of lava (``lava_ros/hindcast/score.py``). Sets are the materials of
``lava materials``, the best set of lapalma_h200.csv on 24 September 2021, and that of all flows.
"""

import argparse
from dataclasses import replace
from pathlib import Path
import platform
import time
from typing import Any

from eruptions import fitted, version
from table_text import lines_of

from lava_ros.hindcast.case import Case, load_case
from lava_ros.hindcast.free_parameters import changed
from lava_ros.hindcast.outlines import Outline
from lava_ros.hindcast.replicates import directions, run_together
from lava_ros.hindcast.run import Settings
from lava_ros.hindcast.score import jaccard, refer, score_outlines
from lava_ros.scene.materials import materials
from lava_ros.simulation.setup.defaults import device_of
from lava_ros.verification.rows import write_csv

#: Constants of ``etna_basalt`` that replace its own, by the name of the set. That of all flows is
#: the best of calibration_flows_h200.csv, rounded.
FITTED: dict[str, dict[str, float]] = {
    'fitted to 24 September': fitted(),
    'fitted to all flows': {
        'viscosity': 3.2e5, 'yield_strength': 30.0, 'crust_cover': 0.923,
        'crust_cover_decay': 0.097, 'crust_temperature': 733.0, 'crust_strength': 1.1e5,
    },
}


def outlined(case: Case) -> Case:
    """Return a case whose only outline has a date, too."""
    if case.outlines:
        return case
    return replace(case, outlines=(Outline(case.duration, '', case.footprint),))


def _persistence_of_start(case: Case, text: str) -> float | str:
    """Return the score of the outline of the start at a later one; empty without one."""
    if case.initial is None:
        return ''
    later = next(item for item in case.outlines if item.text == text)
    return jaccard(case.initial, later.footprint)


def scored(name: str, folder: str, settings: Settings, args: argparse.Namespace) -> Any:
    """Run a set on a case, and yield its rows."""
    values = FITTED.get(name, {})
    case = outlined(load_case(
        folder, material='etna_basalt' if values else name, vents=args.vents,
        from_outline=args.from_outline,
    ))
    case, begun, busy = changed(case, values), time.monotonic(), time.process_time()
    results = run_together([(case, way) for way in directions(args.runs)], settings)
    seconds, cpu = time.monotonic() - begun, time.process_time() - busy
    scores = score_outlines(case, [result.snapshot for result in results])
    references = refer(case, {score.outline: score.footprint_area_error for score in scores})
    for score in scores:
        reference = references[score.outline]
        yield {
            'constants': name, 'case': case.name, 'from_outline': args.from_outline or '',
            'vents': Path(args.vents).stem if args.vents else '', 'outline': score.outline,
            'preset': settings.preset, 'spacing_m': results[0].resolution.spacing,
            'mobility_limit_m_per_s': results[0].accuracy.mobility_limit or '', 'runs': args.runs,
            'jaccard': score.jaccard, 'footprint_ratio': 1.0 + score.footprint_area_error,
            'length_ratio': 1.0 + score.length_error,
            'persistence': '' if reference.persistence is None else reference.persistence,
            'persistence_of_start': _persistence_of_start(case, score.outline),
            'descent': reference.descent, 'seconds': seconds,
            'cpu_s': cpu if settings.device == 'cpu' else '',
            'effects': ' '.join(results[0].effects),
            'values': ' '.join(f'{key}={value:.6g}' for key, value in values.items()),
            'device': results[0].device, 'machine': args.machine, 'version': version(),
            'command': 'python docs/benchmarks/flows.py',
        }


def _key(row: dict[str, Any]) -> tuple[Any, ...]:
    names = 'constants', 'case', 'from_outline', 'vents'
    return tuple(str(row[name]) for name in names)


def main() -> None:
    """Run the sets on the cases, and write the rows so far after each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('output', metavar='OUT.csv', type=Path)
    parser.add_argument('--case', action='append', required=True, metavar='DIR')
    names = [*materials(), *FITTED]
    parser.add_argument('--set', action='append', choices=names, dest='sets')
    parser.add_argument('--runs', type=int, default=1)
    parser.add_argument('--from-outline', metavar='TIME')
    parser.add_argument('--vents', metavar='FILE')
    parser.add_argument('--spacing', type=float)
    parser.add_argument('--mobility-limit', type=float)
    parser.add_argument('--device')
    parser.add_argument('--machine', default=platform.processor() or platform.machine())
    args = parser.parse_args()
    settings = Settings(
        'draft', args.spacing, str(device_of(args.device)), maps=1,
        mobility_limit=args.mobility_limit,
    )
    rows: list[dict[str, Any]] = lines_of(args.output.resolve()) if args.output.exists() else []
    for name in args.sets or names:
        for folder in args.case:
            own = list(scored(name, folder, settings, args))
            is_new = {_key(row) for row in own}
            rows = [row for row in rows if _key(row) not in is_new] + own
            write_csv(rows, args.output)
            for row in own:
                print(f'{name}, {row["case"]} {row["outline"][:10]}: {row["jaccard"]:.3f}, area '
                      f'x{row["footprint_ratio"]:.2f}, {row["seconds"]:.0f} s', flush=True)


if __name__ == '__main__':
    main()
