# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hazard layers, arrival times, GIS files and pictures from snapshots and bags."""
