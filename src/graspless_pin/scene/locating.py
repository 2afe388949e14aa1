"""What is made of parts of a scene file, with errors that name the part and what was found."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from graspless_pin.errors import ArgumentError, GrasplessPinError, SceneError
from graspless_pin.scene.messages import key_text
from graspless_pin.scene.yaml_source import Location, YamlSource

_Made = TypeVar("_Made")


class Locator:
    """Locates errors and paths in one scene file.

    Attributes:
        source: The file.
    """

    def __init__(self, source: YamlSource) -> None:
        """Take the file."""
        self.source = source
        self._folder = source.path.resolve().parent

    def error(self, location: Location, message: str) -> SceneError:
        """Return the error for a part of the file."""
        return SceneError(f"{self.source.where(location)}: {key_text(location)}: {message}")

    def at(self, location: Location, make: Callable[[], _Made], also: Location = ()) -> _Made:
        """Return what is made of one part of the file; an error names that part.

        Args:
            location: The part.
            make: Makes it.
            also: Deeper part to name where the error is about no argument but a file or name.
        """
        try:
            return make()
        except SceneError:
            raise
        except ArgumentError as error:
            inner = (*location, *_keys(error.argument))
            if self.source.has(inner):
                message = str(error).removeprefix(f"{error.argument}: ")
                raise self.error(inner, message) from error
            raise self.error(location, str(error)) from error
        except GrasplessPinError as error:
            raise self.error((*location, *also), str(error)) from error
        except OSError as error:
            message = f"a file cannot be read ({error}); check it"
            raise self.error((*location, *also), message) from error

    def path(self, text: str) -> Path:
        """Return the path that a text of the file means: relative to the file."""
        path = Path(text)
        return path if path.is_absolute() else self._folder / path


def _keys(argument: str) -> tuple[str, ...]:
    """Split an argument's name such as ``q['joint_1.0']`` into keys of the file."""
    return tuple(
        quoted or plain for quoted, plain in re.findall(r"\['(.*?)'\]|([^.\[\]]+)", argument)
    )
