"""Seeded scenes at rest in six families: an object that leans on supports, and pressing fingers.

Each finger is a chain of one to three hinges with a small ball as its tip, and nothing but the ball
collides. Supports are half-spaces that the object touches exactly.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from itertools import count, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from graspless_pin import Hand, Scene
from graspless_pin.errors import GrasplessPinError
from graspless_pin.geometry import (
    Box,
    Capsule,
    FingerSpec,
    HalfSpace,
    ManipulatedObject,
    Sphere,
    Support,
)
from graspless_pin.geometry.poses import pose_matrix

Array = NDArray[np.float64]
Plane = tuple[Array, Array]
"""A point and the unit normal that points to the object, both in the object's frame."""

TIP = 0.008  # m, radius of a fingertip
_LEAST_MARGIN = 0.1  # N
_TRIES = 40  # places for a fingertip


def slope(rng: np.random.Generator) -> Scene:
    """A box, ball or rod on a slope of up to 35 degrees."""
    shape = _shape(rng, rng.choice(["box", "ball", "rod"]))
    tilt = Rotation.from_rotvec(rng.uniform(0.1, 0.6) * _across(rng, _Z))
    return _scene(rng, "slope", shape, [_below(shape, _Z)], tilt, fingers=(1, 3))


def corner(rng: np.random.Generator) -> Scene:
    """A ball in a corner of floor and two walls, a rod or box on two of these, a little tilted."""
    shape = _shape(rng, rng.choice(["box", "ball", "rod"]))
    ways = [_Z, _X, _Y] if isinstance(shape, Sphere) else [_Z, _Y]
    tilt = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
    return _scene(rng, "corner", shape, [_below(shape, way) for way in ways], tilt, fingers=(1, 2))


def groove(rng: np.random.Generator) -> Scene:
    """A ball or rod in a groove of 60 to 130 degrees."""
    shape = _shape(rng, rng.choice(["ball", "rod"]))
    half = rng.uniform(np.radians(30.0), np.radians(65.0))
    ways = [np.array([0.0, side * np.cos(half), np.sin(half)]) for side in (-1.0, 1.0)]
    tilt = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3))
    return _scene(rng, "groove", shape, [_below(shape, way) for way in ways], tilt, fingers=(1, 2))


def slot(rng: np.random.Generator) -> Scene:
    """A box of 4 to 12 cm between two parallel upright walls, with one to three fingers."""
    shape = _shape(rng, "box")
    planes = [_below(shape, _Y), _below(shape, -_Y)]
    return _scene(rng, "slot", shape, planes, Rotation.identity(), fingers=(1, 3))


def wall_and_table(rng: np.random.Generator) -> Scene:
    """A box or rod that leans against a wall with its foot on a table."""
    shape = _shape(rng, rng.choice(["box", "rod"]))
    lean = Rotation.from_rotvec(rng.uniform(0.3, 1.2) * _X)
    up, away = lean.inv().apply(_Z), lean.inv().apply(_Y)
    return _scene(
        rng, "wall and table", shape, [_below(shape, up), _below(shape, away)], lean, fingers=(1, 3)
    )


def two_fingers(rng: np.random.Generator) -> Scene:
    """A ball, a rod or a box on its edge, on a table between two or three fingers."""
    shape = _shape(rng, rng.choice(["box", "ball", "rod"]))
    lean = Rotation.from_rotvec(rng.uniform(0.2, 1.2) * _X)
    up = lean.inv().apply(_Z)
    return _scene(rng, "two fingers", shape, [_below(shape, up)], lean, fingers=(2, 3))


def room_corner(rng: np.random.Generator) -> Scene:
    """A box in a corner of floor and two walls: twelve contacts, and those of the fingers."""
    shape = _shape(rng, "box")
    tilt = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
    planes = [_below(shape, way) for way in (_Z, _X, _Y)]
    return _scene(rng, "room corner", shape, planes, tilt, fingers=(1, 3))


FAMILIES: dict[str, Callable[[np.random.Generator], Scene]] = {
    "slope": slope,
    "corner": corner,
    "groove": groove,
    "slot": slot,
    "wall and table": wall_and_table,
    "two fingers": two_fingers,
}


def holding_scenes(family: str, number: int, seed: int = 0) -> Iterator[Scene]:
    """Yield so many scenes of a family for which Algorithm 1 finds torques with a margin."""
    return solvable_scenes(FAMILIES[family], [seed, list(FAMILIES).index(family)], number)


def solvable_scenes(
    family: Callable[[np.random.Generator], Scene], seeds: Sequence[int], number: int
) -> Iterator[Scene]:
    """Yield so many scenes of what draws them for which Algorithm 1 finds torques with a margin."""
    found = 0
    for draw in count():
        if found == number:
            return
        scene = family(np.random.default_rng([*seeds, draw]))
        try:
            solution = scene.solve("margin")
        except GrasplessPinError:
            continue  # a fingertip met an edge
        if solution.found and solution.margin > _LEAST_MARGIN:
            found += 1
            yield scene


_X, _Y, _Z = np.eye(3)


def _shape(rng: np.random.Generator, kind: str) -> Box | Sphere | Capsule:
    if kind == "ball":
        return Sphere(rng.uniform(0.02, 0.06))
    if kind == "rod":  # turned along x by `_axes`
        return Capsule(rng.uniform(0.015, 0.03), rng.uniform(0.06, 0.12))
    x, y, z = rng.uniform(0.04, 0.12, 3).tolist()
    return Box((x, y, z))


def _axes(shape: Box | Sphere | Capsule) -> Array:
    """Columns: the shape's own axes in the frame that families think in; a rod lies along x."""
    if isinstance(shape, Capsule):
        return np.column_stack([-_Z, _Y, _X])
    return np.eye(3)


