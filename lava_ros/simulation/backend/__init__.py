# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Features that Warp lacks: graphs, threads and SIMD on CPUs, scans, readback, C++ and PTX."""
