# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Cases that run the solver where an exact solution is known."""

from lava_ros.effects import EFFECTS
from lava_ros.verification.cases import confined, cooling, heat, inertia, rheology, sheets, slopes
from lava_ros.verification.cases.case import Case, Measurement, Run
from lava_ros.verification.cases.spreading import CASES as SPREADING
from lava_ros.verification.cases.spreading import spread_of_fixed_volume

__all__ = [
    'CASES', 'EFFECT_CASES', 'TITLES', 'Case', 'Measurement', 'Run', 'spread_of_fixed_volume',
]

#: Cases of effects other than flow and spreading, which have a separate chart.
EFFECT_CASES = frozenset(
    case.name for case in (*heat.CASES, *cooling.CASES, *rheology.CASES, *inertia.CASES)
)

#: Every case whose effects exist, by its name, from the simplest.
CASES: dict[str, Case] = {
    case.name: case
    for cases in (
        sheets.CASES, heat.CASES, cooling.CASES, rheology.CASES, confined.CASES, SPREADING,
        slopes.CASES, inertia.CASES,
    )
    for case in cases
    if EFFECTS.keys() >= set(case.effects)
}

#: The titles of the cases by name, as headings.
TITLES = {name: f'{case.title[0].upper()}{case.title[1:]}' for name, case in CASES.items()}
