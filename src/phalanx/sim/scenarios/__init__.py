"""What is run: scenario files, seeded runs of them, recordings."""
