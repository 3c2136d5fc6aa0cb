"""Files that `phalanx new` writes, with the user's names in place of `template` and `Template`."""
