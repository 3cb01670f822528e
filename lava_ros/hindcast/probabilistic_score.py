# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Ensembles of a case: inundation probability, and its score against the mapped flow field."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np

from lava_ros.errors import LavaError
from lava_ros.forecast.assimilation import Mask, outline_on
from lava_ros.forecast.member_scenes import median_scene
from lava_ros.forecast.members import make_plan, Plan
from lava_ros.forecast.scores import brier_parts, reliability
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.coarse import coarsened
from lava_ros.hindcast.free_parameters import published_uncertainty
from lava_ros.hindcast.run import FORCED, Settings
from lava_ros.scene.uncertainty import Uncertainty
from lava_ros.simulation.accuracy import COVERED

#: Minimum number of cells of a bin of the reliability diagram whose gap counts.
CELLS = 200


def plan_of(case: Case, settings: Settings, *, threshold: float = COVERED) -> Plan:
    """Plan an ensemble of a case whose members run like its hindcast, to the same end.

    If the case does not define uncertainties, everything with a published range is uncertain, and
    so are effusion rates if their table has errors. Each map is an observation; ``threshold`` is
    the thickness at or above which lava has arrived [m].

    Raises:
        LavaError: If the case has events, or an argument is not valid.
    """
    if case.events:
        expected = 'none in an ensemble: all members run on the ground before the first event'
        raise LavaError('case.events', len(case.events), expected)
    scene = case.scene
    if scene.uncertainty == Uncertainty():
        uncertainty = published_uncertainty(case)
        if case.rate_error is not None:
            uncertainty = replace(uncertainty, discharge=case.rate_error)
        scene = replace(scene, uncertainty=uncertainty)
    typical = replace(case, scene=median_scene(scene))
    return make_plan(
        replace(scene, terrain=coarsened(scene.terrain, settings.coarseness(typical))),
        horizon=case.duration,
        accuracy=settings.accuracy(typical),
        effects={**FORCED, **settings.forced},
        threshold=threshold,
        samples=settings.maps,
    )


def mapped_on(case: Case, plan: Plan) -> np.ndarray:
    """Return the mapped flow field on the cells of a plan, bool, shape [rows, columns]."""
    terrain = case.scene.terrain
    mask = Mask(case.footprint, terrain.has_data, terrain.resolution, terrain.origin)
    return outline_on(plan.scene.terrain, mask, plan.horizon).lava


def score_probability(probability: np.ndarray, came: np.ndarray) -> dict[str, Any]:
    """Score a map of probability (0 to 100 %, NaN without data) against the inundated cells.

    Dry cells with a probability of 0 are easy to forecast, so the skill is given without them,
    and also for the whole terrain.

    Returns:
        Brier score, its skill against the base rate, this rate, the bins of the reliability
        diagram and the largest gap in a bin of at least ``CELLS`` cells (None without one).
    """
    forecast = np.asarray(probability, dtype=np.float64) / 100.0
    near = np.where((forecast > 0.0) | came, forecast, np.nan)
    # bins of all cells: in ``near``, all cells with a probability of 0 were inundated
    parts, bins = brier_parts(near, came), reliability(forecast, came)
    gaps = [abs(item.forecast - item.observed) for item in bins if item.count >= CELLS]
    return {
        'cells': int(np.isfinite(near).sum()),
        'base_rate': float(came[np.isfinite(near)].mean()),
        'brier_score': parts.score,
        'brier_skill': parts.skill,
        'brier_skill_of_terrain': brier_parts(forecast, came).skill,
        'largest_gap': max(gaps) if gaps else None,
        'reliability': [asdict(item) for item in bins if item.count],
    }
