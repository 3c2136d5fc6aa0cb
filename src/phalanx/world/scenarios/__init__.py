"""Seeded runs of scenarios: advance, record, stream to a page, and summarise as arrays."""
