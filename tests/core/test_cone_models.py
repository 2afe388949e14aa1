"""Cone models of a user's own: optima, gradients, documents, and what refuses them."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from tests.core.random_scenes import general_scene, slope_scene
from tests.verify.own_objectives import Helped, SquaredShares

from graspless_pin import (
    QuasistaticProblem,
    compare_rules,
    contact_force_bounds,
    guaranteed_disturbance,
    maximize_margin,
    minimize_torque,
    optimize,
    optimum_gradients,
    robustness,
    stability,
    tolerances,
    what_would_hold,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.verdict import Stability
from graspless_pin.plots.solutions import section_corners
from graspless_pin.problem.cone_model import ConeModel, Section
from graspless_pin.problem.cones import CONE_MODELS, Pyramid
from graspless_pin.report import read_solution, solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.solution import Status
from graspless_pin.solution.tables import contact_states, friction_use

CORNERS = np.array([[0.9, -0.1], [0.5, 0.6], [-0.2, 0.7], [-0.6, 0.1], [-0.3, -0.5], [0.2, -0.4]])
"""Of a polygon without any symmetry."""


class Uneven(ConeModel):
    """Another friction in every direction; what slides is not told."""

    name, about = "uneven", "a polygon without symmetry"

    def corners(self, edges):
        return CORNERS


class Elliptic(ConeModel):
    """Half of the friction along t1."""

    name, about = "elliptic", "pyramids inside elliptic cones"
    shares = np.array([0.5, 1.0])

    def corners(self, edges):
        angles = 2.0 * np.pi * np.arange(edges) / edges
        return self.shares * np.column_stack([np.cos(angles), np.sin(angles)])

    def kinetic_friction(self, directions):
        scaled = self.shares * directions
        return -self.shares * scaled / np.linalg.norm(scaled, axis=1, keepdims=True)


class Same(ConeModel):
    """The paper's pyramids by another name, without a word more."""

    name, about, is_coulomb = "same", "the paper's pyramids", True

    def corners(self, edges):
        return Pyramid().corners(edges)


@pytest.fixture(autouse=True)
def _listed(monkeypatch):
    for model in (Uneven(), Elliptic(), Same()):
        monkeypatch.setitem(CONE_MODELS, model.name, model)


def scene(number: int, cone: str) -> QuasistaticProblem:
    family = general_scene if number % 2 else slope_scene
    return family(number, 3 + number % 4).with_changes(cone=cone, sliding=None)


def sliding_scene(number: int, cone: str) -> QuasistaticProblem:
    """Two of the contacts slide, each in a direction of its own; forces that balance are known."""
    problem = general_scene(number, 5)
    rng = np.random.default_rng(number)
    ways = rng.normal(size=(2, 2))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    T, mu, normal = problem.tangents[:2], problem.friction[:2], rng.uniform(1.0, 3.0, 5)
    kinetic = Elliptic().kinetic_friction(ways) if cone == "elliptic" else -ways
    forces = normal[:, None] * problem.normals
    forces[:2] += np.einsum("mij,mj->mi", T, (mu * normal[:2])[:, None] * kinetic)
    need = np.abs(problem.J.T @ forces.ravel() + problem.gravity_torques)
    sliding = np.zeros((5, 3))
    sliding[:2] = np.einsum("mij,mj->mi", T, 0.1 * ways)
    return problem.with_changes(
        cone=cone,
        sliding=sliding,
        external_wrench=-problem.W @ forces.ravel(),
        torque_limits=(-1.2 * need - 0.01, 1.2 * need + 0.01),
        max_normal_force=5.0,
    )


def hull_rows(problem: QuasistaticProblem) -> list[np.ndarray]:
    """By contact (r, 3) unit outward normals of the faces, world axes, by scipy's hull."""
    rows = []
    for contact, mu in enumerate(problem.friction):
        hull = ConvexHull(mu * CONE_MODELS[problem.cone].corners(problem.cone_edges))
        normals = np.column_stack([hull.equations[:, 2], hull.equations[:, :2]])
        frame = np.column_stack([problem.normals[contact], problem.tangents[contact]])
        rows.append((normals / np.linalg.norm(normals, axis=1, keepdims=True)) @ frame.T)
    return rows


