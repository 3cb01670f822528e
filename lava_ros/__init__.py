# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Lava flow simulation on the GPU as a ROS 2 node."""

__version__ = '0.2.0'
