# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Waits for expected events on a busy machine."""

import time

#: Maximum wait [s].
PATIENCE = 600.0


def wait_until(condition, what=lambda: '', pause=0.01):
    """Wait until ``condition`` returns a true value, and return it."""
    end = time.monotonic() + PATIENCE
    while not (value := condition()):
        assert time.monotonic() < end, what()
        time.sleep(pause)
    return value
