"""Estimate a robot's pose and covariance: an extended Kalman filter over landmarks and odometry."""
