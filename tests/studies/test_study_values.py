"""Which samples a study has: grids, ranges, Latin hypercubes, Sobol sequences, units, labels."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from study_tools import HEIGHT, SLOPE, study

from graspless_pin.errors import StudyError
from graspless_pin.studies.run import check_study

METHODS = ("latin_hypercube", "sobol")
TWO = {"friction": {"from": 0.2, "to": 0.6}, "object.mass": {"from": 0.5, "to": 4, "scale": "log"}}


def test_a_grid_lists_all_combinations_the_last_one_fastest():
    made = study(
        {"friction": {"values": [0.3, 0.5]}, "object.mass": {"from": 1, "to": 2, "steps": 3}}
    )
    expected = [(f, m) for f in (0.3, 0.5) for m in (1.0, 1.5, 2.0)]
    assert [*made.samples] == [*expected]
    made = study({"object.mass": {"from": 0.1, "to": 10, "steps": 5, "scale": "log"}})
    values = [sample[0] for sample in made.samples]
    assert values[0] == 0.1 and values[-1] == 10
    np.testing.assert_allclose(values, [0.1, 10**-0.5, 1.0, 10**0.5, 10.0], rtol=1e-14)


@settings(max_examples=10)
@given(count=st.integers(1, 70), seed=st.integers(0, 5), method=st.sampled_from(METHODS))
def test_sampled_values_stay_in_their_ranges(count, seed, method):
    made = study(TWO, sampling={"method": method, "samples": count, "seed": seed})
    values = np.array(made.samples)
    assert values.shape == (count, 2)
    assert (values >= [0.2, 0.5]).all() and (values <= [0.6, 4.0]).all()
    again = study(TWO, sampling={"method": method, "samples": count, "seed": seed})
    assert [*again.samples] == [*made.samples] and again.fingerprint == made.fingerprint
    other = study(TWO, sampling={"method": method, "samples": count, "seed": seed + 1})
    assert [*other.samples] != [*made.samples] and other.fingerprint != made.fingerprint


SEED = {"cone_edges": {"from": 4, "to": 11}, "object.mass": {"from": 0.5, "to": 4}}


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("method", METHODS)
def test_whole_numbers_are_drawn_for_keys_that_need_them(method, scale):
    vary = {**SEED, "cone_edges": {"from": 4, "to": 11, "scale": scale}}
    made = study(vary, sampling={"method": method, "samples": 256})
    edges = [sample[0] for sample in made.samples]
    assert {type(value) for value in edges} == {int} and set(edges) == set(range(4, 12))
    check_study(made)
    expected = np.full(8, 32.0)
    if scale == "log":
        expected = 256.0 * np.diff(np.log(np.arange(4, 13))) / np.log(3.0)
    np.testing.assert_allclose(np.bincount(edges)[4:], expected, atol=2.0)


def test_a_grid_of_whole_numbers_has_no_others():
    made = study({"cone_edges": {"from": 4, "to": 12, "steps": 3}})
    assert repr([sample[0] for sample in made.samples]) == "[4, 8, 12]"
    for more, words in (
        ({"steps": 4}, r"steps: 4 values from 4 to 12 are not all whole .*; use 9 steps for all"),
        ({"from": 4.5}, r"from: found 4.5; the key needs whole numbers"),
        ({"steps": 3, "scale": "log"}, "scale: log does not give whole numbers"),
    ):
        with pytest.raises(StudyError, match=words):
            study({"cone_edges": {"from": 4, "to": 12, "steps": 3, **more}})
    with pytest.raises(StudyError, match="adaptive cannot halve whole numbers; list values"):
        vary = {"cone_edges": {"from": 4, "to": 12, "steps": 3}, "friction": TWO["friction"]}
        vary["friction"] = {**vary["friction"], "steps": 3}
        study(vary, sampling={"method": "adaptive", "depth": 2})


def test_a_latin_hypercube_has_one_sample_in_each_stratum():
    made = study(TWO, sampling={"method": "latin_hypercube", "samples": 40})
    friction, mass = np.array(made.samples).T
    shares = (friction - 0.2) / 0.4, np.log(mass / 0.5) / np.log(8.0)
    for share in shares:
        assert sorted(np.floor(40 * share).astype(int)) == list(range(40))


def test_a_longer_sobol_sequence_begins_with_the_shorter_one():
    short, long = (
        study(TWO, sampling={"method": "sobol", "samples": count}).samples for count in (16, 32)
    )
    assert long[:16] == short[:]
    friction = np.sort([sample[0] for sample in short])
    np.testing.assert_array_equal(np.floor(16 * (friction - 0.2) / 0.4), np.arange(16))
    vary = {"solve.sign_rule": {"values": ["strict", "exact"]}, **TWO}
    made = study(vary, sampling={"method": "sobol", "samples": 64})
    assert [sample[0] for sample in made.samples].count("exact") == 32


@pytest.mark.parametrize(
    ("vary", "column"),
    [
        ({"object.mass": {"values": [1.0]}}, "object.mass_kg"),
        ({"object.mass": {"values": [900, 1000], "unit": "g"}}, "object.mass_g"),
        ({"friction.default": {"values": [0.3]}}, "friction.default"),
        ({"supports.slope.friction": {"values": [0.3]}}, "supports.slope.friction"),
        ({"gravity.2": {"values": [-1.6]}}, "gravity.2_m_per_s2"),
        ({"hand.q.finger_1/hinge": {"values": [0.0]}}, "hand.q.finger_1/hinge"),
        ({"hand.q.finger_1/hinge": {"values": [0], "unit": "deg"}}, "hand.q.finger_1/hinge_deg"),
        ({"solve.sign_rule": {"values": ["exact"]}}, "solve.sign_rule"),
        ({"slope": SLOPE}, "slope_deg"),
        ({"height": HEIGHT}, "height_mm"),
    ],
)
def test_columns_tell_the_unit(vary, column):
    assert study(vary).variables[0].column == column
