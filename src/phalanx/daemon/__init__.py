"""One robot as a process of its own, and a world for such processes."""
