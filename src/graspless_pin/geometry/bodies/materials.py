"""Friction between pairs of materials."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from graspless_pin.errors import ArgumentError
from graspless_pin.records import PickledByFields
from graspless_pin.suggestions import names_in_words

Pair = frozenset[str]
_NEAR = 0.8
"""Names at least this similar are taken for one name and a slip of the keyboard."""


@dataclass(frozen=True)
class Materials(PickledByFields):
    """Coefficients of friction by pair of materials; the order of a pair does not matter.

    See the example of `load_scene`.

    Attributes:
        coefficients: Coefficient by set of two names, or of one where a material meets itself.
    """

    coefficients: Mapping[Pair, float]

    def __post_init__(self) -> None:
        """Make the table read-only."""
        if not isinstance(self.coefficients, MappingProxyType):
            object.__setattr__(self, "coefficients", MappingProxyType(dict(self.coefficients)))

    @classmethod
    def from_table(cls, table: Mapping[str, Mapping[str, float]]) -> Materials:
        """Make the record of a nested table, such as ``{"rubber": {"steel": 0.6}}``.

        A pair may be written once, or both ways round with the same coefficient.

        Raises:
            ArgumentError: A name is empty, a coefficient is negative or not a number, or a pair has
                two coefficients.
        """
        coefficients: dict[Pair, float] = {}
        for first, row in table.items():
            for second, value in row.items():
                key = f"materials[{first!r}][{second!r}]"
                if not (str(first).strip() and str(second).strip()):
                    raise ArgumentError(key, "needs two names")
                if isinstance(value, bool) or not (math.isfinite(value) and value >= 0.0):
                    raise ArgumentError(key, f"needs a coefficient of zero or more, got {value!r}")
                pair = frozenset((first, second))
                if coefficients.setdefault(pair, float(value)) != value:
                    raise ArgumentError(
                        key, f"is {value:g}, but {coefficients[pair]:g} the other way round"
                    )
        return cls(coefficients)

    @property
    def names(self) -> tuple[str, ...]:
        """All materials in alphabetical order."""
        return tuple(sorted({name for pair in self.coefficients for name in pair}))

    def check(self, names: Iterable[str], argument: str = "material") -> None:
        """Check that materials are in the table.

        Raises:
            ArgumentError: One is not; the message lists those that are.
        """
        for name in names:
            if name not in self.names:
                words = names_in_words(name, self.names)
                raise ArgumentError(argument, f"{name!r} is in no pair of materials; {words}")

    def misspelt(self, used: Iterable[str]) -> dict[str, str]:
        """Return names of the table that look like misspelt ones of bodies, with what was meant.

        A name that no body has is no mistake by itself: scenes may share a table. Names that differ
        in their digits are different materials.

        Args:
            used: Names of the bodies' materials.
        """
        bodies = sorted(set(used))
        meant: dict[str, str] = {}
        for name in self.names:
            if name in bodies:
                continue
            plain = {body.casefold(): body for body in bodies if _digits(body) == _digits(name)}
            near = difflib.get_close_matches(name.casefold(), plain, n=1, cutoff=_NEAR)
            if near:
                meant[name] = plain[near[0]]
        return meant

    def friction(self, first: str, second: str) -> float:
        """Coefficient of friction of two materials.

        Raises:
            ArgumentError: A material is unknown or the pair has no coefficient; the message tells
                what to add.
        """
        value = self.coefficients.get(frozenset((first, second)))
        if value is None:
            self.check((first, second))
            raise ArgumentError(
                "materials",
                f"has no coefficient for {first!r} on {second!r}; "
                f"add it, e.g. {first}: {{{second}: 0.5}}",
            )
        return value


def _digits(name: str) -> list[str]:
    return re.findall(r"\d+", name)
