"""Pictures of a scene and its solution as triangle meshes, without a drawing library."""

from graspless_pin.visualization.drawing import draw_scene
from graspless_pin.visualization.picture import DARK, LIGHT, Mesh, Palette, Picture, Role

__all__ = ["DARK", "LIGHT", "Mesh", "Palette", "Picture", "Role", "draw_scene"]
