# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of simulations: the loop that drives them, what observes them, and their folders."""
