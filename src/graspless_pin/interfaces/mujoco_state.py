"""A MuJoCo model in one state, and which of its bodies are object and hand.

Also its friction of pairs of geoms, one of which is the object's.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.geometry.hand.mjcf import motor_joints, robot_bodies, tree_roots
from graspless_pin.geometry.hand.mjcf_source import MjcfSource, mj_pose, read_mjcf, source_of_model
from graspless_pin.problem.checks import FloatArray, unknown_name, whole_number
from graspless_pin.simulation.scene_document import CUSTOM_TEXT
from graspless_pin.suggestions import first_of, names_in_words


def read_source(source: Any) -> MjcfSource:
    """Return the source read from the path of an MJCF, a ``MjSpec`` or a ``MjModel``."""
    if isinstance(source, str) and source.lstrip().startswith("<"):
        raise ArgumentError(
            "source", "is the text of an MJCF, not its path; give mujoco.MjSpec.from_string(text)"
        )
    if isinstance(source, str | Path):
        return read_mjcf(Path(source), keyframes=True)
    if hasattr(source, "worldbody"):
        return source_of_model(source.copy().compile())
    if hasattr(source, "body_parentid"):
        return source_of_model(source)
    raise ArgumentError(
        "source",
        f"needs the path of an MJCF, a mujoco.MjSpec or a mujoco.MjModel, got "
        f"{type(source).__name__}",
    )


class ModelState:
    """A compiled model in one state.

    Attributes:
        source: The MJCF as MuJoCo has read it.
        model: ``mujoco.MjModel``.
        data: Its own ``mujoco.MjData``.
        custom: Fields of a scene that MJCF cannot state, written by `scene_to_mjcf`.
        object: The object's body.
        in_object: (nbody,) mask of the bodies fixed to it.
        hand: The hand's first body, which may be the world; None: there is no hand.
        in_hand: (nbody,) mask of the hand's bodies, without the world.
    """

    def __init__(
        self,
        source: MjcfSource,
        data: Any,
        keyframe: str | int | None,
        object_body: str | None,
        hand_body: str | None,
    ) -> None:
        """Set up the state from the arguments of `scene_from_mjcf`."""
        self.source, self.model, self._mujoco = source, source.model, source.mujoco
        self.data = self._mujoco.MjData(self.model)
        self._set_coordinates(data, keyframe)
        self._mujoco.mj_kinematics(self.model, self.data)
        self.custom = self._read_custom_text()
        self.hand, self.in_hand = self._hand_bodies(hand_body)
        self.object = self._object_body(object_body or self.custom.get("object"))
        self.in_object = self._subtree(self.object)
        self._check_rigid_object()

    @property
    def name(self) -> str:
        """Name of the file or model."""
        path = self.source.path
        return str(path) if self.source.spec is None else path.stem

    def is_free(self, body: int) -> bool:
        """Return whether a body has a free joint, or three slides and three hinges instead."""
        kinds, first = self._mujoco.mjtJoint, int(self.model.body_jntadr[body])
        types = self.model.jnt_type[first : first + int(self.model.body_jntnum[body])].tolist()
        slides, hinges = types.count(kinds.mjJNT_SLIDE), types.count(kinds.mjJNT_HINGE)
        return types == [kinds.mjJNT_FREE] or (slides, hinges, len(types)) == (3, 3, 6)

    def pose_of(self, body: int) -> FloatArray:
        """Return the (4, 4) pose of a body in the world, m."""
        return mj_pose(self.data.xquat[body], self.data.xpos[body])

    def touching_geoms(self, inside: NDArray[np.bool_]) -> list[int]:
        """Return the geoms of the masked bodies that can touch any other geom."""
        model = self.model
        touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        for geom in (*model.pair_geom1, *model.pair_geom2):
            touches[geom] = True
        return np.flatnonzero(inside[model.geom_bodyid] & touches).tolist()

    def emit(
        self,
        subject: str,
        message: str,
        advice: str,
        code: FindingCode = FindingCode.LEFT_OUT_OF_MJCF,
    ) -> None:
        """Emit a finding, by default on something that is left out."""
        emit(Finding(code, subject, f"{self.source.path}: {message}", advice))

    def _set_coordinates(self, data: Any, keyframe: str | int | None) -> None:
        """Set the positions of joints and bodies from data or a keyframe."""
        model, count = self.model, self.model.nkey
        if data is not None:
            if keyframe is not None:
                raise ArgumentError(
                    "keyframe", "is not supported together with data; give one of them"
                )
            if not isinstance(data, type(self.data)):
                raise ArgumentError("data", f"is {data!r:.80}; it must be the model's MjData")
            if data.qpos.shape != self.data.qpos.shape or len(data.xpos) != model.nbody:
                raise ArgumentError(
                    "data", f"has {len(data.qpos)} coordinates, but the model has {model.nq}; give "
                    "the data of this model"
                )  # fmt: skip
            for name in ("qpos", "mocap_pos", "mocap_quat", "xfrc_applied", "qfrc_applied"):
                getattr(self.data, name)[:] = getattr(data, name)
            return
        names = [model.key(k).name for k in range(count)]
        if keyframe is None:
            if count > 1:
                raise ArgumentError(
                    "keyframe", f"the file has {', '.join(map(repr, names))}; give one of these "
                    "keyframes, or data"
                )  # fmt: skip
            if not count:
                return
            keyframe = 0
        if isinstance(keyframe, str):
            if keyframe not in names:
                raise unknown_name("keyframe", "keyframe", keyframe, names)
            keyframe = names.index(keyframe)
        if not count:
            raise ArgumentError("keyframe", f"is {keyframe!r:.80}, but the model has no keyframes")
        number = whole_number("keyframe", keyframe, 0, count - 1)
        self._mujoco.mj_resetDataKeyframe(model, self.data, number)

    def _read_custom_text(self) -> dict[str, Any]:
        """Return the fields that `scene_to_mjcf` has written to the custom text."""
        model, kind = self.model, self._mujoco.mjtObj.mjOBJ_TEXT
        index = self._mujoco.mj_name2id(model, kind, CUSTOM_TEXT)
        if index < 0:
            return {}
        first, size = int(model.text_adr[index]), int(model.text_size[index])
        text = bytes(model.text_data[first : first + size]).rstrip(b"\0").decode()
        try:
            fields = json.loads(text)
        except ValueError as error:
            fields, fault = None, f"is not JSON ({error})"
        else:
            fault = "is not a JSON object with keys"
        if not isinstance(fields, dict):
            raise SceneError(
                f"{self.source.path}: the custom text {CUSTOM_TEXT!r} {fault}; remove it, or write "
                "the file again"
            )
        return fields

    def _hand_bodies(self, hand_body: str | None) -> tuple[int | None, NDArray[np.bool_]]:
        """Return the hand's first body, and the (nbody,) mask of its bodies."""
        source, count = self.source, self.model.nbody
        if hand_body is not None:
            names = [source.body(body) for body in range(1, count)]
            if hand_body not in names:
                raise unknown_name("hand_body", "body", hand_body, names)
            first = names.index(hand_body) + 1
            return first, self._subtree(first)
        if not motor_joints(source):
            jointed = np.flatnonzero(self.model.body_jntnum).tolist()
            if not all(self.is_free(body) for body in jointed):
                self.emit(
                    "hand",
                    "no joint has a motor, so the scene has no hand and no joint torques",
                    "add motors under <actuator>, or name the hand's first body as hand_body and "
                    "give effort_limits; otherwise bodies with joints are fixed supports",
                    FindingCode.NO_MOTORS,
                )
            return None, np.zeros(count, dtype=bool)
        first, inside = robot_bodies(source)
        inside[0] = False
        return first, inside

    def _object_body(self, name: str | None) -> int:
        """Return the object's body."""
        names = [self.source.body(body) for body in range(self.model.nbody)]
        free = [
            body
            for body in np.unique(tree_roots(self.model)).tolist()
            if body and not self.in_hand[body] and self.is_free(body)
        ]
        free_names = [names[body] for body in free]
        if name is None:
            if len(free) == 1:
                return free[0]
            found = f"has the free bodies {', '.join(free_names)}" if free else "has no free body"
            raise ArgumentError(
                "object_body", f"{self.source.path} {found}; name the object's body, which must "
                "have a free joint to the world"
            )  # fmt: skip
        if name not in names:
            raise unknown_name("object_body", "body", name, free_names)
        body = names.index(name)
        if self.in_hand[body]:
            raise SceneError(
                f"{self.source.path}: the object {name!r} is moved by motors or is part of the "
                "hand; name another body"
            )
        if body not in free:
            raise ArgumentError(
                "object_body", f"body {name!r} has no free joint to the world; "
                f"{names_in_words(name, free_names)}"
            )  # fmt: skip
        return body

    def _subtree(self, top: int) -> NDArray[np.bool_]:
        """Return the (nbody,) mask of a body and its descendants."""
        inside = np.zeros(self.model.nbody, dtype=bool)
        inside[top] = True
        for body in range(top + 1, self.model.nbody):
            inside[body] = inside[self.model.body_parentid[body]]
        return inside

    def _check_rigid_object(self) -> None:
        """Raise an error for an object with joints inside."""
        source, bodies = self.source, self.model.jnt_bodyid
        inside = np.flatnonzero(self.in_object[bodies] & (bodies != self.object)).tolist()
        if inside:
            listed = ", ".join(repr(source.joint(joint)) for joint in inside)
            raise SceneError(
                f"{source.path}: the object {source.body(self.object)!r} has joints inside "
                f"({listed}), but an object must be rigid; remove these joints"
            )


