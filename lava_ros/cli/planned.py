# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The plan of runs for ``--within`` and ``--error``."""

import argparse
from collections.abc import Mapping
from typing import Any

from lava_ros import validation
from lava_ros.cli.options import seconds_of
from lava_ros.errors import LavaError, Typed
from lava_ros.forecast.planning import plan_runs, RunPlan
from lava_ros.scene import Scene


def target_of(args: argparse.Namespace) -> dict[str, float]:
    """Return the wall time [s] or the error [fraction] that the arguments ask for, if any.

    Raises:
        LavaError: If a value is not valid.
    """
    if args.within is not None:
        return {'within': seconds_of('--within', args.within)}
    if args.error is not None:
        try:
            number = validation.number(
                '--error', args.error.strip().removesuffix('%'), above=0.0, at_most=100.0, unit='%'
            )
        except LavaError as error:
            raise LavaError('--error', args.error, error.expected) from None
        return {'error': Typed(0.01 * number, args.error)}
    return {}


def planned(
    scene: Scene, target: Mapping[str, float], until: float, forced: Mapping[str, bool],
    device: str | None, *, method: str = 'particles', members: int | None = 1, **options: Any,
) -> RunPlan:
    """Plan runs of a scene for a target, and print the plan.

    Args:
        scene: The scene; for an ensemble, the one with median inputs.
        target: The wall time or the error (``target_of``).
        until: Simulated time at which a run ends [s].
        forced: Effects forced on or off, by name.
        device: Warp device; None for the first GPU, or the CPU without one.
        method: Carriers of the lava.
        members: Number of successive runs; None for the number with the smallest error.
        options: Other arguments of ``plan_runs``.

    Raises:
        LavaError: If no run meets the target.
    """
    try:
        found = plan_runs(
            scene, within=target.get('within'), error=target.get('error'), horizon=until,
            members=members, forced=forced, device=device, method=method, **options,
        )
    except LavaError as error:
        if error.field not in target:
            raise
        raise error.named(f'--{error.field}') from None
    spacing = f'{"cells of" if method == "cells" else "spacing"} {found.spacing:.3g} m'
    print(f'plan: preset {found.preset}, {spacing}')
    return found
