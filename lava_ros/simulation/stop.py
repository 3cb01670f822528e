# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The end of a part of a simulation, by whichever solver."""

from typing import NamedTuple


class Stop(NamedTuple):
    """The end of a part of a simulation.

    Attributes:
        time: Simulated time reached [s].
        step: Length of the next step if ``is_waiting``, otherwise of the latest step without the
            limits by stops and by single particles [s].
        is_waiting: True if the next step would end too late and has therefore not begun.
    """

    time: float
    step: float
    is_waiting: bool
