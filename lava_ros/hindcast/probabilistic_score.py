# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles of a case: inundation probability, and its score against the mapped flow fields."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from lava_ros.forecast.assimilation import Mask, Outline, outline_on
from lava_ros.forecast.member_scenes import median_scene
from lava_ros.forecast.members import make_plan, MAX_SAMPLES, Plan
from lava_ros.forecast.probability import Footprint, footprint_by, spacing_error_of
from lava_ros.forecast.scores import brier_parts, brier_score, reliability
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.run import outlined_part, Settings, simulated_scene
from lava_ros.scene.ranges import with_ranges

#: Minimum number of cells of a bin of the reliability diagram whose gap counts.
CELLS = 200


def plan_of(case: Case, settings: Settings, *, threshold: float | None = None) -> Plan:
    """Plan an ensemble of a case whose members run like its hindcast, to the same end.

    Each map is an observation; dated outlines need more observations; ``threshold`` is the
    thickness at or above which lava has arrived [m], None for the automatic one.

    Raises:
        LavaError: If an argument is not valid.
    """
    scene = with_ranges(case.scene)
    typical = replace(case, scene=median_scene(scene))
    factor = settings.coarseness(typical)
    plan = make_plan(
        simulated_scene(replace(case, scene=scene), factor),
        horizon=case.duration,
        accuracy=settings.accuracy(typical),
        effects=settings.effects,
        threshold=threshold,
        samples=max(settings.maps, MAX_SAMPLES) if case.outlines else settings.maps,
    )
    if case.initial is None:
        return plan
    # members count the outline as the maps of a run do (hindcast.run.shown_on)
    return replace(plan, covered=outlined_part(case, factor))


def mapped_on(case: Case, plan: Plan) -> np.ndarray:
    """Return the mapped flow field on the cells of a plan, bool, shape [rows, columns]."""
    return _on_plan(case.footprint, plan.horizon, case, plan).lava


def outlines_on(case: Case, plan: Plan) -> dict[str, Outline]:
    """Return the dated outlines of a case on the cells of a plan, by their dates."""
    return {
        item.text: _on_plan(item.footprint, item.time, case, plan) for item in case.outlines
    }


def start_on(case: Case, plan: Plan) -> np.ndarray | None:
    """Return the outline from which a case starts on the cells of a plan; None without one."""
    return None if case.initial is None else _on_plan(case.initial, plan.horizon, case, plan).lava


def _on_plan(footprint: np.ndarray, time: float, case: Case, plan: Plan) -> Outline:
    terrain = case.scene.ground_at(time)
    mask = Mask(footprint, terrain.has_data, terrain.resolution, terrain.origin)
    return outline_on(plan.ground_at(time), mask, time)


def probability_at(
    times: Sequence[float],
    members: Iterable[Footprint],
    plan: Plan,
    weights: Sequence[float] | np.ndarray | None = None,
) -> np.ndarray:
    """Return the probability of the footprint at each of some times [s] since the start.

    Times before the horizon are corrected for the error of the particle spacing.

    ``weights`` are those of the members, equal by default.

    Returns:
        Probabilities from 0 to 100 %, NaN without data, shape [times, rows, columns].
    """
    total, sums = 0.0, np.zeros((len(times), *plan.scene.terrain.shape))
    members = list(members)
    error = spacing_error_of(members, plan)
    for place, member in enumerate(members):
        weight = 1.0 if weights is None else float(weights[place])
        total += weight
        for time, cells in zip(times, sums, strict=True):
            cells += weight * footprint_by(member, plan, time, error)
    has_data = [plan.ground_at(time).has_data for time in times]
    return np.where(has_data, 100.0 * sums / total, np.nan)


def score_dates(
    probability: np.ndarray, outlines: Mapping[str, Outline], before: np.ndarray | None = None
) -> dict[str, Any]:
    """Score the probabilities at the time of each dated outline, and of all dates together.

    Args:
        probability: Probability at the time of each outline, 0 to 100 %, NaN without data, shape
            [outlines, rows, columns].
        outlines: The outlines by their dates.
        before: Observed lava that persists, bool, shape [rows, columns]; None: for each date the
            previous outline, and none for the first date.

    Returns:
        The numbers of ``score_probability`` for the cells of all dates, the Brier score of
        persistence over dates that have an outline before, the skill against it, and ``dates``:
        the same for each date, without the reliability diagram.
    """
    came = np.stack([item.lava for item in outlines.values()])
    last = [before, *(came[:-1] if before is None else [before] * (len(came) - 1))]
    dates = []
    for text, *fields in zip(outlines, probability, came, last, strict=True):
        found = {'date': text, **score_probability(*fields[:2]), **_against(*fields)}
        dates.append({key: found[key] for key in found if key != 'reliability'})
    first = int(last[0] is None)
    pooled = _against(probability[first:], came[first:], np.array(last[first:], dtype=bool))
    return {**score_probability(probability, came), **pooled, 'dates': dates}


def _against(
    probability: np.ndarray, came: np.ndarray, last: np.ndarray | None
) -> dict[str, float | None]:
    """Return the Brier score of the last outline and the skill against it, None without one."""
    if last is None or not last.size:
        return {'brier_persistence': None, 'brier_skill_persistence': None}
    # both are scored over the cells with lava in a member or in an outline
    near = np.isfinite(probability) & ((probability > 0.0) | came | last)
    score, reference = (
        brier_score(np.asarray(forecast, dtype=np.float64)[near], came[near])
        for forecast in (probability / 100.0, last)
    )
    skill = 1.0 - score / reference if reference else None
    return {'brier_persistence': reference, 'brier_skill_persistence': skill}


def score_probability(probability: np.ndarray, came: np.ndarray) -> dict[str, Any]:
    """Score a map of probability (0 to 100 %, NaN without data) against the inundated cells.

    Dry cells with a probability of 0 are easy to forecast, so the skill is given without them,
    and also for the whole terrain.

    Returns:
        Brier score, its skill against the base rate, this rate, the bins of the reliability
        diagram, and the largest gap in a bin of at least ``CELLS`` cells with lava in a member or
        on the map (None without such a bin).
    """
    forecast = np.asarray(probability, dtype=np.float64) / 100.0
    near = np.where((forecast > 0.0) | came, forecast, np.nan)
    # bins of all cells, because in ``near`` all cells with a probability of 0 were inundated
    parts, bins = brier_parts(near, came), reliability(forecast, came)
    # a bin without lava, in a forecast or on the map, would always agree
    gaps = [
        abs(item.forecast - item.observed) for item in bins
        if item.count >= CELLS and (item.forecast or item.observed)
    ]
    return {
        'cells': int(np.isfinite(near).sum()),
        'base_rate': float(came[np.isfinite(near)].mean()),
        'brier_score': parts.score,
        'brier_skill': parts.skill,
        'brier_skill_of_terrain': brier_parts(forecast, came).skill,
        'largest_gap': max(gaps) if gaps else None,
        'reliability': [asdict(item) for item in bins if item.count],
    }
