"""Every error that graspless_pin raises on purpose, under one root class.

An infeasible problem is not an error: it is a solution whose ``found`` is False.
"""

from __future__ import annotations


class GrasplessPinError(Exception):
    """Root of all errors raised by this package."""


class ArgumentError(GrasplessPinError, ValueError):
    """An argument has a wrong shape, a wrong value or contradicts another one.

    Attributes:
        argument: Name of the offending argument.
    """

    def __init__(self, argument: str, message: str) -> None:
        """Build the message ``argument: message``."""
        super().__init__(f"{argument}: {message}")
        self.argument = argument


class SceneError(GrasplessPinError, ValueError):
    """A scene file, or what it describes, cannot be used."""


class StudyError(GrasplessPinError, ValueError):
    """A study, or the file that its results go to, cannot be used."""


class RobotError(GrasplessPinError, ValueError):
    """A URDF, robot file or named robot model cannot be used."""


class MeshError(GrasplessPinError, ValueError):
    """A mesh file is missing, unreadable or has no volume."""


class NoSolutionError(GrasplessPinError, RuntimeError):
    """Torques, forces or a mode were asked of a solution that has none."""


class SolverUnavailableError(GrasplessPinError, ValueError):
    """The named solver is not known or not installed."""


class GrasplessPinWarning(UserWarning):
    """Root of all warnings issued by this package."""


class PlaceholderEffortWarning(GrasplessPinWarning):
    """An effort limit looks like a placeholder rather than a motor's limit."""


class DanglingMimicWarning(GrasplessPinWarning):
    """A mimic joint follows a joint that does not exist or cannot move."""


class MeshScaleWarning(GrasplessPinWarning):
    """A mesh is so large or so small that its unit is probably not the metre."""
