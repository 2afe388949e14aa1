"""A hand mounted elsewhere: what is fixed to the world moves, all else stays as it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]

from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import changed

_ANYWHERE = (
    "joint_index",
    "joint_kinds",
    "tolerated",
    "ranges",
    "locked",
    "link_joints",
    "parent_links",
    "supports",
    "shapes",
    "_starts",
    "moves",
)
"""What is the same wherever the robots are mounted."""


def displaced_tree(tree: KinematicTree, ways: Sequence[FloatArray]) -> KinematicTree:
    """Return a tree with what is fixed to the world moved.

    Args:
        tree: The tree.
        ways: (4, 4) by mounted robot, world axes.
    """
    model, steps = tree.pinocchio_model.copy(), [pin.SE3(np.array(T)) for T in ways]
    way_of = {name: k for k, (names, _) in enumerate(tree.bases) for name in names}
    for joint in range(1, model.njoints):
        if model.parents[joint] == 0:
            way = steps[way_of[model.names[joint]]]
            model.jointPlacements[joint] = way * model.jointPlacements[joint]
    for index in range(1, model.nframes):
        frame = model.frames[index]
        if frame.parentJoint == 0:
            frame.placement = steps[way_of[frame.name]] * frame.placement
    bases = tuple(
        (names, way.act(inertia)) for way, (names, inertia) in zip(steps, tree.bases, strict=True)
    )
    model.inertias[0] = sum((inertia for _, inertia in bases), pin.Inertia.Zero())
    geometries = tuple(
        item
        if item.joint
        else replace(item, T_joint_geometry=ways[way_of[item.link]] @ item.T_joint_geometry)
        for item in tree.geometries
    )
    moved = replace(tree, pinocchio_model=model, geometries=geometries, bases=bases)
    # Asked of the tree that is moved, or each place that it is moved to would work it out.
    return changed(moved, **{name: getattr(tree, name) for name in _ANYWHERE})
