# SPDX-FileCopyrightText: 2026 lava_ros contributors
# SPDX-License-Identifier: Apache-2.0

"""rosbag2 bags in MCAP files: writing, reading and the timing of a replay. Without ROS."""

from lava_ros.bag.metadata import Topic
from lava_ros.bag.qos import LATCHED, QosProfile
from lava_ros.bag.reader import BagMessage, BagReader
from lava_ros.bag.writer import BagWriter

__all__ = ['LATCHED', 'BagMessage', 'BagReader', 'BagWriter', 'QosProfile', 'Topic']
