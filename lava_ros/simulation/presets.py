# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Named settings on the measured trade-off between accuracy and computing time.

A preset has a target: the part of the particles in the numerical error of the inundated area.
Pilot runs find the spacing for it (forecast/preset_spacing.py); its refinement is a first guess.

The ratio and the fraction of the stable step were chosen from a full run of `lava check accuracy`
(docs/accuracy/h200.csv; docs/accuracy/ has its table and chart), the refinements by the agreement
of the outlines of real flows (docs/benchmarks/convergence_h100.csv).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from lava_ros import validation
from lava_ros.simulation.accuracy import Accuracy


@dataclass(frozen=True)
class Preset:
    """A named accuracy.

    Attributes:
        accuracy: The settings.
        summary: Recommended use, in one sentence.
        errors: Largest relative error of each quantity in the case ``fixed_volume`` of that run,
            rounded up.
        target: Part of the particles in the error over that of the ground's cells, the smallest
            with which closer particles pay at this preset; None for a preset without pilot runs.
    """

    accuracy: Accuracy
    summary: str
    errors: dict[str, float]
    target: float | None = None

    def particle_error(self, ground: float) -> float:
        """Return the wanted part of the particles, for a part of the ground's cells."""
        assert self.target is not None
        known = 0.0 if math.isnan(ground) else ground
        return self.target * max(known, ENOUGH)


#: Error of the inundated area below which a part of the ground counts as this much: an effusion
#: rate 25 % higher changes the area by 16 % (docs/MODEL.md), so that both together change it
#: by a fifth more at most.
ENOUGH = 0.1

# A ratio of 3.5 has the smallest mean error over the cases at refinements 0.5 and 1 alike. The
# stages are a fifth below the stability limit of 2, which costs a tenth more of them, no accuracy.

#: The presets by name, from the fastest to the slowest.
PRESETS: dict[str, Preset] = {
    'draft': Preset(
        Accuracy(refinement=0.707, ratio=3.5, diffusion_number=1.6),
        'A first look, and ensembles of many runs: particles make as large an error as cells.',
        {'radius': 0.0013, 'profile': 0.0061, 'edge': 0.0071},
        target=1.0,
    ),
    'standard': Preset(
        Accuracy(refinement=1.0, ratio=3.5, diffusion_number=1.6),
        'For maps: particles make half the error of the cells.',
        {'radius': 0.0007, 'profile': 0.0035, 'edge': 0.0053},
        target=0.5,
    ),
    'fine': Preset(
        Accuracy(refinement=1.414, ratio=3.5, diffusion_number=1.6),
        'For figures: particles make a quarter of the error of the cells.',
        {'radius': 0.0008, 'profile': 0.0026, 'edge': 0.0043},
        target=0.25,
    ),
    'reference': Preset(
        # Half the displacement per step: the remaining error is that of the particle spacing.
        Accuracy(
            refinement=2.0,
            ratio=4.0,
            raster_ratio=1.05,
            courant_number=0.25,
            gradient='balanced',
            precision='float64',
            deterministic=True,
            symmetric=True,
        ),
        'To measure the others against: float64, short steps, ponds at rest.',
        {'radius': 0.0008, 'profile': 0.0022, 'edge': 0.003},
    ),
    'as-published': Preset(
        # Table 3.1: dt = 0.01 s; V = (2 l / 3)^3 at l = h = 1 m is a ratio of (3 / 2)^(3 / 2).
        Accuracy(
            refinement=0.25,
            ratio=1.84,
            kernel='poly6',
            integrator='euler',
            fixed_step=0.01,
            formulation='as-published',
        ),
        "The paper's printed formulas of the velocity, and settings: for comparison only.",
        {'radius': 0.19, 'profile': 2.2, 'scatter': 0.91},
    ),
}

#: The default preset.
DEFAULT = 'standard'


def preset_accuracy(name: str, *, spacing: float | None = None) -> Accuracy:
    """Return the accuracy of a preset.

    Args:
        name: The preset.
        spacing: Distance between particles [m] instead of the automatic one.

    Raises:
        LavaError: If there is no such preset, or the spacing is not valid.
    """
    validation.choice('preset', name, tuple(PRESETS))
    accuracy = PRESETS[name].accuracy
    return accuracy if spacing is None else replace(accuracy, spacing=spacing)
