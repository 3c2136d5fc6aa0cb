"""Run a grid of scenarios with many seeds in processes on one or more machines, into Parquet files."""
