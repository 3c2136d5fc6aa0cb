"""Name the defences: how robots respond to compromised robots among them."""

from __future__ import annotations

from typing import Literal, get_args

# Nothing; RoboRebound as printed; RoboRebound as docs/spec/rebound.md bounds it.
Defence = Literal["none", "paper", "hardened"]
DEFENCES: tuple[Defence, ...] = get_args(Defence)
