"""A grid of scenarios under many seeds, run by many processes on one machine or many, into Parquet."""
