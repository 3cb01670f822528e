# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Pages about runs: printed pages of maps, and HTML reports."""
