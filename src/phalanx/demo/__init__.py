"""The robots that `phalanx up` shows: simulated ones, ready to run, whatever has to be compiled for them."""
