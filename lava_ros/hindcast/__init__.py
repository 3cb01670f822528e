# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""Hindcasts: simulations of past eruptions, compared with mapped flow fields."""
