"""The simulated robots that `phalanx up` shows."""
