# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""The expected course of a flow, defaults, and the review of effects during a run."""
