"""Try whole scenes of packages that install by name: their files are read, their code is not.

`make hands` runs it after `package_hands`, whose packages it takes. The object falls in MuJoCo for
a moment. In the state that comes out, each body that touches the object in MuJoCo has to touch it
in the scene, and the scene has to come back from its own MJCF with the same margin.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.errors import GrasplessPinError, GrasplessPinWarning
from graspless_pin.interfaces.mujoco import scene_from_mjcf, scene_to_mjcf
from graspless_pin.simulation.protocol import load_mujoco

ASSETS = "gymnasium_robotics/envs/assets"
SCENES = {
    "Shadow and block": (f"{ASSETS}/hand/manipulate_block.xml", "object", 0.6),
    "Shadow and pen": (f"{ASSETS}/hand/manipulate_pen.xml", "object", 0.6),
    "Adroit and ball": (f"{ASSETS}/adroit_hand/adroit_relocate.xml", "Object", 0.4),
    "Adroit and hammer": (f"{ASSETS}/adroit_hand/adroit_hammer.xml", "Object", 0.4),
    "Adroit and pen": (f"{ASSETS}/adroit_hand/adroit_pen.xml", "Object", 0.6),
}
"""File, object and seconds that it falls."""


class Seen(NamedTuple):
    """What one scene showed.

    Attributes:
        touching: Bodies that touch the object in MuJoCo.
        missed: Those of them that do not in the scene.
        margin: Of the scene, N; NaN: no forces hold the object.
        apart: Difference of the margin that comes back, N.
    """

    touching: list[str]
    missed: list[str]
    margin: float
    apart: float


def check_scene(path: Path, name: str, seconds: float) -> Seen:
    """Hold one scene against MuJoCo."""
    mujoco = load_mujoco()
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    while data.time < seconds:
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrasplessPinWarning)
        scene = scene_from_mjcf(path, data, object_body=name)
        scene = scene.with_changes(max_penetration=0.02)  # their contacts are soft
        back = scene_from_mjcf(mujoco.MjModel.from_xml_string(scene_to_mjcf(scene)))
    touching = sorted(_touching(model, data, name, scene.contact_tolerance))
    missed = [body for body in touching if body not in scene.contacts.bodies]
    margin, again = scene.solve().margin, back.solve().margin
    apart = 0.0 if np.isnan([margin, again]).all() else abs(margin - again)
    return Seen(touching, missed, margin, apart)


def _touching(model: Any, data: Any, name: str, tolerance: float) -> set[str]:
    """Return the bodies, or geoms of the world, that MuJoCo has in contact with the object."""
    own = model.body(name).id
    found = set()
    for contact in data.contact:
        geoms = sorted(contact.geom.tolist(), key=lambda geom: model.geom_bodyid[geom] == own)
        bodies = [int(model.geom_bodyid[geom]) for geom in geoms]
        if bodies[1] == own and contact.dist < 0.9 * tolerance:
            found.add(model.body(bodies[0]).name if bodies[0] else model.geom(geoms[0]).name)
    return found


def main() -> None:
    """Check all scenes of a folder of packages; exit code 1 where one disagrees or is missing."""
    folder, wrong = Path(sys.argv[1]), 0
    for name, (inside, body, seconds) in SCENES.items():
        try:
            seen = check_scene(folder / inside, body, seconds)
        except (GrasplessPinError, ValueError) as error:
            wrong += 1
            print(f"{name}: {error}")
            continue
        wrong += bool(seen.missed) or not seen.apart < 1e-6
        missed = f", missed {', '.join(seen.missed)}" if seen.missed else ""
        print(
            f"{name}: {', '.join(seen.touching)} touch{missed}; margin {seen.margin:.4f} N, back "
            f"to {seen.apart:.0e} N"
        )
    print(f"{len(SCENES)} scenes, {wrong} of them wrong")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
