"""What researchers do around the system."""
