"""The uses of robots beside flocking that RoboRebound names, a file each: whatever declares itself here has a name."""
