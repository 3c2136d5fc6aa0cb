"""Files that `phalanx new` writes, with the user's names in the place of `template` and `Template`."""
