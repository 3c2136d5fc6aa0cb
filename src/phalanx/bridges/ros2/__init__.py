"""A robot whose sensors and motors are topics of ROS 2; only what imports node.py needs the extra `ros2`."""
