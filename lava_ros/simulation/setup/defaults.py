# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Defaults for values that a user omits, and effects that a formulation implies."""

from dataclasses import replace
from functools import cache
import logging
import os
import tempfile
from typing import Any

import warp as wp

from lava_ros.effects import Effects
from lava_ros.errors import LavaError
from lava_ros.simulation.accuracy import Accuracy

_LOG = logging.getLogger(__name__)


def device_of(name: str | None) -> Any:
    """Find a Warp device, such as ``cpu`` or ``cuda:0``, by default the first of CUDA or the CPU.

    Raises:
        LavaError: If there is no such device.
    """
    _start_warp()
    try:
        if name is None:
            return wp.get_preferred_device()
        return wp.get_device(name)
    except (ValueError, RuntimeError):
        known = ', '.join(str(device) for device in wp.get_devices())
        raise LavaError('device', name, f'one of {known}') from None


@cache
def _start_warp() -> None:
    """Start Warp, and log what its library would write to stderr."""
    with tempfile.TemporaryFile() as output:
        stderr = os.dup(2)
        os.dup2(output.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            output.seek(0)
            for line in output:
                if line.startswith(b'Warp '):
                    _LOG.info(line.decode(errors='replace').rstrip())
                else:
                    # output of another thread
                    os.write(2, line)


def formulated(effects: Effects, accuracy: Accuracy) -> Effects:
    """Return the effects that the formulation implies: as-published uses a Green's function.

    Raises:
        LavaError: If inertia is selected with the as-published formulation.
    """
    if accuracy.formulation != 'as-published':
        return effects
    if 'inertia' in effects:
        expected = 'false with accuracy.formulation as-published, which has no inertia'
        raise LavaError('effects.inertia', True, expected)
    return replace(effects, green=True, steep=False)
