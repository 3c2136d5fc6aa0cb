"""Controller of a robot on an encoded mission, which auditors replay without its keys and its map."""
