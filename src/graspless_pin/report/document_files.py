"""Documents of many solutions at once: one file for each waypoint of a path, or study sample."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from graspless_pin.errors import SceneError
from graspless_pin.planning import PathProfile
from graspless_pin.report.document import solution_document, write_document
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution


def write_path_documents(profile: PathProfile, folder: str | Path) -> tuple[Path, ...]:
    """Write the document of each waypoint's solution, with its proof.

    The files are ``waypoint_0000.json`` and so on, and ``waypoint_0003_arrival.json`` where the
    motion that ends at a waypoint has a solution of its own. A waypoint that was not solved,
    such as one without any contact, has no document.

    Args:
        profile: The profile of a path.
        folder: Where they go; it is made if need be.

    Returns:
        The files written.

    Raises:
        SceneError: If one cannot be written.

    Examples:
        >>> from graspless_pin import Waypoint, evaluate_path, load_scene
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.report import write_path_documents
        >>> scene = load_scene("examples/trihand_pivot_box.yaml")
        >>> profile = evaluate_path(scene, [Waypoint(time=0.0), Waypoint(time=1.0)])
        >>> with TemporaryDirectory() as folder:
        ...     len(write_path_documents(profile, folder))
        2
    """
    made = _made(Path(folder))
    files = []
    for k, (leaving, arriving) in enumerate(
        zip(profile.evaluations, profile.arrivals, strict=True)
    ):
        for name, state in (("", leaving), ("_arrival", arriving)):
            if state.has_contacts and (not name or state is not leaving):
                file = made / f"waypoint_{k:04d}{name}.json"
                write_document(solution_document(state.solution, state.scene), file)
                files.append(file)
    return tuple(files)


@dataclass(frozen=True)
class SampleDocuments:
    """Writes the document of each sample of a study: ``sample_000000.json`` and so on.

    Attributes:
        folder: Where they go.
    """

    folder: Path

    def __post_init__(self) -> None:
        """Make the folder."""
        _made(self.folder)

    def file(self, number: int) -> Path:
        """Return the file of a sample."""
        return self.folder / f"sample_{number:06d}.json"

    def __call__(self, number: int, scene: Scene, solution: TorqueSolution) -> None:
        """Write the document of a sample."""
        write_document(solution_document(solution, scene), self.file(number))

    def has(self, number: int) -> bool:
        """Return whether a sample has its document."""
        return self.file(number).is_file()


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"{folder}: cannot be made ({error.strerror})") from error
    return folder