def optimum_of_model(problem: QuasistaticProblem, *, margin: bool) -> float | None:
    """The largest margin, or the least torque without one; None: nothing is feasible.

    All contacts have a cone. The variables are the forces and e or t.
    """
    M, torque, gravity = problem.contact_count, problem.J.T, problem.gravity_torques
    faces = np.asarray(block_diag(*hull_rows(problem)))
    normal = block_diag(*problem.normals[:, None])
    # Each part: its rows on the forces, the column of e or t, and its right side.
    parts = [
        (faces, margin, np.zeros(len(faces))), (-normal, margin, np.zeros(M)),
        (normal, margin, problem.max_normal_force),
        (torque, 0.0, problem.upper_torque - gravity),
        (-torque, 0.0, gravity - problem.lower_torque),
    ]  # fmt: skip
    if not margin:
        parts += [(torque, -1.0, -gravity), (-torque, -1.0, gravity)]
    rows = np.vstack([np.column_stack([own, np.full(len(own), last)]) for own, last, _ in parts])
    sides = np.concatenate([side for _, _, side in parts])
    cost = np.zeros(3 * M + 1)
    cost[-1] = -1.0 if margin else 1.0
    bounds = [(None, None)] * (3 * M) + [(0.0, None)]
    balance = np.hstack([problem.W, np.zeros((6, 1))])
    found = linprog(cost, rows, sides, balance, -problem.external_wrench, bounds)
    assert found.status in (0, 2)
    return float(cost[-1] * found.fun) if found.status == 0 else None


@pytest.mark.sampled(5)
@pytest.mark.parametrize("cone", ["uneven", "elliptic"])
@pytest.mark.parametrize("number", range(8))
def test_optima_are_those_of_a_linear_program(number, cone):
    problem = scene(number, cone)
    for solution, margin in (
        (maximize_margin(problem, static_friction="coulomb"), True),
        (minimize_torque(problem, 0.0, static_friction="coulomb"), False),
    ):
        model = optimum_of_model(problem, margin=margin)
        assert solution.found is (model is not None)
        if model is not None:
            assert solution.value == pytest.approx(model, rel=1e-6, abs=1e-7)
            assert problem.margin_of(solution.contact_forces) == pytest.approx(
                solution.margin, abs=1e-9
            )


@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", range(6))
def test_the_search_finds_what_the_listing_of_all_modes_finds(number):
    problem = scene(number, "uneven")
    found, listed = maximize_margin(problem), maximize_margin(problem, search="enumerate")
    assert found.found is listed.found
    assert not found.found or found.margin == pytest.approx(listed.margin, rel=1e-6, abs=1e-7)


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 10_000))
def test_the_margin_is_the_distance_to_the_nearest_face(seed):
    problem, rng = scene(seed % 4, "uneven"), np.random.default_rng(seed)
    forces = rng.normal(size=(problem.contact_count, 3)) + 3.0 * problem.normals
    normal = np.einsum("mi,mi->m", problem.normals, forces)
    rooms = [-(faces @ f).max() for faces, f in zip(hull_rows(problem), forces, strict=True)]
    expected = min([*normal, *(problem.max_normal_force - normal), *rooms])
    assert problem.margin_of(forces) == pytest.approx(expected, abs=1e-12)


def test_edges_and_faces_belong_together():
    """Each edge lies in two faces and inside all others: H^T C is 0 twice a column, else below."""
    problem = scene(1, "uneven")
    assert (
        problem.C.shape
        == problem.H.shape
        == (3 * problem.contact_count, len(CORNERS) * problem.contact_count)
    )
    for contact in range(problem.contact_count):
        rows = slice(3 * contact, 3 * contact + 3)
        columns = slice(len(CORNERS) * contact, len(CORNERS) * (contact + 1))
        products = problem.H[rows, columns].T @ problem.C[rows, columns]
        on_face = np.abs(products) < 1e-12
        assert (on_face.sum(axis=0) == 2).all()
        assert (products[~on_face] < 0.0).all()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", range(4))
def test_the_same_pyramids_by_another_name_have_the_same_optima(number):
    for make in (scene, sliding_scene):
        known, other = (make(number, cone) for cone in ("edges", "same"))
        for first, second in zip(
            (maximize_margin(known), minimize_torque(known, 0.05)),
            (maximize_margin(other), minimize_torque(other, 0.05)),
            strict=True,
        ):
            assert first.status is second.status
            assert not first.found or first.value == pytest.approx(second.value, rel=1e-6, abs=1e-7)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("number", [1, 3, 5])
