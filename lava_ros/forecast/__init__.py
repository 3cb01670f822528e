# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Forecasts: a single look ahead, or an ensemble of many runs. Never imports rclpy."""
