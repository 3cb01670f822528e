# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""What Warp lacks: graphs, threads and SIMD on CPUs, scans, read-back; the only C++ and PTX."""