@pytest.mark.parametrize("make", [scene, sliding_scene])
def test_gradients_are_those_of_differences(number, make):
    problem = make(number, "elliptic")
    solution = maximize_margin(problem, static_friction="coulomb")
    assert solution.found
    gradients = optimum_gradients(solution)
    step = 1e-5
    for contact in range(problem.contact_count):
        if not gradients.unique["friction"][contact]:
            continue
        more = step * (np.arange(problem.contact_count) == contact)
        margins = [
            maximize_margin(
                problem.with_changes(friction=problem.friction + sign * more),
                static_friction="coulomb",
            ).margin
            for sign in (1.0, -1.0)
        ]
        slope = (margins[0] - margins[1]) / (2.0 * step)
        assert gradients.values.friction[contact] == pytest.approx(slope, rel=1e-3, abs=1e-4)


def test_friction_of_contacts_that_slide_is_that_of_the_model():
    problem = sliding_scene(3, "elliptic")
    solution = maximize_margin(problem, static_friction="coulomb")
    forces = solution.contact_forces
    for contact in range(2):
        v = problem.tangents[contact].T @ problem.sliding[contact]
        scaled = np.array([0.5, 1.0]) * v
        way = -np.array([0.5, 1.0]) * scaled / np.linalg.norm(scaled)
        normal = problem.normals[contact] @ forces[contact]
        friction = problem.tangents[contact].T @ forces[contact]
        assert friction == pytest.approx(problem.friction[contact] * normal * way, abs=1e-9)


@pytest.mark.parametrize(
    ("slope", "held"), [(20.0, (True, True)), (30.0, (True, False)), (40.0, (False, False))]
)
def test_a_block_slides_down_along_the_ribs_first(slope, held):
    """By hand: it stays up to atan(mu) across the ribs, and up to atan(mu / 2) along them."""
    turn = np.radians(slope)
    weight = 9.81 * np.array([np.sin(turn), 0.0, -np.cos(turn), 0.0, 0.0, 0.0])
    corners = [[x, y, -0.01] for x in (-0.05, 0.05) for y in (-0.05, 0.05)]
    down, level = np.eye(3)[:2]
    for tangents, stays in zip(([level, -down], [down, level]), held, strict=True):
        problem = QuasistaticProblem(
            corners, [[0.0, 0.0, 1.0]] * 4, weight, friction=0.75, cone="elliptic",
            tangents=[np.column_stack(tangents)] * 4,
        )  # fmt: skip
        assert maximize_margin(problem, static_friction="coulomb").found is stays


def test_friction_in_use_is_that_of_the_cone():
    """Half of a force in a face is half of what that face allows; what slides uses all."""
    problem = sliding_scene(3, "elliptic")
    corners = problem.cone_section.corners
    middle = 0.5 * (corners[1] + corners[2])
    normals, T, mu = problem.normals, problem.tangents, problem.friction
    for share in (0.5, 1.0):
        forces = 2.0 * normals + T @ (share * 2.0 * middle) * mu[:, None]
        assert friction_use(problem, forces) == pytest.approx([1.0, 1.0, share, share, share])
    states = contact_states(problem, forces)
    assert states == ["sliding"] * 2 + ["at its limit"] * 3


def test_a_model_that_does_not_tell_kinetic_friction_refuses_sliding():
    with pytest.raises(ArgumentError, match="'uneven', which does not define the kinetic friction"):
        maximize_margin(sliding_scene(3, "uneven"))


@pytest.mark.parametrize("factor", [-1.0, 2.5])
def test_kinetic_friction_that_is_none_is_refused(monkeypatch, factor):
    known = Elliptic.kinetic_friction
    monkeypatch.setattr(Elliptic, "kinetic_friction", lambda self, ways: factor * known(self, ways))
    with pytest.raises(ArgumentError, match="'elliptic', whose kinetic friction must oppose"):
        maximize_margin(sliding_scene(3, "elliptic"))


