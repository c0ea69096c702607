"""Robots that speak ROS 2 as rclpy nodes, and the link that commands them."""
