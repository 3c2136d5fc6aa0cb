"""Plots of the papers' figures, each drawn from its CSV alone."""
