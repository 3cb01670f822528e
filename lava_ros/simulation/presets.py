# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Named settings on the measured trade-off between accuracy and computing time.

The ratio and the fraction of the stable step were chosen from a full run of `lava accuracy`
(docs/accuracy/h200.csv; docs/accuracy/ has its table and chart), the refinements by the agreement
of the outlines of real flows (docs/benchmarks/convergence_h100.csv).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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
    """

    accuracy: Accuracy
    summary: str
    errors: dict[str, float]


# A ratio of 3.5 has the smallest mean error over the cases at refinements 0.5 and 1 alike. The
# stages are a fifth below the stability limit of 2, which costs a tenth more of them, no accuracy.

#: The presets by name, from the fastest to the slowest.
PRESETS: dict[str, Preset] = {
    'draft': Preset(
        Accuracy(refinement=0.707, ratio=3.5, diffusion_number=1.6),
        'A first look, and ensembles of many runs: 11 particles across the flow.',
        {'radius': 0.0013, 'profile': 0.0061, 'edge': 0.0053},
    ),
    'standard': Preset(
        Accuracy(refinement=1.0, ratio=3.5, diffusion_number=1.6),
        'For maps: 16 particles across the flow.',
        {'radius': 0.0007, 'profile': 0.0035, 'edge': 0.004},
    ),
    'fine': Preset(
        Accuracy(refinement=1.414, ratio=3.5, diffusion_number=1.6),
        'For figures: 23 particles across the flow.',
        {'radius': 0.0008, 'profile': 0.0026, 'edge': 0.0036},
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
        {'radius': 0.0008, 'profile': 0.0022, 'edge': 0.0024},
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
        {'radius': 0.04, 'profile': 2.6, 'scatter': 1.7},
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
