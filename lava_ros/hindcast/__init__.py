# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0


"""Real eruptions again: a case is run, and what it covers is compared with what was mapped."""
