# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Flows whose authors state their kind, and the kind that follows from their numbers.

python docs/benchmarks/described_flows.py

Prints a line for each row of described_flows.csv.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lava_ros.scene import Scene, Terrain
from lava_ros.scene.materials import material_named
from lava_ros.simulation.flow_kind import crust_time, FlowKind

#: Density of all flows [kg/m3].
DENSITY = 2600.0

#: Scene with the material and the air of all flows.
SCENE = Scene(Terrain(np.zeros((4, 4), dtype=np.float32), 10.0), (), material_named('basalt').lava)


@dataclass(frozen=True)
class Described:
    """A flow as its authors describe it.

    Attributes:
        name: The flow.
        kind: Its kind as the authors state it.
        source: The publication.
        found: Kind by the numbers of the publication, or typical ones where it has none.
        compared: Numbers that were compared with the publication.
        missed_because: Reason why the numbers miss the kind; empty if they do not.
    """

    name: str
    kind: str
    source: str
    found: FlowKind
    compared: str
    missed_because: str


def described_flows() -> list[Described]:
    """Return all described flows."""
    path = Path(__file__).with_suffix('.csv')
    with path.open(newline='', encoding='utf-8') as file:
        return [_described(row) for row in csv.DictReader(file)]


def _described(row: dict[str, str]) -> Described:
    thickness, viscosity = float(row['thickness_m']), float(row['viscosity_pa_s'])
    found = FlowKind(
        discharge=float(row['effusion_rate_m3_per_s']),
        slope=float(row['slope']),
        thickness=thickness,
        width=float(row['width_m']),
        diameter=float(row['diameter_m']),
        viscosity=viscosity,
        reynolds=DENSITY * float(row['speed_m_per_s']) * thickness / viscosity,
        crust_time=crust_time(SCENE, float(row['temperature_k'])),
        weight=DENSITY * float(row['gravity_m_per_s2']),
        strength=float(row['yield_strength_pa']),
    )
    return Described(
        row['name'], row['kind'], row['source'], found, row['compared_with_source'],
        row['missed_because'],
    )


if __name__ == '__main__':
    for flow in described_flows():
        print(f'{flow.name}: {flow.kind}; {flow.found.text()}')
