"""Lava flow simulation on the GPU as a ROS 2 node."""

__version__ = '0.1.0'
