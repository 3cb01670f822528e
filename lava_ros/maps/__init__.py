# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""From snapshots and bags to hazard layers, arrival times, GIS files, pictures and pages."""
