"""The ROS side: the only part of the package that imports rclpy and messages."""
