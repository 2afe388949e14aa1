"""What adapters cost beside the evaluator that they ask."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from benchmarks.timing import medians, timer
from graspless_pin import Evaluator, load_scene

_SCENE = Path(__file__).parents[1] / "examples" / "trihand_push_box.yaml"
_CARRIED = _SCENE.with_name("panda_carry_bar.yaml")
_PINS = [*((f"finger_{k}_tip", "object") for k in (1, 2, 3)), ("object", "table")]
_STATES = 50
_MANY = 3000


def interfaces() -> str:
    """A row for each adapter whose library is installed."""
    rows = []
    adapters = {
        "OMPL: is a state valid": (_ompl, _MANY),
        "Drake: gaps and optimum": (_drake, _STATES),
        "PyTorch: gaps and optimum": (_torch, _STATES),
        "JAX: gaps and optimum": (_jax, _STATES),
    }
    for name, (calls, count) in adapters.items():
        try:
            own, adapted = calls()
        except ImportError as error:
            rows.append([name, "", "", f"left out: {error}"])
            continue
        timers = [timer(call, time.process_time) for call in (own, adapted)]
        alone, through = medians(timers, budget=5.0)
        milliseconds = [f"{1e3 * one / count:.3g}" for one in (alone, through)]
        rows.append([name, *milliseconds, f"{through / alone:.3f}"])
    headers = ["adapter", "evaluator ms", "through the adapter ms", "ratio"]
    note = (
        f"Medians of {_STATES} states with joints a little off, and Drake's pose, too, with "
        f"derivatives; OMPL's {_MANY} are valid ones of a Panda that carries a bar. The aim is 1.1."
    )
    return f"## Adapters\n\n{tabulate(rows, headers, tablefmt='github')}\n\n{note}"


def _ompl() -> tuple[Callable[[], Any], Callable[[], Any]]:
    adapter = import_module("graspless_pin.interfaces.ompl")
    geometric: Any = import_module("ompl.geometric")
    evaluator = Evaluator(load_scene(_CARRIED), attached_to="panda_hand", collisions=False)
    setup = geometric.SimpleSetup(adapter.joint_space(evaluator))
    adapter.attach_evaluator(setup, evaluator, margin=0.1)  # N
    information, states = setup.getSpaceInformation(), []
    information.setup()
    q = np.clip(_configurations(evaluator, _MANY), *evaluator.joint_limits)
    for row in q:
        states.append(information.allocState())
        for place, value in enumerate(row.tolist()):
            states[-1][place] = value

    def own() -> None:
        assert all(evaluator.is_feasible(row, margin=0.1) for row in q)  # noqa: S101

    def adapted() -> None:
        # Beyond this function nothing may use the states of a setup that is gone.
        assert setup is not None and all(map(information.isValid, states))  # noqa: S101

    return own, adapted


def _drake() -> tuple[Callable[[], Any], Callable[[], Any]]:
    autodiff: Any = import_module("pydrake.autodiffutils")
    evaluator = Evaluator(load_scene(_SCENE), algorithm="margin", pins=_PINS)
    functions = import_module("graspless_pin.interfaces.drake").PinnedFunctions(evaluator)
    T, rng = evaluator.scene.object.T_world_object, np.random.default_rng(0)
    pose = np.array([1.0, 0.0, 0.0, 0.0, *T[:3, 3]])
    count = len(evaluator.joint_names)

    def states() -> Any:
        for _ in range(_STATES):
            off = rng.uniform(-1e-3, 1e-3, count + 7)
            off[count : count + 4] = 0.0
            yield np.append(evaluator.configuration(), pose) + off

    def own() -> None:
        for state in states():
            T_object = T.copy()
            T_object[:3, 3] = state[-3:]
            found = evaluator.pinned(state[:count], T_object)
            assert found.by_gaps is not None and found.by_optimum is not None  # noqa: S101

    def adapted() -> None:
        for state in states():
            variables = autodiff.InitializeAutoDiff(state)[:, 0]
            functions.gaps(variables)
            functions.optimum(variables)

    return own, adapted


def _torch() -> tuple[Callable[[], Any], Callable[[], Any]]:
    torch: Any = import_module("torch")
    optimum = import_module("graspless_pin.interfaces.torch").optimum
    evaluator = Evaluator(load_scene(_SCENE), algorithm="margin", pins=_PINS)
    q = _configurations(evaluator)

    def adapted() -> None:
        found = optimum(evaluator, torch.tensor(q, requires_grad=True))
        (found.value.sum() + found.gaps.sum()).backward()

    return _one_by_one(evaluator, q), adapted


def _jax() -> tuple[Callable[[], Any], Callable[[], Any]]:
    jax: Any = import_module("jax")
    jax.config.update("jax_enable_x64", True)  # noqa: FBT003 - JAX's own
    optimum = import_module("graspless_pin.interfaces.jax").optimum
    evaluator = Evaluator(load_scene(_SCENE), algorithm="margin", pins=_PINS)
    q = _configurations(evaluator)

    def worth(q: Any) -> Any:
        found = optimum(evaluator, q)
        return found.value.sum() + found.gaps.sum()

    gradient = jax.jit(jax.grad(worth))
    return _one_by_one(evaluator, q), lambda: np.asarray(gradient(q))


def _configurations(evaluator: Evaluator, count: int = _STATES) -> np.ndarray:
    """(K, a)."""
    own = evaluator.configuration()
    return own + np.random.default_rng(0).uniform(-1e-3, 1e-3, (count, len(own)))


def _one_by_one(evaluator: Evaluator, q: np.ndarray) -> Callable[[], None]:
    def own() -> None:
        for one in q:
            found = evaluator.pinned(one)
            assert found.by_gaps is not None and found.by_optimum is not None  # noqa: S101

    return own
