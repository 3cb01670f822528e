# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Observers of a run: peaks and arrivals on the device, snapshots, and progress."""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
import math
from typing import TYPE_CHECKING

from lava_ros.errors import LavaError, RefusalError
from lava_ros.runs.drive import Sink
from lava_ros.simulation.carriers import COUNTED

if TYPE_CHECKING:
    # importing the solver loads Warp
    from lava_ros.simulation.output.peaks import PeakMaps
    from lava_ros.simulation.output.snapshot import Snapshot
    from lava_ros.simulation.simulation import Simulation


class ScheduledSink(Sink):
    """A sink with a schedule of observations.

    Attributes:
        times: Simulated times of the observations [s], increasing. A time that the previous
            observation has already passed is skipped.
    """

    def __init__(self, times: Sequence[float], *, after: float = -math.inf) -> None:
        """Initialize with a schedule, of which times up to ``after`` [s] are left out."""
        self.times, self._done = list(times), 0
        self._note_time(after)

    @property
    def is_done(self) -> bool:
        """True if all observations are complete."""
        return self._done == len(self.times)

    def _note_time(self, time: float) -> None:
        """Note an observation at a simulated time [s]."""
        self._done = bisect_right(self.times, time)
        self.due = math.inf if self.is_done else self.times[self._done]


#: Number of observations of a flow whose steps keep the peaks: for reviews and the progress.
FEW = 8


class TimeSink(ScheduledSink):
    """Calls a function with the simulated time [s] of each observation."""

    def __init__(
        self, times: Sequence[float], call: Callable[[float], object], *,
        after: float = -math.inf,
    ) -> None:
        """Initialize with a schedule [s], of which times up to ``after`` are left out."""
        super().__init__(times, after=after)
        self._call = call

    def observe(self, simulation: 'Simulation', time: float) -> Iterable[object]:
        """Call the function."""
        self._note_time(time)
        self._call(time)
        return ()


class PeakSink(ScheduledSink):
    """Largest values and first arrivals in each cell, gathered on the device.

    The first observation is of the flow at the start.
    """

    def __init__(
        self,
        simulation: 'Simulation',
        times: Sequence[float],
        *,
        threshold: float,
        max_particles: int | None = None,
        of: str = '',
    ) -> None:
        """Initialize.

        Args:
            simulation: The simulation.
            times: Simulated times of the observations after the first one [s], increasing.
            threshold: Thickness at or above which lava has arrived [m].
            max_particles: Maximum number of particles, or of cells with lava; None for no limit.
            of: Suffix for errors about the simulation, such as ' of member 3'.

        Raises:
            LavaError: If there are too many particles.
        """
        if simulation.keeps_peaks:
            # from the last one backwards
            times = times[:: -max(len(times) // FEW, 1)][::-1]
        super().__init__([simulation.time, *times])
        self._peaks = simulation.start_peaks(threshold)
        self._max_particles, self._of = max_particles, of
        self._counted = COUNTED[simulation.accuracy.method]
        self._check_size(simulation.particle_count)

    @property
    def progress(self) -> float:
        """Completed fraction of the observations, without the first one."""
        return max(self._done - 1, 0) / (len(self.times) - 1)

    def observe(self, simulation: 'Simulation', time: float) -> Iterator[None]:
        """Add the flow to the peaks; ``seen`` raises the error about an unusable flow."""
        self._check_size(simulation.most_particles)
        yield from simulation.observing(self._peaks)
        self._note_time(time)

    def seen(self, simulation: 'Simulation', *, where_wet: bool = False) -> 'PeakMaps':
        """Return the observations so far, of all cells or of the rectangle around wet cells.

        Raises:
            LavaError: If the flow cannot be shown as a map.
        """
        seen = simulation.read_peaks(self._peaks, where_wet=where_wet)
        self._check_flow(seen.flaw)
        return seen

    def check(self) -> None:
        """Raise LavaError if the flow of an observation cannot be shown as a map."""
        self._check_flow(self._peaks.flaw())

    def _check_size(self, count: int) -> None:
        if self._max_particles is not None and count > self._max_particles:
            expected = f'at most {self._max_particles} (max_particles)'
            raise LavaError(f'{self._counted}{self._of}', count, expected)

    def _check_flow(self, flaw: str) -> None:
        if flaw:
            raise unusable_flow(flaw, self._of)


def unusable_flow(flaw: str, of: str = '') -> RefusalError:
    """Return the error about a flow that cannot be shown as a map."""
    problem = f'The flow{of} cannot be shown as a map: {flaw}'
    return RefusalError(f'flow{of}', problem, 'Try another preset or spacing')


class SnapshotSink(ScheduledSink):
    """Snapshots at scheduled times, each of which is passed to functions.

    Attributes:
        latest: The newest snapshot, None before the first.
    """

    def __init__(
        self,
        times: Sequence[float],
        *receivers: Callable[['Simulation', 'Snapshot'], object],
        after: float = -math.inf,
        convert: Callable[['Snapshot'], 'Snapshot'] = lambda snapshot: snapshot,
    ) -> None:
        """Initialize.

        Args:
            times: Simulated times of the snapshots [s], increasing.
            receivers: Functions that are called with the simulation and each snapshot.
            after: Times up to this one [s] are left out.
            convert: Converts a snapshot before it is passed on.
        """
        super().__init__(times, after=after)
        self._receivers, self._convert = receivers, convert
        self.latest: Snapshot | None = None

    def observe(self, simulation: 'Simulation', time: float) -> Iterable[object]:
        """Pass a snapshot on.

        Raises:
            LavaError: If the flow cannot be shown as a map.
        """
        self.latest = valid_snapshot(simulation, self._convert)
        for receive in self._receivers:
            receive(simulation, self.latest)
        self._note_time(time)
        return ()


def valid_snapshot(
    simulation: 'Simulation',
    convert: Callable[['Snapshot'], 'Snapshot'] = lambda snapshot: snapshot,
) -> 'Snapshot':
    """Return a converted snapshot of a simulation.

    Raises:
        LavaError: If the flow cannot be shown as a map.
    """
    snapshot = convert(simulation.snapshot())
    if flaw := snapshot.flaw():
        raise unusable_flow(flaw)
    return snapshot


class ProgressSink(Sink):
    """Shows the simulated fraction of a run whenever an update is due."""

    def __init__(
        self, show: Callable[[float], object], until: float, is_due: Callable[[], bool]
    ) -> None:
        """Initialize.

        Args:
            show: Function that is called with the simulated time [s].
            until: Simulated time at which the run ends [s].
            is_due: Returns True if an update is due; reading the time waits for a GPU.
        """
        self._show, self._until, self._is_due = show, until, is_due

    def note(self, simulation: 'Simulation') -> None:
        """Show the progress if it is due."""
        if self._is_due():
            self._show(min(simulation.time, self._until))
