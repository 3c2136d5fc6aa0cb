"""What researchers do around robots: sweeps, scorecards, arenas, buildings by chance, captured missions."""
