"""All errors that graspless_pin raises deliberately, under one root class.

An infeasible problem is not an error: it is a solution whose ``found`` is False.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import PurePath
from typing import Self

__all__ = [
    "ArgumentError",
    "CrashError",
    "GrasplessPinError",
    "GrasplessPinWarning",
    "JointLimitError",
    "MeshError",
    "NoSolutionError",
    "OverrunError",
    "RobotError",
    "SceneError",
    "SolverUnavailableError",
    "StateError",
    "StateFault",
    "StudyError",
    "TextError",
    "UndecidedMotionError",
]


class GrasplessPinError(Exception):
    """Root of all errors raised by this package.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin import GrasplessPinError
        >>> try:
        ...     load_scene("no_such_scene.yaml")
        ... except GrasplessPinError as error:
        ...     print(error)
        no_such_scene.yaml: there is no such file; check the path
    """


@contextmanager
def optional_import(
    what: str, extra: str, kind: type[Exception] = GrasplessPinError, *, instead: str = ""
) -> Iterator[None]:
    """Turn an import error in the block into one that says which extra of this package to install.

    Args:
        what: What needs the import, as a clause: ``"plots need matplotlib"``.
        extra: Name of the extra.
        kind: Class of the error to raise.
        instead: An alternative, after a comma.

    Raises:
        Exception: Of class ``kind``, if an import fails.
    """
    try:
        yield
    except ImportError as error:
        advice = f"install it with pip install 'graspless-pin[{extra}]'{instead}"
        raise kind(f"{what} ({error}); {advice}") from None


class ArgumentError(GrasplessPinError, ValueError):
    """An argument has a wrong shape, a wrong value or contradicts another one.

    See the example of `GrasplessPinError`.

    Attributes:
        argument: Name of the offending argument.
        message: What is wrong with it.
    """

    def __init__(self, argument: str, message: str) -> None:
        """Create the error from the argument's name and what is wrong with it."""
        # Both are the exception's arguments, so that it can be pickled for another process.
        super().__init__(argument, message)
        self.argument, self.message = argument, message

    def __str__(self) -> str:
        """Return ``argument: message``."""
        return f"{self.argument}: {self.message}"


class JointLimitError(ArgumentError):
    """A given joint position is outside its limits. See the example of `GrasplessPinError`."""


class SceneError(GrasplessPinError, ValueError):
    """A scene file, or what it describes, cannot be used.

    See the example of `GrasplessPinError`.
    """

    def at(self, where: str) -> Self:
        """Return the same error with a location before its message."""
        return type(self)(*self.args[:-1], f"{where}: {self}")


class StateFault(Enum):
    """Faults of a state of a valid scene; the value is the message.

    See the example of `GrasplessPinError`.
    """

    NO_CONTACT = "nothing touches the object"
    OVERLAP = "bodies overlap by more than max_penetration"
    BLOCKED = "the motion drives the object into a body"
    PARTED = "the motion separates the object from all bodies that touch it"
    AMBIGUOUS = "a hybrid finger touches the object at several points"


class StateError(SceneError):
    """A scene has no problem to solve in this state, but may have one with other poses or motions.

    See the example of `GrasplessPinError`.

    Attributes:
        kind: The fault.
    """

    def __init__(self, kind: StateFault, message: str) -> None:
        """Create the error from the fault and the message that names the bodies."""
        super().__init__(kind, message)
        self.kind = kind

    def __str__(self) -> str:
        """Return the message."""
        return str(self.args[1])


class StudyError(GrasplessPinError, ValueError):
    """A study, or the file that its results go to, cannot be used.

    See the example of `GrasplessPinError`.
    """


class RobotError(GrasplessPinError, ValueError):
    """A URDF, robot file or named robot model cannot be used.

    See the example of `GrasplessPinError`.
    """


class MeshError(GrasplessPinError, ValueError):
    """A mesh file is missing, unreadable or has no volume.

    See the example of `GrasplessPinError`.
    """


class TextError(GrasplessPinError):
    """A text is not YAML, JSON or XML as this package reads it.

    See the example of `GrasplessPinError`.

    Attributes:
        line: Number of the line, from 1; None: not known.
    """

    def __init__(self, message: str, line: int | None = None) -> None:
        """Create the error from its message and the line."""
        super().__init__(message, line)
        self.line = line

    def __str__(self) -> str:
        """Return the message."""
        return str(self.args[0])


class NoSolutionError(GrasplessPinError, RuntimeError):
    """Torques, forces or a mode of a solution were read that has none.

    See the example of `GrasplessPinError`.
    """


class SolverUnavailableError(GrasplessPinError, ValueError):
    """The named solver is unknown or not installed.

    See the example of `GrasplessPinError`.
    """


class UndecidedMotionError(GrasplessPinError, ArithmeticError):
    """No solver decided whether a mode has a virtual motion.

    `maximize_margin`, `minimize_torque` and `Evaluator` turn it into a status.

    See the example of `GrasplessPinError`.
    """


class CrashError(GrasplessPinError, RuntimeError):
    """A child process ended during a computation.

    See the example of `GrasplessPinError`.
    """


class OverrunError(GrasplessPinError, TimeoutError):
    """A computation exceeded its limit of time or nodes.

    See the example of `GrasplessPinError`.
    """


class GrasplessPinWarning(UserWarning):
    """The warning of this package: a finding outside `findings.capture`.

    See the example of `GrasplessPinError`.

    Attributes:
        finding: A `graspless_pin.Finding`: its ``code`` says which kind it is.
    """

    def __init__(self, finding: object) -> None:
        """Create the warning from a finding."""
        super().__init__(finding)
        self.finding = finding


def internal_error(error: BaseException) -> str:
    """Return one short line on an unexpected error and its line in this package, for a report."""
    where, traceback = "", error.__traceback__
    while traceback is not None:
        path = PurePath(traceback.tb_frame.f_code.co_filename)
        if __package__ in path.parts:
            where = f" in {path.name}, line {traceback.tb_lineno}"
        traceback = traceback.tb_next
    words = " ".join(str(error).split())
    words = words if len(words) <= 200 else f"{words[:200]} [...]"
    return f"internal error{where}: {type(error).__name__}{words and f': {words}'}"
