# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The device of a simulation, and its default."""

from functools import cache
import logging
import os
import tempfile
from typing import Any

import warp as wp

from lava_ros.errors import LavaError

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