def test_force_ranges_keep_the_cones():
    problem = scene(1, "uneven")
    best = maximize_margin(problem, static_friction="coulomb")
    found = contact_force_bounds(problem, best.torques, static_friction="coulomb")
    assert found.covers == "over all forces of rest (uneven cones of 6 edges)"
    local = np.einsum("mji,mj->mi", problem.frames, best.contact_forces)
    assert (found.lower <= local + 1e-6).all()
    assert (local <= found.upper + 1e-6).all()


def test_the_section_plot_keeps_the_margin_where_sides_vanish():
    problem = scene(1, "uneven")
    solution = maximize_margin(problem, static_friction="coulomb")
    normal = float(problem.normals[0] @ solution.contact_forces[0])
    whole = section_corners(solution, 0)
    assert whole == pytest.approx(problem.friction[0] * normal * CORNERS)
    counts = []
    for margin in np.linspace(0.01, 0.6, 40) * problem.friction[0] * normal:
        corners = section_corners(solution, 0, margin)
        counts.append(len(corners))
        for corner in corners:
            force = normal * problem.normals[0] + problem.tangents[0] @ corner
            assert -(hull_rows(problem)[0] @ force).max() == pytest.approx(margin, abs=1e-9)
    assert all(before >= after for before, after in pairwise(counts))
    assert counts[0] == len(CORNERS)
    assert counts[-1] == 0
    assert {3, 4, 5}.intersection(counts)


# What needs Coulomb's law


def test_no_verdict_is_claimed():
    problem = scene(1, "uneven").with_changes(object_inertia=np.eye(6), joint_inertia=None)
    torques = maximize_margin(problem, static_friction="coulomb").torques
    verdict = stability(problem, torques)
    assert verdict.status is Stability.UNDECIDED
    assert "requires Coulomb's law, and the cone is 'uneven'" in str(verdict)
    strong = maximize_margin(problem, static_friction="coulomb", stability="strong")
    assert strong.status is Status.STRONG_NOT_FOUND
    assert "use the cone 'edges' or 'round'" in strong.explanation
    for analysis in (guaranteed_disturbance, robustness, what_would_hold):
        with pytest.raises(ArgumentError, match="requires Coulomb's law"):
            analysis(problem, torques)


def test_tolerances_name_the_cone_and_point_to_no_verdict():
    problem = scene(1, "uneven")
    torques = maximize_margin(problem, static_friction="coulomb").torques
    found = tolerances(problem, torques, quantities=["push"], static_friction="coulomb")
    assert found.law == "the cone 'uneven'"
    assert str(found).rstrip().endswith("are the best that the cone 'uneven' allows")


def test_the_rule_of_directions_is_refused_and_left_out():
    problem = scene(1, "uneven")
    with pytest.raises(
        ArgumentError, match="sign_rule: is 'direction', which requires Coulomb's law"
    ):
        maximize_margin(problem, sign_rule="direction")
    assert not any(rules.by_direction for rules in compare_rules(problem).solutions)


# Documents


@pytest.fixture
def document():
    problem = sliding_scene(3, "elliptic")
    solution = maximize_margin(problem)
    assert solution.found
    return solution_document(solution)


