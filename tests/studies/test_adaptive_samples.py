"""Grids that are refined where outcomes differ: which points, in which rounds, killed or not."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
import pytest
from study_tools import Here, data, study

from graspless_pin.errors import StudyError
from graspless_pin.studies import Study, read_results, run_study
from graspless_pin.studies.run import check_study

DEPTH = 4
PLANE = {
    "friction.default": {"from": 0.0, "to": 0.8, "steps": 5},
    "object.mass": {"from": 0.5, "to": 2.5, "steps": 4},
}


def adaptive(vary=PLANE, **sampling):
    return study(vary, sampling={"method": "adaptive", **sampling})


def rounds(made, outcome):
    """The points of each round where an outcome is known for each sample's values."""
    samples, told = made.samples, []
    while True:
        yield samples
        told += [outcome(*sample) for sample in samples[len(told) :]]
        more = samples.refined(np.array(told))
        if len(more) == len(samples):
            return
        samples = more


def disc(x, y):
    return int((x / 0.8 - 0.4) ** 2 + ((y - 0.5) / 2.0 - 0.55) ** 2 < 0.1)


def three(x, y):
    return int(x > 0.3) + int(x > 0.3 and y > 1.1)


def places(samples):
    """(samples, 2) whole places on the finest grid."""
    steps = [(0.0, 0.8, 4), (0.5, 2.5, 3)]
    values = np.array(samples)
    return np.stack(
        [
            np.rint((column - low) / (high - low) * count * 2**DEPTH).astype(int)
            for column, (low, high, count) in zip(values.T, steps, strict=True)
        ],
        axis=1,
    )


def by_cells(outcome, shape, depth):
    """The points as a search cell by cell finds them, until nothing changes."""
    steps = [size * 2**depth for size in shape]
    points = set(product(*[range(0, step + 1, 2**depth) for step in steps]))
    while True:
        new = set()
        cells = [(corner, 2**depth) for corner in product(*[range(0, s, 2**depth) for s in steps])]
        while cells:
            corner, side = cells.pop()
            inside = [
                outcome(*point)
                for point in points
                if all(c <= p <= c + side for c, p in zip(corner, point, strict=True))
            ]
            if side == 1 or len({*inside}) < 2:
                continue
            half = side // 2
            ways = [*product((0, 1), repeat=len(shape))]
            cells += [
                (tuple(c + half * w for c, w in zip(corner, way, strict=True)), half)
                for way in ways
            ]
            new |= {
                tuple(c + half * w for c, w in zip(corner, way, strict=True))
                for way in product((0, 1, 2), repeat=len(shape))
            }
        if new <= points:
            return points
        points |= new


def blobs(seed):
    """Seeded blobs of three outcomes."""
    rng = np.random.default_rng(seed)
    centers, kinds = rng.uniform(0.0, 1.0, (6, 2)), rng.integers(0, 3, 6)

    def outcome(x, y):
        place = np.array([x / 0.8, (y - 0.5) / 2.0])
        return int(kinds[np.argmin(np.linalg.norm(centers - place, axis=1))])

    return outcome


@pytest.mark.sampled(3)
@pytest.mark.parametrize("outcome", [disc, three, *map(blobs, range(3))])
def test_the_points_are_those_of_a_search_cell_by_cell(outcome):
    """Each cell of the finest grid whose corners differ has them all sampled; few others are."""
    *_, last = rounds(adaptive(depth=DEPTH), outcome)
    found = {tuple(place) for place in places(last[:]).tolist()}
    n, m = 4 * 2**DEPTH, 3 * 2**DEPTH
    told = [[outcome(0.8 * i / n, 0.5 + 2.0 * j / m) for j in range(m + 1)] for i in range(n + 1)]
    assert found == by_cells(lambda i, j: told[i][j], (4, 3), DEPTH)
    assert len(found) == len(last)
    mixed = 0
    for i, j in product(range(n), range(m)):
        corners = [(i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1)]
        if len({told[i][j] for i, j in corners}) > 1:
            mixed += 1
            assert found.issuperset(corners)
    assert mixed > n
    assert len(found) < 8 * mixed < (n + 1) * (m + 1)


def test_rounds_begin_with_those_before():
    made = adaptive(depth=3)
    sizes, before = [], ()
    for samples in rounds(made, disc):
        assert samples[: len(before)] == before
        before = samples[:]
        sizes.append(len(samples))
    assert sizes[0] == 20 and sizes == sorted({*sizes}) and len(sizes) >= 4
    whole = study(PLANE).samples
    np.testing.assert_allclose(made.samples[:], whole[:], rtol=1e-15)
    for limit in (20, 57, 400):
        *_, last = rounds(adaptive(samples=limit), disc)
        assert len(last) == limit
    *_, deep = rounds(adaptive(samples=400), disc)
    gaps = np.diff(np.unique(np.array(deep[:])[:, 0]))
    assert gaps.min() == pytest.approx(0.2 / 2**4)


