# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Defaults for values that a user omits, and effects of a formulation."""

from dataclasses import replace
from functools import cache
import logging
import os
import tempfile
from typing import Any

import warp as wp

from lava_ros.effects import EFFECTS, Effects
from lava_ros.errors import LavaError
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.selection import implied_effects

_LOG = logging.getLogger(__name__)


def device_of(name: str | None, method: str = 'particles') -> Any:
    """Find a Warp device, such as ``cpu`` or ``cuda:0``.

    Args:
        name: Its name; None for the first GPU, or the CPU without one. On cells it is the CPU,
            because the cells of one run rarely fill a GPU.
        method: Carriers of the lava (``Accuracy.method``).

    Raises:
        LavaError: If there is no such device.
    """
    _start_warp()
    try:
        if name is None and method == 'cells':
            name = 'cpu'
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
    """Return effects with those that the formulation switches on or off.

    Raises:
        LavaError: If an effect is on that the formulation excludes, unless it is on by default.
    """
    asked = {name: True for name in effects if not EFFECTS[name].is_default}
    return replace(effects, **implied_effects(accuracy, asked))
