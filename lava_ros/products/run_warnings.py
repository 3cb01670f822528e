# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Warnings about runs, for all their pages and JSON files, and the numerical error of runs."""

from collections.abc import Sequence
from dataclasses import replace
import math
import re
from typing import Any

from lava_ros.bag.decoding import Moment
from lava_ros.bag.description import unused_velocities
from lava_ros.forecast.members import Plan
from lava_ros.layers.numbers import percent
from lava_ros.layers.recording import Recording
from lava_ros.simulation.carriers import across_key, METHODS
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.resolution import Resolution, resolution_of
from lava_ros.simulation.selection import decide, warnings_of

# A word that is not a name of a file, a field or an option.
_WORD = re.compile(r'[a-z][a-z-]*[:,]?\s')


def warnings_of_recording(recording: Recording, run: Sequence[Moment]) -> list[str]:
    """Return warnings about a recording and a run in it, each a sentence."""
    bag, timeline = recording.bag, recording.timeline
    found = []
    if bag.recovered:
        found.append(
            'the recording was cut off, or still continues: data after its last complete message '
            'are missing'
        )
    found += [f'part of the bag is damaged or missing: {text}' for text in bag.damage]
    if len(timeline.last_run) < len(timeline.moments):
        found.append('the simulation was reset during the recording: this is the last run')
    return [*sentences(*found, recording.unfinished), *warnings_of_moments(run)]


def warnings_of_moments(run: Sequence[Moment]) -> list[str]:
    """Return warnings by the diagnostics of a run, each a sentence."""
    if not run:
        return []
    found: list[str] = []
    parsed = (VolumeBudget.from_texts(item.values) for item in run)
    budgets = [budget for budget in parsed if budget is not None]
    errors = [budget.error for budget in budgets if not budget.is_conserved]
    if errors:
        known = all(map(math.isfinite, errors))
        part = f'up to {percent(max(errors))}' if known else 'an unknown part'
        found.append(
            f'Volume was not conserved: {part} of it is unaccounted for. Do not trust these maps.'
        )
    elif budgets:
        found += sentences(*budgets[-1].warnings_at_end())
    last, method = run[-1], method_of(run[-1])
    numbers = 'spacing_m', 'flow_width_m', across_key(method)
    spacing, width, across = (last.number(name) for name in numbers)
    resolution = Resolution(
        spacing, math.nan, width, across, math.nan, 'measured', method=method
    )
    names = 'input_warnings', 'flow_kind_warnings', 'missed_effects'
    texts = (last.values.get(name, '') for name in names)
    return [*found, *_under_resolved(resolution), *sentences(*texts)]


def method_of(moment: Moment) -> str:
    """Return the carriers of the lava (``Accuracy.method``) by diagnostics."""
    method = moment.values.get('method', '')
    return method if method in METHODS else METHODS[0]


def warnings_of_plan(plan: Plan) -> list[str]:
    """Return warnings about the members of an ensemble, each a sentence."""
    accuracy = replace(plan.accuracy, threshold=plan.threshold)
    expected = resolution_of(plan.scene, accuracy, plan.forced, horizon=plan.horizon)
    kind = [] if expected.kind is None else expected.kind.warnings()
    decisions = decide(plan.scene, plan.forced, accuracy=accuracy, horizon=plan.horizon)
    table = {item.name: f'{"on" if item.is_on else "off"}: {item.reason}' for item in decisions}
    unused = unused_velocities(plan.scene.vents, table)
    return [*_under_resolved(expected), *sentences(*kind, *warnings_of(decisions), *unused)]


def sentences(*phrases: str) -> list[str]:
    """Return phrases as sentences; a first word that is a name, such as a file, is unchanged."""
    return [
        f'{text[0].upper() if _WORD.match(text) else text[0]}{text[1:]}.'
        for text in phrases if text
    ]


def _under_resolved(resolution: Resolution) -> list[str]:
    if not resolution.is_coarse:
        return []
    return [
        f'The flow is under-resolved: {resolution.across:.2g} {resolution.method} across about '
        f'{resolution.width:.2g} m. The inundated area would differ in a finer run.'
    ]


def error_of_moment(moment: Moment | None) -> dict[str, Any] | None:
    """Return the numerical error in the diagnostics of a run; None if it is not measured.

    The keys are the keys of ``NumericalError.as_dict`` that diagnostics contain.
    """
    if moment is None:
        return None
    inundated, standing, lava, ground, time = (
        None if math.isnan(value) else value
        for value in (
            moment.number(f'numerical_error_{name}')
            for name in ('inundated', 'standing', 'lava', 'ground', 'time_s')
        )
    )
    if inundated is None:
        return None
    return {
        'inundated': {'lava': lava, 'ground': ground, 'total': inundated},
        'standing': {'total': standing},
        'time_s': time,
    }
