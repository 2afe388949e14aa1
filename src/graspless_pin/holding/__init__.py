"""What really happens under given torques: rigid-body dynamics with Coulomb's law."""
