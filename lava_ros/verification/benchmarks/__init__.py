# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Benchmarks: how fast a step is, what effects cost, and what the choice of them gains."""
