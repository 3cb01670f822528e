# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Compare the influences that an ensemble states with runs that change one quantity.

The influences are regressions over the members of `examples/uncertain.yaml`. In the runs one
quantity of some members is at its 10 % and at its 90 % quantile, and the others are as drawn:

    python docs/benchmarks/influence.py influence.csv
"""

from dataclasses import fields, replace
import math
from pathlib import Path
import sys

import numpy as np

from lava_ros.forecast.influence import influences_of
from lava_ros.forecast.member_scenes import changes_of
from lava_ros.forecast.members import make_plan, MemberFields, run_members
from lava_ros.forecast.probability import footprint_of
from lava_ros.forecast.sampling import draw_members, Member
from lava_ros.scene import scene_from_yaml
from lava_ros.simulation.presets import preset_accuracy
from lava_ros.verification.rows import write_csv

SCENE, HORIZON = 'uncertain.yaml', 1800.0

#: Numbers of members of the ensembles, and number of members in which quantities are changed.
MEMBERS, CHANGED = (32, 64), 8


def changed(member: Member, change: Member) -> Member:
    """Return a member with the values in which ``change`` differs from a member without draws."""
    bare = Member(0)
    values = {
        item.name: getattr(change, item.name)
        for item in fields(Member)
        if item.compare and getattr(change, item.name) != getattr(bare, item.name)
    }
    values['constants'] = tuple({**dict(member.constants), **dict(change.constants)}.items())
    return replace(member, **values)


def area_of(found: MemberFields, shape: tuple[int, int]) -> np.ndarray:
    """Return the inundated parts of all cells, shape [rows, columns]."""
    whole = np.zeros(shape)
    row, column = found.corner
    rows, columns = found.inundated.shape
    whole[row : row + rows, column : column + columns] = found.inundated
    return whole


def main() -> None:
    """Write a row for each quantity and number of members."""
    plan = make_plan(
        scene_from_yaml(SCENE), horizon=HORIZON, accuracy=preset_accuracy('draft')
    )
    members = draw_members(plan.scene, max(MEMBERS))
    footprints = [footprint_of(item, plan) for item in run_members(plan, members, device='cpu')]
    direct: dict[str, tuple[float, float]] = {}
    for name, ends in changes_of(plan.scene).items():
        if name == 'terrain':
            continue
        pairs = [changed(member, end) for member in members[:CHANGED] for end in ends]
        runs = run_members(
            plan, [replace(item, index=number) for number, item in enumerate(pairs)], device='cpu'
        )
        areas = [area_of(item, plan.scene.terrain.shape) for item in runs]
        logs, mismatches = [], []
        for low, high in zip(areas[::2], areas[1::2], strict=True):
            logs.append(math.log(high.sum() / low.sum()))
            mismatches.append(1.0 - np.minimum(low, high).sum() / np.maximum(low, high).sum())
        direct[name] = math.exp(np.mean(logs)) - 1.0, float(np.mean(mismatches))
    rows = [
        {
            'members': count, 'quantity': row.quantity,
            'area': round(row.area, 3), 'area_error': round(row.area_error, 3),
            'area_of_runs': round(direct[row.quantity][0], 3),
            'mismatch': round(row.mismatch, 3), 'mismatch_error': round(row.mismatch_error, 3),
            'mismatch_of_runs': round(direct[row.quantity][1], 3),
        }
        for count in MEMBERS
        for row in influences_of(plan.scene, members, footprints[:count]).rows
    ]
    write_csv(rows, Path(sys.argv[1]))


if __name__ == '__main__':
    main()
