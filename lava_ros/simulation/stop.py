# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The end of an advance of either solver."""

from typing import NamedTuple


class Stop(NamedTuple):
    """The end of an advance.

    Attributes:
        time: Simulated time reached [s].
        step: Length of the next step if ``is_step_pending``, otherwise of the latest step, as it
            would be without stops and without particles that are due within it [s].
        is_step_pending: True if the next step has not begun because it would end too late.
    """

    time: float
    step: float
    is_step_pending: bool
