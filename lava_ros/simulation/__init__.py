"""The solver: shallow-layer SPH of lava on Warp devices. No ROS in here."""

import warp as wp

from lava_ros.simulation.simulation import Simulation
from lava_ros.simulation.snapshot import Snapshot, StepReport, VolumeBudget
from lava_ros.simulation.state import Particles

# Warp reports every kernel it loads on stdout, where commands print their results.
wp.config.log_level = wp.LOG_WARNING

__all__ = ['Particles', 'Simulation', 'Snapshot', 'StepReport', 'VolumeBudget']
