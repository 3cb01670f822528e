# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Other nodes than that of the simulation: they replay, feed, watch or test."""