def _below(shape: Box | Sphere | Capsule, normal: Array) -> Plane:
    """The plane with this normal that touches the shape from behind."""
    match shape:
        case Sphere(radius):
            return -radius * normal, normal
        case Capsule(radius, length):
            end = -0.5 * length * np.sign(np.round(normal @ _X, 12)) * _X
            return end - radius * normal, normal
        case Box(size):
            return -0.5 * np.sign(np.round(normal, 12)) * np.array(size), normal


def _surface_point(rng: np.random.Generator, shape: Box | Sphere | Capsule) -> Plane:
    """A random point of the surface with the normal into the shape."""
    match shape:
        case Sphere(radius):
            outward = _direction(rng)
            return radius * outward, -outward
        case Capsule(radius, length):
            outward = _across(rng, _X)
            return rng.uniform(-0.45, 0.45) * length * _X + radius * outward, -outward
        case Box(size):
            axis, side = int(rng.integers(3)), float(rng.choice([-1.0, 1.0]))
            point = rng.uniform(-0.4, 0.4, 3) * size
            point[axis] = 0.5 * side * size[axis]
            return point, -side * np.eye(3)[axis]


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def _across(rng: np.random.Generator, axis: Array) -> Array:
    """A random direction across an axis."""
    vector = np.cross(axis, _direction(rng))
    return vector / np.linalg.norm(vector)


def _scene(
    rng: np.random.Generator,
    name: str,
    shape: Box | Sphere | Capsule,
    planes: Sequence[Plane],
    turn: Rotation,
    fingers: tuple[int, int],
) -> Scene:
    """A scene of planes and fingers that are stated in the object's frame, and turned together."""
    yaw = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi) * _Z)
    T = pose_matrix((0.0, 0.0, 0.3), (yaw * turn).as_matrix())
    wanted = int(rng.integers(fingers[0], fingers[1] + 1))
    tips: list[Plane] = []
    for _ in range(_TRIES):
        point, normal = _surface_point(rng, shape)
        center = point - TIP * normal
        clear = all((center - foot) @ up > 1.5 * TIP for foot, up in planes)
        apart = all(np.linalg.norm(point - other) > 3.0 * TIP for other, _ in tips)
        if clear and apart:
            tips.append((point, normal))
        if len(tips) == wanted:
            break
    supports = tuple(
        Support(f"plane_{index}", HalfSpace(), T @ _plane_pose(*plane))
        for index, plane in enumerate(planes)
    )
    T_shape = np.eye(4)
    T_shape[:3, :3] = _axes(shape)
    return Scene(
        name,
        ManipulatedObject.from_shape("object", shape, T @ T_shape, mass=rng.uniform(0.1, 1.0)),
        {"hand": rng.uniform(0.4, 1.0), "supports": rng.uniform(0.2, 0.8)},
        hand=_hand(rng, [(T[:3, :3] @ p + T[:3, 3], T[:3, :3] @ n) for p, n in tips]),
        supports=supports,
        max_normal_force=20.0,
        solve_options={"algorithm": "margin"},
    )


def _plane_pose(point: Array, normal: Array) -> Array:
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    return np.array(pose_matrix(point, np.column_stack([side, np.cross(normal, side), normal])))


def _hand(rng: np.random.Generator, tips: Sequence[Plane]) -> Hand:
    """Fingers of one to three hinges whose tips press on these points of the world."""
    parts = ['<link name="base"/>']
    fingers: dict[str, FingerSpec] = {}
    for number, (point, normal) in enumerate(tips):
        hinges = int(rng.integers(1, 4))
        ways = [_across(rng, normal) for _ in range(hinges)]
        center = point - TIP * normal
        places = [
            center + rng.uniform(0.03, 0.08) * way - rng.uniform(0.01, 0.05) * normal
            for way in ways
        ]
        before, above = np.zeros(3), "base"
        for index, (here, there) in enumerate(pairwise([*places, center])):
            name = f"finger_{number}_{index}"
            tip = TIP if index == hinges - 1 else None
            parts.append(_hinge(name, above, here - before, np.cross(ways[index], normal)))
            parts.append(_link(name, there - here, rng.uniform(0.02, 0.06), tip))
            before, above = here, name
        fingers[f"finger_{number}"] = FingerSpec(
            tuple(f"finger_{number}_{index}_hinge" for index in range(hinges))
        )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "fingers.urdf"
        file.write_text(f'<robot name="fingers">{"".join(parts)}</robot>', encoding="utf-8")
        return Hand.from_urdf(file, fingers=fingers, control="force")


def _hinge(link: str, above: str, place: Array, axis: Array) -> str:
    return (
        f'<joint name="{link}_hinge" type="revolute"><parent link="{above}"/><child link="{link}"/>'
        f'<origin xyz="{_numbers(place)}"/><axis xyz="{_numbers(axis)}"/>'
        '<limit lower="-1" upper="1" effort="2" velocity="1"/></joint>'
    )


def _link(name: str, along: Array, mass: float, tip: float | None) -> str:
    """A rod as thick as a fingertip to where the next hinge, or the tip, is."""
    moment = mass * (float(along @ along) / 12.0 + TIP**2)
    ball = f'<origin xyz="{_numbers(along)}"/><geometry><sphere radius="{tip}"/></geometry>'
    collision = "" if tip is None else f"<collision>{ball}</collision>"
    return (
        f'<link name="{name}"><inertial><origin xyz="{_numbers(0.5 * along)}"/>'
        f'<mass value="{mass}"/><inertia ixx="{moment}" ixy="0" ixz="0" iyy="{moment}" iyz="0" '
        f'izz="{moment}"/></inertial>{collision}</link>'
    )


def _numbers(vector: Array) -> str:
    return " ".join(map(repr, vector.tolist()))
