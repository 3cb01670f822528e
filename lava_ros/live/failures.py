# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Failures of a live simulation, and their descriptions."""

from lava_ros.simulation.backend.memory import NO_MEMORY
from lava_ros.simulation.carriers import COUNTED
from lava_ros.simulation.output.snapshot import Snapshot


class SimulationError(Exception):
    """The simulation cannot continue; the message contains the reason and a remedy."""


def failure_text(error: Exception, latest: Snapshot | None) -> str:
    """Describe why the simulation has failed, and the remedy if one is known."""
    if isinstance(error, SimulationError):
        return str(error)
    if isinstance(error, MemoryError) or NO_MEMORY in str(error):
        held = ''
        if latest is not None:
            rows, columns = latest.terrain.shape
            count = f'{latest.particle_count} {COUNTED[latest.method]}'
            held = f' with {count} on a terrain of {columns} x {rows} cells'
        reason = str(error.__cause__ or error) or type(error).__name__
        return f'out of memory{held}: {reason}; a larger spacing or a coarser terrain needs less'
    return f'{type(error).__name__}: {error}'
