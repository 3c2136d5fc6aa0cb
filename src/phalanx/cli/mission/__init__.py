"""What `phalanx mission` does, once it is asked to."""
