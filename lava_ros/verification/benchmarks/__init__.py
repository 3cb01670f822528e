# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks: time of a step, cost of effects, and benefit of their selection."""
