"""The interface that attacks implement: a record (attack.py), and a robot that lies (liar.py, mission_cheat.py).

The attacks themselves are in `phalanx.attacks`, above the world that they are tried in; registry.py finds them by name.
"""
