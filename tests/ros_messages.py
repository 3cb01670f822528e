# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""ROS messages of which the package makes only parts, or only the plain data."""

from lava_ros.bag import messages as bag_messages
from lava_ros.layers import messages
from lava_ros.ros.codec import made, plain


def float_image(values, header):
    """Make a 32FC1 image from float values, shape [rows, columns], row 0 at the smallest y."""
    return made(bag_messages.float_image(values, plain(header)))


def vent_markers(vents, time, terrain, header):
    """Make markers of the vents at a simulated ``time`` [s] and of the barriers."""
    return made(messages.vent_markers(vents, time, terrain, plain(header)))
