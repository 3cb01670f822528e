# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""A process that reads untrusted files with GDAL, and returns arrays and text."""
