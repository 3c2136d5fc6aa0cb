"""Tools of researchers around robots: sweeps, scorecards, arenas, buildings by chance, captured missions."""
