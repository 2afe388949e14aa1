"""Robot files and their schema, and the description of a robot beyond its URDF."""
