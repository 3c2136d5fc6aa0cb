"""Real-time world with bodies and a radio, for robots that run as processes."""
