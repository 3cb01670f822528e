# Copyright 2026 lava_ros contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""From looks at a flow, one after the other, to when lava came and how much of it."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from lava_ros.errors import LavaError

if TYPE_CHECKING:
    from lava_ros.simulation.looks import Seen
    from lava_ros.simulation.simulation import Simulation


class Looking:
    """A simulation that runs from one look to the next, up to a horizon.

    Attributes:
        simulation: The simulation.
    """

    def __init__(
        self,
        simulation: 'Simulation',
        due: Sequence[float],
        *,
        threshold: float,
        max_particles: int | None,
        of: str = '',
    ) -> None:
        """Begin without a look; the first one is of the flow as it is.

        Args:
            simulation: The simulation.
            due: Simulated times of the other looks [s], increasing.
            threshold: Thickness at which lava counts as arrived [m].
            max_particles: Most particles, None for any number.
            of: How errors refer to the simulation, such as ' of member 3'.

        Raises:
            LavaError: There are too many particles.
        """
        self.simulation = simulation
        self._due, self._done = [simulation.time, *due], 0
        self._looks = simulation.looks(threshold, len(self._due))
        self._max_particles, self._of = max_particles, of
        self._check_size(simulation.particle_count)

    @property
    def progress(self) -> float:
        """Share of the looks that have been taken, the first one left out."""
        return max(self._done - 1, 0) / (len(self._due) - 1)

    @property
    def is_done(self) -> bool:
        """Whether all looks have been taken."""
        return self._done == len(self._due)

    def advance(self, wall_limit: float | None = None) -> None:
        """Run to the next look, or for about a wall time [s].

        Raises:
            LavaError: There are too many particles, or the flow can be shown as no map.
        """
        due = self._due[self._done]
        if self.simulation.advance(due, wall_limit=wall_limit) >= due:
            self._check_size(self.simulation.particle_count)
            self.simulation.look(self._looks)
            self._check(self._looks.flaw())
            self._done += 1

    def advancing(self) -> Iterator[None]:
        """Run to the next look, in parts: while a GPU is at work others can go on.

        A flow that can be shown as no map is refused by ``seen``.

        Raises:
            LavaError: There are too many particles.
        """
        yield from self.simulation.advancing(self._due[self._done])
        self._check_size(self.simulation.most_particles)
        yield from self.simulation.looking(self._looks)
        self._done += 1

    def seen(self, *, where_wet: bool = False) -> 'Seen':
        """What has been seen so far, of all cells or of the rectangle of wet ones.

        Raises:
            LavaError: The flow could be shown as no map.
        """
        self._check(self._looks.flaw())
        return self.simulation.seen(self._looks, where_wet=where_wet)

    def _check_size(self, count: int) -> None:
        if self._max_particles is not None and count > self._max_particles:
            right = f'at most {self._max_particles} (max_particles)'
            raise LavaError(f'particles{self._of}', count, right)

    def _check(self, flaw: str) -> None:
        if flaw:
            raise LavaError(f'flow{self._of}', flaw, 'one that can be shown as a map')
