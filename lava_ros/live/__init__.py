# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Live simulation: one that follows a clock and takes commands, and forecasts of it."""
