"""Advice for error messages on unknown names and on arguments of a wrong type."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from pathlib import PurePath

_MOST_NAMES = 30


def nearest_name(name: str, known: Iterable[str], alike: float = 0.6) -> str | None:
    """Return the known name most similar to a name; None below the similarity ``alike``, 0 to 1."""
    by_folded_name = {str(candidate).casefold(): str(candidate) for candidate in known}
    matches = difflib.get_close_matches(str(name).casefold(), by_folded_name, n=1, cutoff=alike)
    return by_folded_name[matches[0]] if matches else None


def names_in_words(name: str, known: Iterable[str]) -> str:
    """Return ``did you mean 'x'? known: x, y, ...`` for a name that is not known."""
    names = [str(one) for one in known]
    nearest = nearest_name(name, names)
    meant = "" if nearest is None else f"did you mean {nearest!r}? "
    return f"{meant}known: {first_of(names, _MOST_NAMES) or 'none'}"


def first_of(words: Sequence[str], most: int, between: str = ", ") -> str:
    """Return the first ``most`` words, joined, and the number of the others."""
    more = f" and {len(words) - most} more" if len(words) > most else ""
    return between.join(words[:most]) + more


_INSTEAD = {
    ("problem", "Scene"): "pass scene.problem(), or call scene.solve('margin') or 'torque'",
    ("problem", "TorqueSolution"): "pass solution.problem",
    ("problem", "Evaluator"): "pass evaluator.scene.problem()",
    ("problem", "str"): "load a file with load_scene(path).problem()",
    ("solution", "Scene"): "pass what scene.solve() returns",
    ("solution", "QuasistaticProblem"): "pass what maximize_margin(problem) returns",
    ("solution", "dict"): "read a document with graspless_pin.report.read_solution(document)",
    ("solution", "str"): "read a document with graspless_pin.report.read_solution",
    ("scene", "QuasistaticProblem"): "a problem has no bodies: pass the Scene that it came from",
    ("scene", "TorqueSolution"): "pass the Scene that was solved",
    ("scene", "Evaluator"): "pass evaluator.scene",
    ("scene", "Hand"): "a hand has no object: pass a Scene",
    ("scene", "str"): "load it with load_scene(path)",
    ("scene", "dict"): "write it to a YAML file and load that with load_scene(path)",
    ("torques", "TorqueSolution"): "pass solution.torques",
    ("torques", "RobustSolution"): "pass its torques",
    ("torques", "Evaluation"): "pass evaluation.torques",
    ("torques", "dict"): "pass them in the order of problem.joint_names",
    ("torques", "mappingproxy"): "pass solution.torques, in the order of problem.joint_names",
    ("path", "Scene"): "it is loaded already",
    ("path", "dict"): "write it to a YAML file and give its path",
}


def knows_instead(argument: str, value: object) -> bool:
    """Return whether there is advice on what to pass instead of such a value."""
    return (argument, type(value).__name__) in _INSTEAD


def what_to_pass(argument: str, value: object, wanted: str) -> str:
    """Return the error message for an argument of a wrong type, with what to pass instead.

    Args:
        argument: Name of the argument.
        value: The value that was passed.
        wanted: The required type.
    """
    kind = type(value).__name__
    known = "str" if isinstance(value, PurePath) else kind
    advice = _INSTEAD.get((argument, known))
    ending = f"; {advice}" if advice else ""
    return f"is {_with_article(kind)}; it must be {_with_article(wanted)}{ending}"


def _with_article(noun: str) -> str:
    return f"{'an' if noun[:1] in 'AEIOaeiou' else 'a'} {noun}"
