"""A mug with a handle, the non-convex mesh of these tests, and how to place bodies."""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import trimesh

from graspless_pin.geometry.bodies.shapes import MeshShape

SIDES = 12
RADIUS = 0.04
WALL = 0.006
HEIGHT = 0.1
BOTTOM = 0.008
HANDLE = 0.076  # outermost x of the handle, whose opening is x = 0.042 to 0.064, z = +-0.024


def mug() -> trimesh.Trimesh:
    """A mug of flat sides about the middle of its height, with corners at the angle zero."""
    outer = trimesh.creation.cylinder(RADIUS, HEIGHT, sections=SIDES)
    hollow = trimesh.creation.cylinder(RADIUS - WALL, HEIGHT, sections=SIDES)
    hollow.apply_translation([0.0, 0.0, BOTTOM])
    frame = trimesh.creation.box([0.046, 0.012, 0.072])
    opening = trimesh.creation.box([0.022, 0.02, 0.048])
    handle = trimesh.boolean.difference([frame, opening])
    handle.apply_translation([0.053, 0.0, 0.0])
    full = trimesh.boolean.union([outer, handle])
    return trimesh.boolean.difference([full, hollow])


def write_mug(folder: Path, suffix: str = "ply") -> Path:
    path = folder / f"mug.{suffix}"
    mug().export(path)
    return path


@contextmanager
def cut_mug(factory: pytest.TempPathFactory) -> Iterator[MeshShape]:
    """The mug in convex pieces, cut once for all modules and workers of a test run."""
    shared = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(shared))
        yield MeshShape(write_mug(factory.mktemp("mug")), convex="decompose", concavity=0.05)


def rim() -> np.ndarray:
    """Corners (SIDES, 3) of the mug's base."""
    turns = 2.0 * math.pi * np.arange(SIDES) / SIDES
    return np.column_stack(
        [RADIUS * np.cos(turns), RADIUS * np.sin(turns), np.full(SIDES, -0.5 * HEIGHT)]
    )
