"""A LiteGrip gripper in ROS 2, through its daemon; see docs/ros2.md.

`joints`, `orders` and `diagnosis` are pure; `driver` talks to the daemon, on asyncio, and knows no
ROS; only `node` imports rclpy.
"""
