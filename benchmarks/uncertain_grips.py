"""Grips of what is not known exactly: robust torques and nominal ones, beside MuJoCo.

Members of a set are drawn at random: the scene is changed, the torques stay what they are for the
nominal scene. Each grip is looked at lifted, without the table, and on it.
``python -m benchmarks.uncertain_grips`` goes on where it stopped.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.grip_runs import FINGER_MOVED, MARGIN, NODES, outcome_table, run_of
from benchmarks.real_grips import HANDS, KEPT, kept, objects, place
from graspless_pin import Controller, Holding, Scene, Uncertainty, load_scene
from graspless_pin.algorithms.robust_solution import Coverage
from graspless_pin.algorithms.robust_torques import joint_stiffness
from graspless_pin.algorithms.uncertain_members import nominal_member
from graspless_pin.algorithms.uncertainty import each_of
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Corner, Member
from graspless_pin.scene.scene_stability import scene_of_member, torques_at_rest

OUT = KEPT.with_name("uncertain_grips")
MEMBERS = 10
MASS, CENTER, OF_SIZE, FRICTION, TORQUE, JOINTS = 0.2, 0.01, 0.1, 0.1, 0.02, 2
"""Shares, m, share of the object's extent along each axis that the centre of mass is off at most,
and of how many joints the torque is uncertain: those that are commanded most."""
LEAST_STIFFNESS, TIMES_NEEDED, MOST_DEFLECTION = 5.0, 2.0, 2e-3
"""N m/rad, times what the nominal torques need, and rad by which joints give way at most at the
set's corners: objects that roll go along with them, and count as held up to 0.5 degrees. The
controller has the largest stiffness of the three."""
BORDER = 0.5
"""How many figures of a member are at an end of their interval."""
COULOMB: dict[str, Any] = {"static_friction": "coulomb"}


@dataclass(frozen=True)
class MemberCase:
    """One member of one grip under one vector of torques.

    Attributes:
        grip: Hand, object and rank.
        lifted: Whether the table is taken away.
        member: Its number.
        words: What is different from the scene.
        torques: ``robust`` or ``nominal``.
        coverage: What robust torques are proven for; empty: nominal ones.
        stiffness: Of the controller, N m/rad.
        holding: The verdict on the member; empty: not asked of nominal torques.
        gives_way: How far feedback lets a joint go by the problem, rad; the largest.
        outcome: What the object does in MuJoCo.
        fingers: Largest way of a joint, rad.
        displacement: m.
        rotation: rad.
    """

    grip: str
    lifted: bool
    member: int
    words: str
    torques: str
    coverage: str
    stiffness: float
    holding: str
    gives_way: float
    outcome: str
    fingers: float
    displacement: float
    rotation: float

    @property
    def stays(self) -> bool:
        """Whether object and joints stay."""
        return self.outcome == "held" and self.fingers < FINGER_MOVED

    @property
    def is_claimed(self) -> bool:
        """Whether the set is proven and the verdict says that this member holds."""
        return self.coverage == Coverage.WHOLE_SET and self.holding == Holding.HOLDS

    def __str__(self) -> str:
        """Return it in one line."""
        grip = f"{self.grip}, lifted" if self.lifted else self.grip
        return (
            f"{grip}, {self.torques}, {self.words}: {self.holding}; {self.outcome}, "
            f"{1e3 * self.displacement:.2f} mm, {np.degrees(self.rotation):.2f} deg, joints "
            f"{np.degrees(self.fingers):.2f} deg ({np.degrees(self.gives_way):.2f} by the problem)"
        )


def uncertainty_of(scene: Scene, torques: FloatArray) -> Uncertainty:
    """Return the set of a grip.

    Args:
        scene: The scene.
        torques: (L,) nominal ones, N m (N).
    """
    extent = np.ptp(scene.object.shape.surface().vertices, axis=0)
    errors = np.zeros(len(torques))
    errors[np.argsort(-np.abs(torques), kind="stable")[:JOINTS]] = TORQUE
    center = np.minimum(CENTER, OF_SIZE * extent)
    return Uncertainty(mass=MASS, center_of_mass=center, friction=FRICTION, torque=errors)


def drawn(scene: Scene, unknown: Uncertainty, rng: np.random.Generator) -> tuple[Scene, Member]:
    """Return a scene somewhere in a set, and its problem with what its motors make.

    All contacts of a body have one coefficient.
    """

    def share(count: int) -> FloatArray:
        values = rng.uniform(-1.0, 1.0, count)
        return np.where(rng.random(count) < BORDER, np.sign(values), values)

    problem, bodies = scene.problem(), scene.contacts.bodies
    mass, center = unknown.mass * share(1), unknown.center_of_mass * share(3)
    names = [*dict.fromkeys(bodies)]
    rubs = dict(zip(names, (FRICTION * share(len(names))).tolist(), strict=True))
    friction = problem.friction * [1.0 + rubs[body] for body in bodies]
    joints = problem.joint_count
    factors = 1.0 + each_of("torque", unknown.torque, joints, "joints") * share(joints)
    least = 100.0 * min(rubs.values())
    words = (
        f"mass {100.0 * mass[0]:+.0f} %, centre of mass {np.round(1e3 * center, 1).tolist()} mm, "
        f"friction {least:+.0f} to {100.0 * max(rubs.values()):+.0f} %, torques "
        f"{100.0 * (factors.min() - 1.0):+.1f} to {100.0 * (factors.max() - 1.0):+.1f} %"
    )
    down, none = scene.gravity / np.linalg.norm(scene.gravity), np.zeros(3)
    asked = replace(
        nominal_member(problem.with_changes(friction=friction)),
        factors=factors,
        words=words,
        corner=Corner(float(mass[0]), center, down, none, none, np.zeros(problem.contact_count)),
    )
    changed = scene_of_member(scene, asked)
    return changed, replace(asked, problem=changed.problem())


def cases(path: Path, *, lifted: bool, count: int = MEMBERS) -> Iterator[MemberCase]:
    """Yield what is said of members of a grip's set, and what becomes of them.

    Args:
        path: The grip's scene file.
        lifted: Whether the hand alone holds the object.
        count: How many members.
    """
    scene = load_scene(path)
    if lifted:
        scene = scene.with_changes(supports=())
    nominal = scene.solve("torque", margin=MARGIN, **COULOMB)
    if not nominal.found:
        return
    needed = scene.with_changes(controller=Controller()).stability(
        nominal.torques, node_limit=NODES
    ).stiffness_needed  # fmt: skip
    stiffness = LEAST_STIFFNESS
    if np.isfinite(needed):
        stiffness = max(stiffness, TIMES_NEEDED * needed)
    unknown = uncertainty_of(scene, nominal.torques)
    robust = scene.solve(
        "torque", margin=MARGIN, uncertainty=unknown, feedback=stiffness, **COULOMB
    )
    if robust.found:  # the torques are the same at any stiffness
        stiffness *= max(1.0, robust.largest_deflection / MOST_DEFLECTION)
    scene = scene.with_changes(controller=Controller(stiffness))
    gains = np.array(joint_stiffness(scene.problem(), scene.controller, {}))
    asked = {"nominal": (nominal.torques, "")}
    if robust.found:
        asked["robust"] = robust.torques, str(robust.coverage)
    rng = np.random.default_rng(zlib.crc32(path.stem.encode()))
    for number in range(count):
        changed, member = drawn(scene, unknown, rng)
        for kind, (commanded, coverage) in asked.items():
            made, resting = member.factors * commanded, torques_at_rest(member, commanded, gains)
            said = ""
            if kind == "robust":
                said = str(changed.stability(resting, node_limit=NODES).holding)
            driven = gains > 0.0
            gives = np.abs((resting - made)[driven] / gains[driven]).max(initial=0.0)
            run = run_of(changed, made)
            yield MemberCase(
                path.stem, lifted, number, member.words, kind, coverage, stiffness, said,
                float(gives), run.outcome, run.fingers, run.displacement, run.rotation,
            )  # fmt: skip


def kept_cases(path: Path, *, lifted: bool) -> list[MemberCase]:
    """Return the cases of a grip, from their file where they are known."""
    OUT.mkdir(parents=True, exist_ok=True)
    file = OUT / f"{path.stem}{'.lifted' if lifted else ''}.json"
    return kept(file, MemberCase, lambda: cases(path, lifted=lifted))


def summary(found: Sequence[MemberCase], grips: int) -> str:
    """Return tables of all cases, and each that is not as it is said to be.

    Args:
        found: The cases.
        grips: How many grips they are of, those without torques too.
    """
    by = {"torques": "torques", "coverage": "proven for", "holding": "said"}
    robust = [one for one in found if one.torques == "robust"]
    nominal = {(one.grip, one.member): one for one in found if one.torques == "nominal"}
    claimed = [one for one in robust if one.is_claimed]
    all_claimed = [
        all(one.is_claimed for one in robust if one.grip == grip)
        for grip in dict.fromkeys(one.grip for one in robust)
    ]
    beside = [nominal[one.grip, one.member] for one in claimed]
    served = len(all_claimed)
    return "\n".join(
        [
            outcome_table(found, by, "members"),
            "",
            f"- {served} of {grips} grips have robust torques",
            f"- {sum(all_claimed)} of {grips} are proven and hold in all members that were drawn "
            "(wanted: half)",
            f"- held of members that are proven and hold: {_share(claimed)} (wanted: 98 %); with "
            f"nominal torques {_share(beside)}",
            f"- held of all members: robust torques {_share(robust)}; nominal ones "
            f"{_share([*nominal.values()])}",
            "",
            "Not as said:",
            *(f"- {one}" for one in claimed if not one.stays),
        ]
    )


def _share(found: Sequence[MemberCase]) -> str:
    stay = sum(one.stays for one in found)
    return f"{stay} of {len(found)}" + (f", {100.0 * stay / len(found):.1f} %" if found else "")


def placed(count: int | None) -> list[Path]:
    """Return the scene files of at least so many grips; hands are placed where they are not yet."""
    found = list[Path]()
    for target, hand in product(objects(KEPT), HANDS):
        if count is None or len(found) < count:
            found += place((hand, target))
    return found


def main() -> None:
    """Place, simulate, and print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.uncertain_grips", description=__doc__
    )
    parser.add_argument("--count", type=int, help="grips; default: all")
    given = parser.parse_args()
    # The best place of each pair first: a run that ends early has all hands and objects.
    grips = sorted(placed(given.count), key=lambda path: path.stem[-1])[: given.count]
    lifted, standing = list[MemberCase](), list[MemberCase]()
    for number, path in enumerate(grips, 1):
        lifted += kept_cases(path, lifted=True)
        standing += kept_cases(path, lifted=False)
        print(f"{number} grips, {path.stem}", file=sys.stderr, flush=True)
    print(f"Lifted:\n\n{summary(lifted, len(grips))}\n")
    print(f"On the table:\n\n{summary(standing, len(grips))}")


if __name__ == "__main__":
    main()
