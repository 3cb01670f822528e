# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Interface of the solvers behind a simulation.

``Simulation`` decides what to simulate: vents, terrain, effects and events. A solver owns the lava
on a device and advances it for one scene and one set of effects. There are two:
``particles/solver.py`` and ``cells/solver.py``.
"""

from collections.abc import Generator, Iterator
import math
from typing import Any, NamedTuple, Protocol

import numpy as np
import warp as wp

from lava_ros.effects import Effects
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.output.budget import VolumeBudget
from lava_ros.simulation.output.checkpoint import Checkpoint
from lava_ros.simulation.output.peaks import PeakMaps, Peaks
from lava_ros.simulation.output.snapshot import Particles, ParticleSample, PendingSnapshot


class Stop(NamedTuple):
    """Where a solver has stopped.

    Attributes:
        time: Simulated time reached [s].
        step: Length of the next step if ``is_step_pending``, otherwise of the latest step, as it
            would be without stops and without particles that are due within it [s].
        is_step_pending: True if the next step has not begun because it would end too late.
    """

    time: float
    step: float
    is_step_pending: bool


class Solver(Protocol):
    """Lava on a device, with vents and kernels.

    Attributes:
        scene: The current scene.
        device: The Warp device.
        volume_before: Volume on the terrain at the start, plus that of former vents [m3].
        most_particles: Maximum number of particles, or of cells with lava, at any readback so far.
        vents: The vents on the device; ``vents.since`` is the time from which they emit [s].
        keeps_peaks: True if steps keep the peaks themselves, so that few observations suffice.
    """

    scene: Scene
    device: wp.Device
    volume_before: float
    most_particles: int
    vents: Any
    keeps_peaks: bool

    def __init__(
        self, scene: Scene, effects: Effects, accuracy: Accuracy, device: wp.Device
    ) -> None:
        """Allocate the arrays; there are neither vents nor lava yet.

        Args:
            scene: Terrain, vents and lava.
            effects: The effects that are on.
            accuracy: The resolution, with all automatic values filled in.
            device: The Warp device.

        Raises:
            LavaError: If the solver lacks an effect or does not run on the device.
        """

    @staticmethod
    def bytes_for(scene: Scene, effects: Effects, accuracy: Accuracy, volume: float) -> int:
        """Return the memory of a simulation and its ``Peaks`` on a device [bytes].

        It leaves out what simulations on the same terrain share, and the arrays of few items.

        Args:
            scene: Terrain, vents and lava.
            effects: The effects that are on.
            accuracy: The resolution, with all automatic values filled in.
            volume: Expected volume of the lava [m3].
        """

    @property
    def effects(self) -> Effects:
        """The effects that are on."""

    @property
    def time(self) -> float:
        """Simulated time [s]."""

    @property
    def steps(self) -> int:
        """Number of time steps so far."""

    @property
    def count(self) -> int:
        """Number of particles, or of cells with lava."""

    @property
    def capacity(self) -> int:
        """Number of particles or cells for which there is memory."""

    @property
    def column_spacing(self) -> float:
        """Distance between the columns into which emplaced lava is divided [m]."""

    def start_with(self, particles: Particles | None) -> None:
        """Place the lava of the start on the terrain, and open the vents of the scene.

        Raises:
            LavaError: If lava is not on the terrain, or a discharge is out of range.
        """

    def advancing_to(
        self, until: float, end: float | None, deadline: float, max_end: float = math.inf
    ) -> Generator[None, None, Stop]:
        """Advance to a time, or to the step after which no lava is left; yield between launches.

        After the deadline the last step may be incomplete. The next call continues it; with the
        current time as ``until`` it only completes that step.

        Args:
            until: Simulated time to reach [s].
            end: Simulated time that no step may pass [s]; None keeps the previous one.
            deadline: Time of ``time.monotonic`` after which to stop early [s].
            max_end: Simulated time after which no step may end [s]: a step that would end later
                does not begin. Infinite for a member of a batch.

        Returns:
            Where it stopped; the time is the end of the last complete step.
        """

    def begin_snapshot(self, *, overlaps: bool) -> PendingSnapshot:
        """Map the flow; the copy to the host may overlap with the next steps."""

    def start_peaks(self) -> None:
        """Begin to keep peaks, if the steps keep them."""

    def observing(self, peaks: Peaks) -> Iterator[None]:
        """Raise peaks to the values of the current flow; yield to other members of a batch."""

    def read_peaks(self, peaks: Peaks, *, where_wet: bool) -> PeakMaps:
        """Return the peaks so far, of all cells or of the rectangle that lava can reach."""

    def sample(self) -> ParticleSample:
        """Read the particles, or the columns of the cells, with thickness and velocity."""

    def maps_and_sample(self) -> tuple[Any, ParticleSample]:
        """Map the flow, and read its particles or columns."""

    def budget(self) -> VolumeBudget:
        """Return the volume budget."""

    def replace_vents(self, scene: Scene) -> None:
        """Continue with the vents of another scene; closing vents empty their conduits.

        Raises:
            LavaError: If the solver cannot have these vents. The previous vents then remain.
        """

    def replace_terrain(self, scene: Scene) -> None:
        """Continue on the terrain of another scene; lava outside it counts as lost.

        Raises:
            LavaError: If the spacing is too small for the terrain. The previous one then remains.
        """

    def switch_effects(self, effects: Effects) -> None:
        """Continue with other effects.

        Raises:
            LavaError: If the solver lacks one of them.
        """

    def save(self) -> dict[str, np.ndarray]:
        """Copy all arrays from which the solver can be resumed, between two steps, by name."""

    def load(self, checkpoint: Checkpoint) -> None:
        """Restore the arrays of a checkpoint of the same scene, effects and accuracy.

        Raises:
            LavaError: If an array is missing, does not belong to the scene and the effects, or has
                numbers that no simulation has.
        """
