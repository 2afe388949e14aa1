"""What a scene and its solution look like, as triangle meshes: no drawing library is needed."""

from graspless_pin.visualization.drawing import draw_scene
from graspless_pin.visualization.picture import DARK, LIGHT, Mesh, Palette, Picture, Role

__all__ = ["DARK", "LIGHT", "Mesh", "Palette", "Picture", "Role", "draw_scene"]
