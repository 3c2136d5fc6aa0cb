"""Attacks on missions: an honest robot, and a world or a courier that lies to it; or one that lies to its peers."""
