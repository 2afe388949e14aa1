"""Draw members of uncertain sets, and ask a linear program of its own whether each balances.

``make uncertain``: 10 000 members of each of seven sets (two with balls) in 30 scenes:
examples, grips that were found by placing, and random problems of arrays. Of each set of a scene
some members are scenes that are changed themselves: their object's mass and centre of mass,
gravity's direction, loads and friction, with contacts and matrices made anew. The others' loads are
worked out by hand, which is held against these. The program shares no code with the package: forces
are combinations of cone edges. Where friction is known, edges that balanced one member are tried
for all others.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linprog, nnls
from scipy.spatial.transform import Rotation
from tests.core.random_scenes import general_scene, slope_scene

from graspless_pin import QuasistaticProblem, Scene, Uncertainty, load_scene, minimize_torque
from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import Load

FILES = Path(__file__).resolve().parents[2]
SCENES = tuple(f"examples/{name}" for name in (
    "paper/cuboid_at_rest", "paper/cuboid_sliding_up", "paper/sphere_on_slope",
    "allegro_mug_against_wall", "allegro_box_on_slope", "allegro_sphere_on_slope",
    "allegro_push_up_slope", "two_hands_slide_crate", "box_between_walls", "panda_carry_bar",
    "panda_slide_cuboid_up_slope", "panda_arm_drag_board", "paper/cuboid_sliding_down",
    "trihand_push_box",
)) + tuple(f"tests/simulation/grips/{name}" for name in (
    "allegro_left_ball_0", "allegro_left_box_1", "allegro_right_ball_0", "dex3_left_ball_0",
    "dex3_right_capsule_3", "panda_hand_box_0", "psyonic_left_ball_0", "talos_gripper_box_0",
    "trihand_ball_0", "trihand_box_0",
))  # fmt: skip
RANDOM = (
    (slope_scene, 1, 4), (slope_scene, 5, 5), (slope_scene, 7, 4),
    (general_scene, 1, 4), (general_scene, 3, 3), (general_scene, 5, 5),
)  # fmt: skip
"""Problems of arrays: what makes them, and of which seed and number of contacts."""
SETS: dict[str, dict[str, Any]] = {
    "mass and centre of mass": {"mass": 0.2, "center_of_mass": 0.01},
    "mass, centre and push": {"mass": 0.1, "center_of_mass": 0.004, "force": 0.1},
    "tilt and friction": {"tilt": 0.03, "friction": 0.1},
    "friction and mass": {"friction": 0.15, "mass": 0.1},
    "push and moment": {"force": (0.2, 0.1, 0.1), "moment": 0.003},
    "any push": {"force_radius": 0.15},
    "any direction": {"mass": 0.1, "center_of_mass_radius": 0.004, "force_radius": 0.1},
}
BALANCED = 1e-6
"""Of the load: what forces may leave unbalanced."""
MARGIN = 0.02  # N
NONE = 1e-6
"""N m: smaller torques are none."""
AS_SCENES = 10
"""Members of each case that are scenes, too."""


@dataclass(eq=False)
class Balance:
    """Whether combinations of cone edges balance a load and torques, for one set of contacts.

    Attributes:
        problem: One with these contacts.
        added: (L, d) torques that may be added in any amount; None: there are none.
    """

    problem: QuasistaticProblem
    added: FloatArray | None = None

    def __post_init__(self) -> None:
        """Take the edges apart: what they are without friction, and what a unit of it adds."""
        made, edges = self.problem, []
        for number in range(made.contact_count):
            n, v, (t1, t2) = made.normals[number], made.sliding[number], made.tangents[number].T
            if np.linalg.norm(v) > 0.0:
                found = [-v / np.linalg.norm(v)]
            elif made.friction[number] == 0.0:
                found = [np.zeros(3)]
            else:
                angles = 2.0 * np.pi * np.arange(made.cone_edges) / made.cone_edges
                found = [np.cos(a) * t1 + np.sin(a) * t2 for a in angles]
            edges += [(number, n, one) for one in found]
        self.places = np.array([place for place, _, _ in edges])
        self.loaded = made.jacobian.any(axis=0)
        self.rows, self.by_friction = (
            np.array([self._row(one[0], one[which]) for one in edges]).T for which in (1, 2)
        )
        self.length = float(np.ptp(made.positions, axis=0).max())
        self.free = np.zeros((len(self.rows), 0))
        if self.added is not None:
            self.free = np.vstack([np.zeros((6, self.added.shape[1])), -self.added[self.loaded]])

    def _row(self, place: int, force: FloatArray) -> FloatArray:
        arm = self.problem.jacobian[3 * place : 3 * place + 3]
        moment = np.cross(self.problem.positions[place], force)
        return np.concatenate([force, moment, (arm.T @ force)[self.loaded]])

    def offs(self, friction: FloatArray, wrenches: FloatArray, torques: FloatArray) -> FloatArray:
        """Return `off` of many members of the same friction, from few edges at a time.

        Args:
            friction: (M,) coefficients.
            wrenches: (K, 6).
            torques: (K, L).
        """
        off, left = np.zeros(len(wrenches)), np.arange(len(wrenches))
        A = np.hstack([self.rows + self.by_friction * friction[self.places], self.free])
        b = np.hstack([-wrenches, torques[:, self.loaded]])
        sizes = np.array([self._sizes(wrench) for wrench in wrenches])
        while len(left):
            first, left = left[0], left[1:]
            off[first] = self.off(friction, wrenches[first], torques[first])
            used, edges = self.used, self.used < len(self.places)
            if not len(used) or not len(left):
                continue
            x = b[left] @ np.linalg.pinv(A[:, used]).T
            misses = np.abs((x @ A[:, used].T - b[left]) / sizes[left]).max(axis=1)
            pressed = np.zeros((len(left), self.problem.contact_count))
            np.add.at(pressed.T, self.places[used[edges]], x[:, edges].T)
            fits = (x[:, edges] >= 0.0).all(axis=1) & (misses <= BALANCED)
            fits &= (pressed <= self.problem.max_normal_force).all(axis=1)
            off[left[fits]] = misses[fits]
            left = left[~fits]
        return off

    def _sizes(self, wrench: FloatArray) -> FloatArray:
        """Return what a unit of imbalance is in each row."""
        force, joints = float(np.linalg.norm(wrench[:3])), int(self.loaded.sum())
        return np.concatenate([np.full(3, force), np.full(3 + joints, force * self.length)])

    def off(self, friction: FloatArray, wrench: FloatArray, torques: FloatArray) -> float:
        """Return how much stays unbalanced at best, over the load.

        The edges and added torques that balance it are `used` then.

        Args:
            friction: (M,) coefficients.
            wrench: (6,) of the load, about the problem's reference point.
            torques: (L,) that contacts have to bear.
        """
        sizes = self._sizes(wrench)
        A = (self.rows + self.by_friction * friction[self.places]) / sizes[:, None]
        free = self.free / sizes[:, None]
        b = np.concatenate([-wrench, torques[self.loaded]]) / sizes
        most = self.problem.max_normal_force
        self.used = np.zeros(0, dtype=int)
        # Least squares without limits of normal forces first: mostly they are kept all the same.
        x, _ = nnls(np.hstack([A, free, -free]), b)
        shares = x[len(self.places) + free.shape[1] :]
        left = np.hstack([A, free]) @ x[: len(x) - free.shape[1]] - free @ shares - b
        pressed = np.bincount(self.places, x[: len(self.places)], minlength=len(most))
        if np.abs(left).max() <= BALANCED and (pressed <= most).all():
            edges = np.flatnonzero(x[: len(self.places)])
            self.used = np.append(edges, len(self.places) + np.arange(free.shape[1]))
            return float(np.abs(left).max())
        return self._least(np.hstack([A, free]), b)

    def _least(self, A: FloatArray, b: FloatArray) -> float:
        """Return the same by a linear program, within limits of normal forces."""
        ones, count = np.ones((len(b), 1)), len(self.places)
        limits = self.problem.max_normal_force
        most = np.zeros((len(limits), A.shape[1] + 1))
        most[self.places, np.arange(count)] = 1.0
        answer = linprog(
            np.eye(A.shape[1] + 1)[-1],
            A_ub=np.vstack([np.hstack([A, -ones]), np.hstack([-A, -ones]), most]),
            b_ub=np.concatenate([b, -b, limits]),
            bounds=[(0, None)] * count + [(None, None)] * (A.shape[1] - count) + [(0, None)],
            method="highs",
        )
        assert answer.status == 0
        return float(answer.fun)


def imbalance(
    problem: QuasistaticProblem, torques: FloatArray, added: FloatArray | None = None
) -> float:
    """Return how much of a problem's load stays unbalanced at best under torques, over the load."""
    borne = torques - problem.gravity_torques
    return Balance(problem, added).off(problem.friction, problem.external_wrench, borne)


