"""What is derived from records is kept for the last few only, and never keeps one alive."""

import gc
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from random_scenes import general_scene

from graspless_pin import maximize_margin, minimize_torque
from graspless_pin.algorithms.formulation import shared_parts
from graspless_pin.caching import MOST_SOURCES, Bounded, Derived, Latest


class Source:
    pass


def test_a_value_is_made_once_while_its_source_is_among_the_last():
    made = []
    sources = [Source() for _ in range(MOST_SOURCES + 1)]
    derived = Derived(lambda source: made.append(source) or len(made))
    first = [derived(source) for source in sources[:-1]]
    assert [derived(source) for source in sources[:-1]] == first
    assert made == sources[:-1]
    derived(sources[-1])
    assert len(derived) == MOST_SOURCES
    assert derived(sources[0]) == len(made) == MOST_SOURCES + 2


def test_a_bounded_dictionary_begins_anew_before_it_holds_too_much():
    kept: Bounded[str, int] = Bounded(3)
    for number, name in enumerate("abc"):
        kept[name] = number
    assert kept == {"a": 0, "b": 1, "c": 2}
    kept["d"] = 3
    assert kept == {"d": 3}


def test_a_source_that_is_gone_takes_its_value_along():
    class Value:
        pass

    derived: Derived[Source, Value] = Derived(lambda _: Value())
    source = Source()
    value = weakref.ref(derived(source))
    assert value() is not None
    del source
    assert value() is None
    assert len(derived) == 0


def test_another_source_at_the_same_address_gets_its_own_value():
    derived: Derived[Source, int] = Derived(id)
    for _ in range(100):
        source = Source()
        assert derived(source) == id(source)
        derived._entries[id(source)] = (lambda: None, -1)  # type: ignore[assignment]
        assert derived(source) == id(source)


def test_threads_get_the_values_of_their_own_sources():
    sources = [Source() for _ in range(3 * MOST_SOURCES)]
    derived: Derived[Source, int] = Derived(id)
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(derived, sources * 200))
    assert found == [id(source) for source in sources] * 200
    assert len(derived) <= MOST_SOURCES


def test_a_problem_dies_with_its_last_holder_whatever_was_solved():
    problem = general_scene(1, 5)
    solutions = [maximize_margin(problem), minimize_torque(problem, 0.1)]
    kinematics = weakref.ref(shared_parts(problem)[1])
    gone = weakref.ref(problem)
    assert kinematics() is not None
    del problem, solutions
    gc.collect()
    assert gone() is None
    # Its virtual motions may serve in the next one; they go with the next that has others.
    shared_parts(general_scene(2, 5))
    gc.collect()
    assert kinematics() is None


ARRAY = np.ones(3)
SOURCES = [ARRAY, np.ones(3), None, 0.0, -0.0, 1.0, 1, True, "1", b"1", np.nan, 10**40, "a" * 40]


@given(
    first=st.lists(st.sampled_from(SOURCES), max_size=3),
    second=st.lists(st.sampled_from(SOURCES), max_size=3),
)
def test_what_a_value_is_made_from_is_told_apart(first, second):
    values = Latest()
    # Equal numbers and texts are others as objects where they are computed.
    others = [one * 1 if type(one) in (int, float, str) else one for one in second]
    value = values.put("x", tuple(first), object())
    kept = values.get("x", tuple(others))
    assert kept is (value if [*map(described, first)] == [*map(described, second)] else None)


def described(source: object) -> object:
    return id(source) if isinstance(source, np.ndarray) else (type(source), repr(source))


def test_a_full_dictionary_keeps_the_others_where_an_entry_is_replaced():
    kept = Bounded[int, str](2)
    kept[1], kept[2] = "a", "b"
    kept[2] = "c"
    assert kept == {1: "a", 2: "c"}
    kept[3] = "d"
    assert kept == {3: "d"}