_MOST_NAMED = 4
"""Largest number of geoms in one message."""


class PairFriction:
    """Coefficients of sliding friction against the object."""

    def __init__(self, state: ModelState) -> None:
        """Set up the pairs with the object's geoms."""
        self._state, self._model = state, state.model
        self._own = state.touching_geoms(state.in_object)
        self._pairs = np.sort([self._model.pair_geom1, self._model.pair_geom2], axis=0).T
        self._differ: dict[str, list[float]] = {}
        self._beyond_sliding: set[str] = set()

    def smallest_coefficient(self, geom: int) -> float | None:
        """Return a geom's smallest one against the object's geoms; None: it can touch none."""
        each = [self._pair_coefficient(geom, own) for own in self._own]
        coefficients = [one for one in each if one is not None]
        if len(set(coefficients)) > 1:
            self._differ[self._geom_name(geom)] = sorted(set(coefficients))
        return min(coefficients, default=None)

    def emit(self) -> None:
        """Emit findings on what is left out of the requested pairs."""
        for name, values in self._differ.items():
            figures = ", ".join(f"{mu:g}" for mu in values)
            self._state.emit(
                name,
                f"the object's geoms have the coefficients of friction {figures} against {name!r}",
                "the smallest is used",
            )
        if self._beyond_sliding:
            names = sorted(self._beyond_sliding)
            self._state.emit(
                ", ".join(names),
                f"contacts with {first_of(names, _MOST_NAMED)} have torsional or rolling "
                "friction (condim above 3)",
                "only sliding friction is used",
            )

    def _pair_coefficient(self, geom: int, own: int) -> float | None:
        """Return the coefficient of two geoms; None: they cannot touch."""
        model = self._model
        pair = np.flatnonzero((self._pairs == sorted((geom, own))).all(axis=1))
        if len(pair):
            dimensions, friction = int(model.pair_dim[pair[0]]), model.pair_friction[pair[0]]
            sliding, other_friction = float(friction[:2].min()), friction[2:]
        elif not self._can_touch(geom, own):
            return None
        else:
            ranks = model.geom_priority[[geom, own]]
            used = [geom, own] if ranks[0] == ranks[1] else [(geom, own)[int(ranks.argmax())]]
            dimensions = int(model.geom_condim[used].max())
            friction = model.geom_friction[used].max(axis=0)
            sliding, other_friction = float(friction[0]), friction[1:]
        if dimensions > 3 and other_friction.any():
            self._beyond_sliding.add(self._geom_name(geom))
        return sliding if dimensions > 1 else 0.0

    def _can_touch(self, geom: int, other_geom: int) -> bool:
        """Return whether two geoms can touch each other."""
        model = self._model
        bodies = int(model.geom_bodyid[geom]), int(model.geom_bodyid[other_geom])
        excluded = [(first << 16) + last for first, last in (bodies, bodies[::-1])]
        types, affinities = model.geom_contype, model.geom_conaffinity
        touch = (types[geom] & affinities[other_geom]) or (types[other_geom] & affinities[geom])
        return bool(touch) and not np.isin(excluded, model.exclude_signature).any()

    def _geom_name(self, geom: int) -> str:
        return self._model.geom(geom).name or self._state.source.body(
            int(self._model.geom_bodyid[geom])
        )
