"""Robots with sensors and motors on ROS 2 topics. Modules that import graph.py need the extra `ros2`."""
