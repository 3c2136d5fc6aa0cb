"""From an operator's words, or a floor plan, to an encoded mission."""
