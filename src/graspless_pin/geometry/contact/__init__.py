"""Contact detection, and the motion of bodies at contacts."""
