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

"""The accuracy that goes with the deadline of forecasts, chosen at a start. No rclpy in here."""

from dataclasses import dataclass
from functools import partial
import time

from lava_ros.errors import LavaError
from lava_ros.ros.parameters import Settings
from lava_ros.scene import Scene
from lava_ros.simulation.accuracy import Accuracy
from lava_ros.simulation.presets import preset_accuracy


@dataclass(frozen=True)
class DeadlineChoice:
    """What was chosen at a start, and why.

    Attributes:
        reason: In words.
        is_met: Whether forecasts are expected to be there in time.
        spacing: Distance between particles [m], None where it is that of the parameters.
        members: Most members of an ensemble, None for those that are asked for.
        wall_time: Expected wall time of a forecast with its ensemble [s].
        error: Expected share of the covered area that is wrong for being coarse.
        sampling_error: Expected standard error of a probability of one half, 0 without members.
        spent: Wall time that the choice took [s].
    """

    reason: str
    is_met: bool
    spacing: float | None = None
    members: int | None = None
    wall_time: float = 0.0
    error: float = 0.0
    sampling_error: float = 0.0
    spent: float = 0.0


class DeadlineChooser:
    """Chooses once for each start; the worker's thread calls, others read.

    Attributes:
        choice: What was chosen at the last start, None without a deadline or a vent.
    """

    def __init__(self) -> None:
        """Begin without a choice."""
        self.choice: DeadlineChoice | None = None

    def accuracy(self, scene: Scene, settings: Settings) -> Accuracy:
        """The accuracy of a simulation of a scene."""
        usual = preset_accuracy(settings.preset, spacing=settings.spacing)
        self.choice = None
        if not settings.deadline or not scene.vents:
            return usual
        begun = time.monotonic()
        try:
            return self._afford(scene, settings)
        except LavaError as error:
            # late maps of a flow are better than none
            self.choice = DeadlineChoice(
                f'preset {settings.preset}, as without a deadline: {error}',
                is_met=False,
                spent=time.monotonic() - begun,
            )
            return usual

    def _afford(self, scene: Scene, settings: Settings) -> Accuracy:
        # the solver loads Warp; the worker's thread does that, not the importer
        from lava_ros.forecast.planning import afford, sampling_error

        begun = time.monotonic()
        asked = settings.ensemble_members
        how = partial(
            afford,
            scene,
            within=settings.deadline,
            horizon=settings.forecast_horizon,
            device=settings.device,
        )
        try:
            # the next forecasts take turns with the members
            plan = how(members=1 + 2 * asked)
        except LavaError:
            if not asked:
                raise
            # not even the coarsest: as many as err least
            plan = how(members=None)
        members = min(asked, max(plan.members - 1, 0) // 2)
        self.choice = DeadlineChoice(
            f'spacing {plan.spacing:.3g} m'
            + (f' and {members} of {asked} members' if asked else '')
            + f': {plan.members} run{"s" * (plan.members > 1)} in about {plan.wall_time:.2g} s of '
            f'{settings.deadline:g} s, from {plan.pilots} pilot runs'
            + ('; more time would not help' if plan.is_finest else ''),
            is_met=True,
            spacing=plan.spacing,
            members=members,
            wall_time=plan.wall_time,
            error=plan.error,
            sampling_error=sampling_error(members),
            spent=time.monotonic() - begun,
        )
        return preset_accuracy(plan.preset, spacing=plan.spacing)
