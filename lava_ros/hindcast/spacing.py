# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The spacing of a preset for a case, from pilot runs (forecast/preset_spacing.py)."""

from lava_ros.forecast.preset_spacing import choose_spacing, SpacingChoice
from lava_ros.hindcast.case import Case
from lava_ros.hindcast.run import Settings, simulated_scene
from lava_ros.simulation.selection import effects_for


def choose_case_spacing(case: Case, settings: Settings, *, runs: int = 1) -> SpacingChoice:
    """Choose the spacing of a case, with pilots on the cells of a run with the first guess.

    Args:
        case: The case.
        settings: Settings of the runs, without a spacing.
        runs: Number of runs.

    Raises:
        LavaError: If a pilot fails.
    """
    accuracy, horizon = settings.accuracy(case), case.duration
    scene = simulated_scene(case, settings.coarseness(case))
    effects = effects_for(scene, settings.effects, accuracy=accuracy, horizon=horizon)
    return choose_spacing(
        scene, settings.preset, accuracy, effects=effects, horizon=horizon, runs=runs,
        device=settings.device,
    )
