"""Robots over ROS 2, with rclpy, the client library of an installed ROS 2."""