def yielding(problem: QuasistaticProblem) -> FloatArray:
    """Return (L, d) joint rates of motions in which no contact parts or slips against friction."""
    rows = []
    for number in range(problem.contact_count):
        x, y, z = problem.positions[number]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        J = problem.jacobian[3 * number : 3 * number + 3]
        relative = np.hstack([np.eye(3), -cross, -J])
        slides = problem.sliding[number].any() or problem.friction[number] == 0.0
        rows += [problem.normals[number][None] @ relative] if slides else [relative]
    _, sizes, motions = np.linalg.svd(np.vstack(rows))
    rank = int((sizes > 1e-9 * sizes[0]).sum())
    return motions[rank:, 6:].T


@dataclass(eq=False)
class Drawn:
    """Somewhere in a set.

    Attributes:
        mass: Share of the nominal one.
        off: (3,) m of the centre of mass, in the object's axes.
        gravity: (3,) m/s^2.
        push: (3,) N on the nominal centre of mass.
        moment: (3,) N m.
        friction: (M,) shares of the nominal ones.
    """

    mass: float
    off: FloatArray
    gravity: FloatArray
    push: FloatArray
    moment: FloatArray
    friction: FloatArray

    def scene(self, nominal: Scene) -> Scene:
        """Return the changed scene: contacts and matrices are made anew."""
        made = nominal.object
        pushed = Load("drawn", self.push, self.moment, at=made.center_of_mass)
        loads = [*nominal.loads, pushed]
        return nominal.with_changes(
            object=replace(
                made,
                mass=self.mass * made.mass,
                center_of_mass=made.center_of_mass + self.off,
                inertia=np.eye(3) * 1e-3,
            ),
            gravity=self.gravity,
            loads=loads if self.push.any() or self.moment.any() else nominal.loads,
        )

    def problem(self, nominal: Scene) -> QuasistaticProblem:
        """Return the problem of the changed scene."""
        problem = self.scene(nominal).problem()
        return problem.with_changes(friction=self.friction * problem.friction)


