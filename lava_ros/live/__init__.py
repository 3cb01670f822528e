# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Live simulation, which follows a clock and accepts commands, and its forecasts."""
