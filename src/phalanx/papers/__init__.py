"""Reproduction of the papers' figures: measurements go to one CSV per figure, and plots read only that CSV."""
