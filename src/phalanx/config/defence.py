"""Names of the defences of robots against compromised robots among them."""

from __future__ import annotations

from typing import Literal, get_args

# none: no trusted nodes; paper: RoboRebound as printed; hardened: RoboRebound with the limits of docs/spec/rebound.md.
Defence = Literal["none", "paper", "hardened"]
DEFENCES: tuple[Defence, ...] = get_args(Defence)
