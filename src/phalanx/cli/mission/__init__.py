"""Commands of `phalanx mission`, imported when they run."""
