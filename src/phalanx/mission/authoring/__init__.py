"""Write missions in YAML or from a floor plan, and compile them."""
