"""Shapes, meshes, the object, supports and materials."""
