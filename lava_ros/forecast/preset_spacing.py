# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The particle spacing of a preset, from pilot runs of its scene.

A preset has a target: the particles' part of the numerical error over the ground's part. Pilots
measure both, in at most ``PLANNING_FRACTION`` of the work of the runs, and the spacing follows
from the order of the particles' part. It is at most the first guess of ``draft``, and at least
such that the number of particles and the lateral stress do not limit it (resolution.py).

Work is counted in evaluations and particles, not in time, so that a repeated run has the same
spacing. The first guess remains if pilots would take more than their part of the work, and for
lava that freezes, because two runs of it differ more by chance than by their spacing
(docs/MODEL.md).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
import math

from lava_ros.effects import Effects
from lava_ros.forecast.pilot_runs import Pilot, SETUP_WORK
from lava_ros.forecast.pilot_search import PilotSearch, PLANNING_FRACTION
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.numerical_error import NumericalError
from lava_ros.simulation.presets import PRESETS
from lava_ros.simulation.resolution import ACROSS, Resolution, resolution_of

#: Minimum number of particles across the expected width: the first guess of ``draft``.
MIN_ACROSS = ACROSS * PRESETS['draft'].accuracy.refinement

#: Particles across the flow of the first pilot. This pilot, one on coarser ground and one finer by
#: ``FINER`` together take less than ``PLANNING_FRACTION`` of the work of the coarsest run.
FIRST_ACROSS = 3.0

#: Minimum number of particles of all runs, by the first guess, for pilots.
MIN_PARTICLES = 2000

#: Fraction of the work planned for pilots, because finer pilots often find a coarser spacing, and
#: fraction up to which the finest pilot runs on coarser ground.
_PLANNED, _FILLED = 0.6 * PLANNING_FRACTION, 0.8 * PLANNING_FRACTION

#: Reason for a first guess when pilots would be too expensive.
TOO_SHORT = f'pilot runs would take more than {100.0 * PLANNING_FRACTION:g} % of the time'

#: Minimum exponent of the refinement with which work grows.
_MIN_GROWTH = 3.0


@dataclass(frozen=True)
class SpacingChoice:
    """Choice of the spacing of a preset.

    Attributes:
        spacing: Particle spacing [m].
        error: Expected numerical error; None for a first guess.
        pilots: Number of pilot runs.
        reason: Reason for a first guess.
    """

    spacing: float
    error: NumericalError | None = None
    pilots: int = 0
    reason: str = ''

    def text(self) -> str:
        """Describe the choice in one line."""
        if self.error is None:
            return f'spacing {self.spacing:.3g} m, a first guess: {self.reason}'
        return (
            f'spacing {self.spacing:.3g} m by {self.pilots} pilot runs; expected error: '
            f'{self.error.text()}'
        )


def choose_spacing(
    scene: Scene,
    preset: str,
    accuracy: Accuracy,
    *,
    effects: Effects,
    horizon: float,
    runs: int = 1,
    device: str | None = None,
    on_pilot: Callable[[Pilot], None] = lambda _: None,
) -> SpacingChoice:
    """Choose the spacing of a preset for a scene.

    Args:
        scene: The scene; for an ensemble, the one with median inputs.
        preset: Name of the preset.
        accuracy: Accuracy of the runs, with the first guess of the spacing.
        effects: Effects of the runs.
        horizon: Simulated duration of each run [s].
        runs: Number of runs.
        device: Warp device; None for the first GPU, or the CPU without one.
        on_pilot: Called with each pilot.

    Raises:
        LavaError: If a pilot fails.
    """
    guess = accuracy.spacing
    assert guess is not None
    # the preset sets the limits due to the number of particles
    expected = resolution_of(scene, accuracy, horizon=horizon)
    if PRESETS[preset].target is None or math.isnan(expected.width):
        return SpacingChoice(guess, reason='no pilot runs')
    if effects.any('freezes'):
        return SpacingChoice(guess, reason='where lava freezes depends on chance')
    if expected.particles * runs < MIN_PARTICLES:
        return SpacingChoice(guess, reason=TOO_SHORT)
    search = PilotSearch(
        scene, horizon, lambda refinement: replace(accuracy, spacing=guess / refinement),
        effects, FIRST_ACROSS / expected.across, device, None, on_pilot,
    )

    def wanted() -> float:
        """Return the refinement of the runs relative to the first guess."""
        if len(search.pilots) < 2:
            return 1.0
        return guess / spacing_of_preset(preset, search, expected)

    def work() -> float:
        """Return the work of all runs."""
        refinement = wanted()
        if len(search.pilots) > 1:
            return runs * search.cost(refinement)
        each = [
            pilot.setup + (pilot.wall_time - pilot.setup)
            * (refinement / pilot.refinement) ** _MIN_GROWTH
            for pilot in search.pilots
        ]
        return runs * max([*each, SETUP_WORK])

    search.run_pilots(lambda: _PLANNED * work(), wanted)
    if len(search.pilots) < 2:
        return SpacingChoice(guess, None, search.count, TOO_SHORT)
    search.measure_finest_ground(_FILLED * work() - search.spent)
    # rounded to two digits, so that rounding errors of pilots change nothing
    spacing = float(f'{guess / wanted():.2g}')
    return SpacingChoice(spacing, search.error(guess / spacing), search.count)


def spacing_of_preset(preset: str, search: PilotSearch, expected: Resolution) -> float:
    """Return the spacing of a preset with a target [m].

    Args:
        preset: Name of the preset.
        search: Pilots with particles and ground measured.
        expected: Expected resolution at the preset, whose limits apply.
    """
    if search.effects.any('freezes'):
        return expected.spacing
    refinement = search.refinement_for(PRESETS[preset].particle_error)
    spacing = search.accuracy_at(refinement).spacing
    assert spacing is not None
    return max(min(spacing, expected.width / MIN_ACROSS), expected.finest)
