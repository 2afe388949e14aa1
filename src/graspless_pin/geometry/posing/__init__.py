"""Closing fingers, placing fingertips, settling objects."""
