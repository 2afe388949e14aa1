"""CoACD in the test's own process, where the process that it otherwise has is not tested."""

from __future__ import annotations

from typing import Any, Self

import pytest

from graspless_pin.geometry.bodies import decomposition


class Here:
    """Stands for the process that meshes are cut in."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None: ...

    def call(self, function: Any, *arguments: Any, **_: Any) -> Any:
        return function(*arguments)


def cut_here(patch: pytest.MonkeyPatch) -> None:
    """Let meshes be cut in this process, without a time limit."""
    patch.setattr(decomposition, "ChildProcess", Here)