def drawn(
    gravity: FloatArray,
    contacts: int,
    given: dict[str, Any],
    rng: np.random.Generator,
    edge: float = 0.3,
) -> Drawn:
    """Return a member somewhere in a set, or with ``edge`` 1 often on its border."""

    def share(size: int) -> FloatArray:
        values = rng.uniform(-1.0, 1.0, size)
        return np.where(rng.random(size) < edge, np.sign(values), values)

    def three(name: str) -> FloatArray:
        if name not in given:
            return np.zeros(3)
        return np.broadcast_to(given.get(name, 0.0), 3) * share(3)

    def with_ball(name: str) -> FloatArray:
        """Return a figure along axes, with one in any direction beside it."""
        radius, along = given.get(f"{name}_radius", 0.0), three(name)
        if radius == 0.0:
            return along
        way = rng.normal(size=3)
        return along + radius * abs(float(share(1)[0])) * way / np.linalg.norm(way)

    off, mass = with_ball("center_of_mass"), 1.0 + given.get("mass", 0.0) * float(share(1)[0])
    if "tilt" in given:
        across = np.cross(gravity, rng.normal(size=3))
        tilt = given["tilt"] * abs(float(share(1)[0]))
        turn = Rotation.from_rotvec(tilt * across / np.linalg.norm(across))
        gravity = np.asarray(turn.apply(gravity.copy()))
    friction = 1.0 + given.get("friction", 0.0) * rng.uniform(-1.0, 1.0, contacts)
    return Drawn(mass, off, gravity, with_ball("force"), with_ball("moment"), friction)


@dataclass(eq=False)
class Members:
    """The loads of a scene's members, by hand: contacts stay where they are.

    Attributes:
        scene: The nominal one, whose loads do not turn with gravity.
    """

    scene: Scene

    def __post_init__(self) -> None:
        """Keep what all members share."""
        self.problem = self.scene.problem()
        made, gravity = self.scene.object, self.scene.gravity
        self.other = self.problem.external_wrench.copy()
        self.other[:3] -= made.mass * gravity
        self.axes = made.T_world_object[:3, :3]
        self.links = np.array(
            [self.scene.with_changes(gravity=axis).problem().gravity_torques for axis in np.eye(3)]
        ).T

    def load(self, one: Drawn) -> tuple[FloatArray, FloatArray]:
        """Return the wrench about the nominal centre of mass, and what carries the links."""
        force = one.mass * self.scene.object.mass * one.gravity
        moment = np.cross(self.axes @ one.off, force) + one.moment
        return self.other + np.concatenate([force + one.push, moment]), self.links @ one.gravity

    def differs(self, one: Drawn) -> float:
        """Return by how much that is off what a changed scene makes of it, N and N m."""
        made, (wrench, carried) = one.problem(self.scene), self.load(one)
        back = made.external_wrench.copy()
        back[3:] += np.cross(self.axes @ one.off, back[:3])
        return float(np.abs(np.append(back - wrench, made.gravity_torques - carried)).max())


