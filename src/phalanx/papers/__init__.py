"""One file per figure: what was measured goes to a CSV, and the figure is drawn from the CSV alone."""
