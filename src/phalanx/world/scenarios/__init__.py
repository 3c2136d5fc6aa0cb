"""Seeded runs of scenarios: advanced, recorded, shown as lines for a page, summed up as arrays."""