@dataclass(eq=False)
class MembersOfArrays:
    """The same of a problem of arrays: all of its wrench's force is weight.

    Attributes:
        problem: The nominal one.
    """

    problem: QuasistaticProblem

    def __post_init__(self) -> None:
        """Take the wrench for a weight off the reference point, and a moment along it."""
        self.weight, moment = self.problem.external_wrench[:3], self.problem.external_wrench[3:]
        self.lever = np.cross(self.weight, moment) / (self.weight @ self.weight)
        self.rest = moment - np.cross(self.lever, self.weight)

    def load(self, one: Drawn) -> tuple[FloatArray, FloatArray]:
        """Return the wrench about the reference point, and what carries the links."""
        force = one.mass * one.gravity
        moment = np.cross(self.lever + one.off, force) + self.rest + one.moment
        return np.concatenate([force + one.push, moment]), self.problem.gravity_torques


def unbalanced(
    nominal: Scene | QuasistaticProblem,
    given: dict[str, Any],
    found: RobustSolution,
    count: int,
    seed: int,
    added: FloatArray | None = None,
) -> FloatArray:
    """Return the imbalance of members under robust torques; a few are made as scenes, too."""
    rng = np.random.default_rng(seed)
    if isinstance(nominal, Scene):
        members, gravity = Members(nominal), nominal.gravity
    else:
        members = MembersOfArrays(nominal)
        gravity = members.weight
    problem, torques = members.problem, found.torques
    balance = Balance(problem, added)
    ones = [drawn(gravity, problem.contact_count, given, rng) for _ in range(count)]
    if isinstance(members, Members):
        assert max(map(members.differs, ones[:AS_SCENES])) < 1e-9
    loads = [members.load(one) for one in ones]
    wrenches, borne = (np.array(part) for part in zip(*loads, strict=True))
    borne = torques - borne
    if "friction" not in given:
        return balance.offs(problem.friction, wrenches, borne)
    off = [
        balance.off(one.friction * problem.friction, *load)
        for one, *load in zip(ones, wrenches, borne, strict=True)
    ]
    return np.array(off)


def nominals() -> Iterator[tuple[str, Scene | QuasistaticProblem]]:
    """Yield the 30 scenes with their names."""
    for name in SCENES:
        yield name.split("/", 1)[1], load_scene(FILES / f"{name}.yaml")
    for make, seed, contacts in RANDOM:
        yield f"{make.__name__} {seed} of {contacts} contacts", make(seed, contacts)


def solved(
    nominal: Scene | QuasistaticProblem, given: dict[str, Any], feedback: float | None
) -> RobustSolution:
    """Return the least torques for a set, plain Coulomb friction."""
    options: dict[str, Any] = {
        "uncertainty": Uncertainty(**given), "feedback": feedback, "static_friction": "coulomb"
    }  # fmt: skip
    if isinstance(nominal, Scene):
        return nominal.solve("torque", margin=MARGIN, **options)
    return minimize_torque(nominal, MARGIN, **options)


def main() -> int:
    """Print a row for each set; exit with 1 where a member of a proven one does not balance."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    options = parser.parse_args()
    asked, wrong = dict.fromkeys(("constant", "feedback", "none"), 0), 0
    for name, nominal in nominals():
        problem = nominal.problem() if isinstance(nominal, Scene) else nominal
        for told, given in SETS.items():
            if "tilt" in given and nominal is problem and problem.gravity_torques.any():
                continue  # arrays do not tell what the links' weight does
            found, how, added = solved(nominal, given, None), "constant", None
            if not found.found:
                found, how, added = solved(nominal, given, 1.0), "feedback", yielding(problem)
            asked[how if found.found else "none"] += 1
            if not found.found:
                print(f"{name}, {told}: none, with feedback either", flush=True)
                continue
            off = unbalanced(nominal, given, found, options.count, 1, added)
            bad = int((off > BALANCED).sum())
            gap = (found.max_torque - found.bound) / max(found.max_torque, NONE)
            print(
                f"{name}, {told}: {bad} of {len(off)} unbalanced, {how}, {found.coverage}, "
                f"nothing is better by more than {abs(gap):.2%}",
                flush=True,
            )
            wrong += bad if found.coverage is Coverage.WHOLE_SET else 0
    print(f"{wrong} unbalanced; sets with torques: {asked}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
