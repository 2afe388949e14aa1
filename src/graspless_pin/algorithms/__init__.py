"""Algorithms 1 and 2 over all feasible virtual-sliding modes."""
