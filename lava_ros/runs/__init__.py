# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Runs of simulations: the loop that drives them, observers of the flow, and folders."""
