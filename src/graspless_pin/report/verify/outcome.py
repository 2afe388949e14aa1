"""The results of checks, one line each, and the conclusion on the whole document."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

_MARKS = {True: "ok", False: "FAILED", None: "not proven here"}


class Claim(Enum):
    """A claim of an answer that can be withdrawn while the rest of the answer stands."""

    OPTIMUM = "no answer is better"
    GUARANTEE = "the verdict on the torques says that they are guaranteed"
    REST = "the verdict on the torques is right"


@dataclass(frozen=True)
class Check:
    """One line of a verification. See the example of `Verification`.

    Attributes:
        name: What was checked.
        passed: Whether it holds; None where the document holds no proof of it.
        detail: The figure that decided.
        given: Whether it is an assumption: nothing in the document proves it.
        claim: The one claim that it decides; None: the validity of the answer.
    """

    name: str
    passed: bool | None
    detail: str
    given: bool = False
    claim: Claim | None = None

    @property
    def mark(self) -> str:
        """The result in one to three words."""
        return "taken as given" if self.given else _MARKS[self.passed]

    def __str__(self) -> str:
        """Return the line."""
        return f"{self.mark:>15}  {self.name}: {self.detail}"


@dataclass(frozen=True)
class Verification:
    """All checks of one document.

    Attributes:
        checks: In the order made.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report import solution_document, verify
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> verify.verify_document(solution_document(scene.solve())).passed
        True
    """

    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.passed is not False for check in self.checks)

    @property
    def proven(self) -> bool:
        """Whether all that the document claims is proven in it."""
        return all(check.passed is True for check in self.checks)

    @property
    def conclusion(self) -> str:
        """What follows from the checks, in a sentence."""
        made = [check for check in self.checks if not check.given]
        if not self.passed:
            failed = [check.name for check in made if check.passed is False]
            return f"Refused: {len(failed)} of {len(made)} checks failed, the first {failed[0]!r}."
        if not self.proven:
            open_ = [check.name for check in made if check.passed is None]
            return (
                f"None of {len(made)} checks failed, but not every claim is proven here: "
                f"{open_[0]!r}{f' and {len(open_) - 1} more' if open_[1:] else ''}."
            )
        return (
            f"Verified: all figures and proofs of the document, in {len(made)} checks, for the "
            "problem that is taken as given."
        )

    def __str__(self) -> str:
        """Return a line a check, and the conclusion."""
        return "\n".join([*map(str, self.checks), "", self.conclusion])


def given(name: str, detail: str) -> Check:
    """Return the line of an assumption, which nothing in the document proves."""
    return Check(name, passed=True, detail=detail, given=True)


def holds(name: str, passed: object, detail: str, claim: Claim | None = None) -> Check:
    """Return the line of a statement that is true or false."""
    return Check(name, passed=bool(passed), detail=detail, claim=claim)


def within(name: str, value: float, tolerance: float, unit: str) -> Check:
    """Return the line of a figure that must not exceed a tolerance; one that is no number fails."""
    good = bool(np.isfinite(value) and np.isfinite(tolerance) and value <= tolerance)
    return Check(name, good, f"{value + 0.0:.2e} {unit}".rstrip())


def agrees(name: str, stated: float, found: float, tolerance: float, unit: str = "") -> Check:
    """Return the line of a stated figure, compared with the one that was worked out again."""
    good = bool(np.isfinite(tolerance) and abs(stated - found) <= tolerance)
    return Check(name, good, f"stated {stated:.9g}, found {found:.9g} {unit}".rstrip())
