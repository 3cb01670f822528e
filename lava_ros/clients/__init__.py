# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Nodes other than the simulation node: they replay, feed, watch or test."""
