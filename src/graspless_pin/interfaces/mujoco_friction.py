"""MuJoCo's friction of pairs of geoms, of which one is the object's."""

from __future__ import annotations

import numpy as np

from graspless_pin.interfaces.mujoco_state import ModelState

_NAMED = 4
"""Geoms in one message."""


class PairFriction:
    """Coefficients of sliding friction against the object."""

    def __init__(self, at: ModelState) -> None:
        """Take a model with its object."""
        self._at, self._model = at, at.model
        self._own = at.geoms(at.in_object)
        self._differ: dict[str, list[float]] = {}
        self._beyond_sliding: set[str] = set()

    def of_geom(self, geom: int) -> float | None:
        """Return the smallest against the object's geoms; None: it can touch none of them."""
        each = [self._of_pair(geom, own) for own in self._own]
        known = [one for one in each if one is not None]
        if len(set(known)) > 1:
            self._differ[self._name(geom)] = sorted(set(known))
        return min(known, default=None)

    def tell(self) -> None:
        """Tell what of the pairs that were asked for is left out."""
        for name, values in self._differ.items():
            figures = ", ".join(f"{mu:g}" for mu in values)
            self._at.tell(
                name,
                f"the object's geoms have the coefficients of friction {figures} against {name!r}",
                "the smallest counts",
            )
        if self._beyond_sliding:
            names = sorted(self._beyond_sliding)
            more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
            self._at.tell(
                ", ".join(names),
                f"contacts with {', '.join(names[:_NAMED])}{more} have torsional or rolling "
                "friction (condim above 3)",
                "sliding friction alone counts",
            )

    def _of_pair(self, one: int, other: int) -> float | None:
        """Return the coefficient of two geoms; None: they do not touch."""
        model = self._model
        given = _index_of(model.pair_geom1, model.pair_geom2, one, other)
        if given is not None:
            dimensions, friction = int(model.pair_dim[given]), model.pair_friction[given]
            sliding, others = float(friction[:2].min()), friction[2:]
        elif not self._meet(one, other):
            return None
        else:
            ranks = model.geom_priority[[one, other]]
            both = [one, other] if ranks[0] == ranks[1] else [(one, other)[int(ranks.argmax())]]
            dimensions = int(model.geom_condim[both].max())
            friction = model.geom_friction[both].max(axis=0)
            sliding, others = float(friction[0]), friction[1:]
        if dimensions > 3 and others.any():
            self._beyond_sliding.add(self._name(one))
        return sliding if dimensions > 1 else 0.0

    def _meet(self, one: int, other: int) -> bool:
        """Return whether two geoms are let touch each other."""
        model = self._model
        bodies = int(model.geom_bodyid[one]), int(model.geom_bodyid[other])
        excluded = [(first << 16) + last for first, last in (bodies, bodies[::-1])]
        kinds, meets = model.geom_contype, model.geom_conaffinity
        touch = (kinds[one] & meets[other]) or (kinds[other] & meets[one])
        return bool(touch) and not np.isin(excluded, model.exclude_signature).any()

    def _name(self, geom: int) -> str:
        return self._model.geom(geom).name or self._at.source.body(
            int(self._model.geom_bodyid[geom])
        )


def _index_of(first: np.ndarray, last: np.ndarray, one: int, other: int) -> int | None:
    """Return the pair of two geoms among those that the file states."""
    found = np.flatnonzero(((first == one) & (last == other)) | ((first == other) & (last == one)))
    return int(found[0]) if len(found) else None
