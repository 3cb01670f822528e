# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The solver: shallow-layer SPH of lava on Warp devices. No ROS in here."""

from importlib import import_module
from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from lava_ros.simulation.output.budget import VolumeBudget
    from lava_ros.simulation.output.checkpoint import MODEL
    from lava_ros.simulation.output.snapshot import Particles, Snapshot, StepReport
    from lava_ros.simulation.simulation import Simulation

#: Public names and their modules. Warp is loaded only by a name that needs it: accuracy, presets
#: and checkpoints do not.
_MODULES = {
    'MODEL': 'output.checkpoint',
    'Particles': 'output.snapshot',
    'Simulation': 'simulation',
    'Snapshot': 'output.snapshot',
    'StepReport': 'output.snapshot',
    'VolumeBudget': 'output.budget',
}

__all__ = ['MODEL', 'Particles', 'Simulation', 'Snapshot', 'StepReport', 'VolumeBudget']


def __getattr__(name: str) -> Any:
    """Import a public name at its first use (PEP 562)."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)
