"""Where a robot believes to be, and how sure it is: an extended Kalman filter over landmarks and odometry."""
