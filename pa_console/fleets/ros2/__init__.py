"""Robots that speak ROS 2, by rclpy, the client library of an installed ROS 2."""
