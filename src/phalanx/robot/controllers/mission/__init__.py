"""A robot on an encoded mission, as a controller that peers replay without its keys and its map."""
