"""The interface of attacks: a record (attack.py), and base classes of compromised robots (liar.py, mission_cheat.py).

The attacks themselves are in `phalanx.attacks`, which imports the simulated worlds; registry.py finds them by name.
"""