def test_documents_state_the_cones_and_are_proven(document):
    found = verify_document(document)
    assert found.proven
    assert "cones 'elliptic': their 8 corners" in str(found)
    again = read_solution(document)
    assert again.problem.cone == "elliptic"
    assert again.margin == pytest.approx(document["margin"], rel=1e-12)
    assert "kinetic_friction" in document["contacts"][0]
    assert np.shape(document["contacts"][2]["cone_corners"]) == (8, 2)
    assert (
        "cone_corners" not in solution_document(maximize_margin(scene(1, "edges")))["contacts"][0]
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize("number", range(4))
@pytest.mark.parametrize("cone", ["uneven", "same"])
def test_documents_of_both_algorithms_are_proven(number, cone):
    problem = scene(number, cone)
    for solution in (maximize_margin(problem), minimize_torque(problem, 0.05)):
        assert verify_document(solution_document(solution)).proven


@pytest.mark.parametrize("objective", [Helped(), SquaredShares(0.05)])
def test_documents_of_objectives_of_ones_own_are_proven(objective):
    solution = optimize(scene(3, "uneven"), objective)
    assert solution.found
    assert verify_document(solution_document(solution)).proven


CORNERS_OF, KINETIC = (2, "cone_corners"), (0, "kinetic_friction")
NO_POLYGON = "cone_corners of contact 2 must be a convex polygon around its normal"
ALONG = "kinetic_friction of contact 0 must not exceed its friction coefficient, and must oppose"
SPOILT = {
    "wider": (CORNERS_OF, lambda own: (1.5 * np.array(own)).tolist(),
              "cone_corners of contact 2 must not exceed its friction coefficient"),
    "reversed": (CORNERS_OF, lambda own: own[::-1], NO_POLYGON),
    "dented": (CORNERS_OF, lambda own: [own[0], [1e-3, 1e-3], *own[2:]], NO_POLYGON),
    "one twice": (CORNERS_OF, lambda own: [own[0], own[0], *own[2:]], NO_POLYGON),
    "fewer": (CORNERS_OF, lambda own: own[:-1],
              "cone_corners of contact 3 is a list of length 8|must be a list of"),
    "along": (KINETIC, lambda own: [-one for one in own], ALONG),
    "large": (KINETIC, lambda own: [2.0 * one for one in own], ALONG),
}  # fmt: skip


@pytest.mark.parametrize(("place", "change", "message"), SPOILT.values(), ids=SPOILT)
def test_cones_that_are_none_are_refused(document, place, change, message):
    contact, key = place
    document["contacts"][contact][key] = change(document["contacts"][contact][key])
    with pytest.raises(ValueError, match=message):
        verify_document(document)


def test_cones_that_are_missing_are_refused(document):
    contact = document["contacts"][2]
    corners = contact.pop("cone_corners")
    with pytest.raises(ValueError, match=r"contact 2, whose cone 'elliptic' is .*, lacks the key"):
        verify_document(document)
    contact["kinetic_friction"] = corners[0]
    with pytest.raises(ValueError, match=NO_POLYGON):
        verify_document(document)


def test_narrower_cones_do_not_pass(document):
    """The forces leave them, and the margin is another."""
    for contact in document["contacts"][2:]:
        contact["cone_corners"] = (0.5 * np.array(contact["cone_corners"])).tolist()
    assert not verify_document(document).passed
    with pytest.raises(
        ArgumentError, match="cone_corners: differs from the installed cone 'elliptic'"
    ):
        read_solution(document)


def test_a_verdict_needs_cones_that_stand_for_coulombs_law():
    problem = scene(1, "same")
    problem = problem.with_changes(
        object_inertia=np.eye(6), joint_inertia=1e-3 * np.eye(problem.joint_count)
    )
    solution = maximize_margin(problem)
    verdict = stability(problem, solution.torques)
    assert verdict.status is not Stability.UNDECIDED
    document = solution_document(solution, verdict=verdict)
    assert verify_document(document).proven
    (refused,) = [
        one
        for one in verify_document(document | {"coulombs_law": False}).checks
        if one.passed is False
    ]
    assert "the cones do not represent it" in refused.detail


# Models that are none


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        ([[0.5, 0.0], [-0.5, 0.0]], "at least three"),
        ([[0.5, 0.0], [0.5, 0.0], [0.0, 0.5]], "at least three"),
        ([[0.5, 0.0], [0.0, -0.5], [-0.5, 0.0]], "counterclockwise"),
        ([[0.5, 0.5], [0.1, 0.5], [0.1, 0.2]], "around the normal"),
        ([[0.5, 0.0], [0.0, 0.5], [0.1, 0.1], [-0.5, 0.0], [0.0, -0.5]], "convex"),
        ([[1.1, 0.0], [0.0, 0.5], [-0.5, -0.5]], "must be within 1"),
        ([[np.nan, 0.0], [0.0, 0.5], [-0.5, -0.5]], "is NaN"),
    ],
)
def test_corners_that_are_no_section_are_refused(corners, message):
    with pytest.raises(ArgumentError, match=f"corners: .*{message}"):
        Section.with_corners(corners)


def test_the_model_is_named_whose_corners_are_none(monkeypatch):
    monkeypatch.setattr(Uneven, "corners", lambda self, edges: 2.0 * CORNERS)
    monkeypatch.setitem(CONE_MODELS, "uneven", Uneven())
    with pytest.raises(ArgumentError, match="corners of the cone 'uneven': are up to"):
        maximize_margin(scene(1, "uneven"))
