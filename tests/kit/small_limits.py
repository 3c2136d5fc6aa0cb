"""Limits of trusted nodes that are met in a few calls."""

from __future__ import annotations

from phalanx.bti.nodes import Limits

# Small enough that every limit is met in a few calls.
LIMITS = Limits(
    f_max=1,
    t_val_ms=300,
    batch_size=3,
    bucket_capacity=3,
    bucket_period_ms=40,
    send_us_per_s=2000,
    send_capacity_us=3000,
    audit_us_per_s=3000,
    audit_capacity_us=3500,
    airtime_fixed_us=50,
    airtime_ns_per_byte_broadcast=1333,
    airtime_ns_per_byte_unicast=300,
)
