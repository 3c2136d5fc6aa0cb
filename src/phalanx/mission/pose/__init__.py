"""Pose estimation: an extended Kalman filter over landmarks and odometry."""
