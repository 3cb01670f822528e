"""Whether ROS 2 is there, for the commands that need it."""

from importlib.util import find_spec

from lava_ros.errors import LavaError


def require_ros() -> None:
    """Do nothing where ROS 2 can be imported.

    Raises:
        LavaError: It cannot; the message says how to get it.
    """
    for name in ('rclpy', 'nav_msgs'):
        if find_spec(name) is None:
            raise LavaError(
                f'Python package {name}',
                None,
                "a sourced ROS 2 Jazzy installation, or: pip install 'lava_ros[ros]'",
            )
