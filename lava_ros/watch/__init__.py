# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A live view of a flow in the browser, of a running node or of a bag."""
