"""Robots that speak ROS 2, over Zenoh; needs `pip install 'pa-console[ros2]'`."""
