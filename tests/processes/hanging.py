# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A module whose import never ends."""

import time

while True:
    time.sleep(3600.0)
