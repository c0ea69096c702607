"""Robots that speak ROS 2 over Zenoh, and the link that commands them."""