def test_listed_values_are_not_refined_and_have_maps_of_their_own():
    vary = {
        "solve.sign_rule": {"values": ["strict", "exact"]},
        "friction.default": {"from": 0.0, "to": 0.8, "steps": 5},
    }
    made = adaptive(vary, depth=5)
    assert made.samples[4:6] == (("strict", 0.8), ("exact", 0.0))

    def outcome(rule, friction):
        return int(friction > 0.33 and rule == "exact")

    *_, last = rounds(made, outcome)
    assert [sample for sample in last[10:] if sample[0] == "strict"] == []
    values = sorted(friction for rule, friction in last if rule == "exact")
    below = max(value for value in values if value <= 0.33)
    above = min(value for value in values if value > 0.33)
    assert above - below == pytest.approx(0.2 / 2**5)


HELD = {
    "friction.default": {"from": 0.0, "to": 0.4, "steps": 3},
    "slope": {
        "from": 20, "to": 60, "steps": 3, "unit": "deg",
        "turn": {"what": "all", "axis": [0, 1, 0], "as_in_scene": 45},
    },
}  # fmt: skip
SAMPLED = {"sampling": {"method": "adaptive", "depth": 3}}


def test_a_study_is_refined_where_nothing_holds_any_more(tmp_path):
    """Each sample says what it says on the whole finest grid, which has more than twice as many."""
    made = Study.from_data(data(HELD, **SAMPLED))
    check_study(made)
    table = run_study(made, tmp_path / "out.csv", executor=Here(), progress=False)
    whole = study({name: {**entry, "steps": 17} for name, entry in HELD.items()})
    every: Any = run_study(whole, tmp_path / "whole.csv", executor=Here(), progress=False)
    assert 0 < every["found"].sum() < len(every)
    names = ["friction.default", "slope_deg"]
    outcomes, told = (
        dict(zip(map(tuple, rows[names].to_numpy().round(9)), rows["found"], strict=True))
        for rows in (every, table)
    )
    assert told.items() <= outcomes.items() and len(told) == len(table)
    assert 9 < len(table) < len(every) / 2
    about = read_results(tmp_path / "out.csv").attrs["graspless_pin"]
    assert about["samples"] == len(table) and about["method"] == "adaptive"
    assert about["seed"] is None


def test_stopped_runs_and_threads_give_the_same_table(tmp_path):
    made = Study.from_data(data(HELD, **SAMPLED))
    whole = tmp_path / "whole.parquet"
    run_study(made, whole, executor=Here(), progress=False)
    count, file = len(read_results(whole)), tmp_path / "out.parquet"
    stops = 0
    while not file.exists():
        try:
            run_study(made, file, executor=Here(9), workers=1, progress=False)
        except StudyError as error:
            assert "pulled the plug" in str(error)
            stops += 1
    assert stops >= count // 9 - 1 > 3
    assert file.read_bytes() == whole.read_bytes()
    with ThreadPoolExecutor(3) as threads:
        more = tmp_path / "more.parquet"
        run_study(made, more, executor=threads, workers=3, progress=False)
    assert more.read_bytes() == whole.read_bytes()


def test_the_border_of_a_mode(tmp_path):
    sampling = {"method": "adaptive", "depth": 2, "border": "mode"}
    made = Study.from_data(data(HELD, sampling=sampling, compute={"mode": True}))
    table = run_study(made, tmp_path / "out.parquet", executor=Here(), progress=False)
    pd.testing.assert_frame_equal(read_results(tmp_path / "out.parquet"), table)
    assert table["mode"].isna().tolist() == (~table["found"]).tolist()
    sample = made.scene_at(replace(made, samples=made.samples).samples[8])
    row: dict[str, Any] = table.iloc[8].to_dict()
    assert row["found"] and row["mode"] == str(sample.solve().mode)
    found = run_study(
        Study.from_data(data(HELD, sampling={"method": "adaptive", "depth": 2})),
        tmp_path / "found.parquet", executor=Here(), progress=False,
    )  # fmt: skip
    assert len({*table["mode"].dropna()}) > 1 and len(table) > len(found)


FINE = {
    f"hand.q.{joint}": {"from": 0.0, "to": 0.1, "steps": 2000}
    for joint in ("finger_1/hinge", "finger_6/hinge")
} | {name: {**entry, "steps": 2000} for name, entry in PLANE.items()}


@pytest.mark.parametrize(
    ("vary", "sampling", "message"),
    [
        (PLANE, {}, "adaptive needs 'depth', the number of halvings, or 'samples'"),
        (PLANE, {"depth": 0}, "sampling.depth: found 0"),
        (PLANE, {"samples": 19}, "sampling.samples: is 19, but the initial grid has 20"),
        (PLANE, {"depth": 2, "border": "mode"}, "needs compute: {mode: true}"),
        (PLANE, {"depth": 2, "border": "margin_N"}, "sampling.border"),
        (PLANE, {"depth": 2, "method": "grid"}, "'depth' has an effect only with adaptive"),
        (FINE, {"depth": 16}, "sampling.depth: makes a grid of too many points"),
        *(
            ({"friction.default": entry}, {"depth": 2}, message)
            for entry, message in (
                ({"values": [0.1, 0.2]}, "adaptive needs 1 to 4 ranges, found 0"),
                ({"from": 0.1, "to": 0.2}, "a range on a grid needs 'steps'"),
            )
        ),
    ],
)
def test_bad_sampling_is_told(vary, sampling, message):
    with pytest.raises(StudyError) as told:
        adaptive(vary, **sampling)
    assert message in str(told.value)
