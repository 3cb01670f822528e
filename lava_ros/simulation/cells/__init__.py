# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Solver of columns on the cells of a grid: second-order finite volumes (docs/MODEL.md)."""
