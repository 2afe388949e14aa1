"""Convex decomposition: pieces that fill the mesh, and a cache that never answers wrongly."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from cutting_faults import crashes, never, no_pieces, slow
from cutting_here import cut_here

from graspless_pin import progress
from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import ArgumentError, GrasplessPinWarning, MeshError
from graspless_pin.geometry.bodies import decomposition
from graspless_pin.geometry.bodies.decomposition import Cut, convex_pieces
from graspless_pin.geometry.bodies.shapes import MeshShape


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache folder of this test alone."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "graspless_pin" / "convex"


def ell(size: float = 1.0) -> trimesh.Trimesh:
    flat = trimesh.creation.box(bounds=[[0, 0, 0], [0.4, 0.1, 0.1]])
    tall = trimesh.creation.box(bounds=[[0, 0, 0], [0.1, 0.1, 0.4]])
    mesh = trimesh.boolean.union([flat, tall])
    mesh.apply_scale(size)
    return mesh


def joined(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    """All faces of several meshes as one mesh."""
    whole = trimesh.util.concatenate(list(meshes))
    assert isinstance(whole, trimesh.Trimesh)
    return whole


def volume(pieces: tuple[np.ndarray, ...]) -> float:
    return sum(trimesh.convex.convex_hull(piece).volume for piece in pieces)


def same(first: tuple[np.ndarray, ...], second: tuple[np.ndarray, ...]) -> bool:
    return len(first) == len(second) and all(map(np.array_equal, first, second))


def forbid(patch: pytest.MonkeyPatch) -> None:
    """Make every further cut an error."""

    def cut(*_: object) -> None:
        raise AssertionError("cut again")

    patch.setattr(decomposition, "_cut_pieces", cut)


def pretend(patch: pytest.MonkeyPatch, *pieces: np.ndarray) -> list[int]:
    """Let every cut have these pieces; the list grows with each."""
    cuts: list[int] = []

    def cut(*_: object) -> list[np.ndarray]:
        cuts.append(1)
        return [piece.copy() for piece in pieces]

    patch.setattr(decomposition, "_cut_pieces", cut)
    return cuts


BAR = np.array(trimesh.creation.box([0.1] * 3).vertices)


def test_an_ell_becomes_two_bars_which_are_kept(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pieces = convex_pieces(ell(), "ell")
    assert len(pieces) == 2
    assert volume(pieces) == pytest.approx(0.007, rel=1e-3)
    assert [file.suffix for file in cache.iterdir()] == [".npz"]
    forbid(monkeypatch)
    again = convex_pieces(ell(), "ell")
    assert same(again, pieces)
    assert not any(piece.flags.writeable for piece in (*pieces, *again))
    # Another mesh and another way of cutting are cut anew.
    for mesh, concavity in ((ell(1.01), 0.02), (ell(), 0.03)):
        with pytest.raises(AssertionError, match="cut again"):
            convex_pieces(mesh, "ell", Cut(concavity))


def test_pieces_do_not_depend_on_the_way_the_faces_turn(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cut_here(monkeypatch)
    inside_out = ell()
    inside_out.invert()
    assert volume(convex_pieces(inside_out, "ell")) == pytest.approx(0.007, rel=1e-3)
    assert inside_out.volume < 0.0  # the mesh that was given is left alone


def test_a_convex_mesh_stays_whole_and_is_not_kept(cache: Path) -> None:
    (piece,) = convex_pieces(trimesh.creation.box([0.1, 0.2, 0.3]), "box")
    assert len(piece) == 8
    assert not cache.exists()


def test_parts_that_only_touch_are_cut_apart_exactly() -> None:
    blocks = [
        trimesh.creation.box(bounds=[[0, 0, z], [0.1, 0.1, z + 0.1]]) for z in (0.0, 0.1, 0.3)
    ]
    pieces = convex_pieces(joined(*blocks), "blocks")
    assert len(pieces) == 3
    assert volume(pieces) == pytest.approx(0.003)


def test_a_hollow_within_is_no_part(monkeypatch: pytest.MonkeyPatch) -> None:
    hollow = trimesh.creation.box([0.1] * 3)
    hollow.invert()
    given: list[int] = []

    def call(_child: Any, _function: Any, vertices: Any, faces: Any, *_: Any, **__: Any) -> Any:
        given.append(len(faces))
        return [vertices]

    monkeypatch.setattr(ChildProcess, "call", call)
    convex_pieces(joined(trimesh.creation.box([0.2] * 3), hollow), "shell")
    assert given == [24]


def test_a_damaged_file_is_cut_and_written_anew(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cuts = pretend(monkeypatch, BAR, BAR + 1.0)
    pieces = convex_pieces(ell(), "ell")
    (file,) = cache.iterdir()
    points, counts = np.concatenate(pieces), [len(piece) for piece in pieces]
    damages = [file.read_bytes()[: file.stat().st_size // 2], b"PK nonsense", b""]
    for wrong in ({"points": points * np.nan}, {"counts": [len(points) + 1]}):
        np.savez(file, **{"points": points, "counts": counts, **wrong})
        damages.append(file.read_bytes())
    for count, damage in enumerate(damages, 2):
        file.write_bytes(damage)
        for _ in range(2):
            assert same(convex_pieces(ell(), "ell"), pieces)
        assert len(cuts) == count
        assert list(cache.iterdir()) == [file]


def test_a_cache_that_is_none(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A relative home of caches is ignored; one that cannot be written costs a warning."""
    pretend(monkeypatch, BAR)
    (tmp_path / "cache").write_text("a file where the folder should be")
    with pytest.warns(GrasplessPinWarning, match="cannot be kept in .* set XDG_CACHE_HOME"):
        assert len(convex_pieces(ell(), "ell")) == 1
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    convex_pieces(ell(), "ell")
    assert len(list((tmp_path / ".cache" / "graspless_pin" / "convex").iterdir())) == 1


def test_an_open_mesh_is_wrapped_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cut_here(monkeypatch)
    mesh = ell()
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    with pytest.warns(GrasplessPinWarning, match="ell is not watertight"):
        pieces = convex_pieces(mesh, "ell", Cut(1.0))
    low, high = np.concatenate(pieces).min(axis=0), np.concatenate(pieces).max(axis=0)
    assert np.allclose([low, high], [[0, 0, 0], [0.4, 0.1, 0.4]], atol=0.01)


def test_a_mesh_that_cannot_be_cut_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decomposition, "run_coacd", no_pieces)
    with pytest.raises(MeshError, match="ell cannot be cut into convex pieces; repair it"):
        convex_pieces(ell(), "ell")
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(MeshError, match="sheet encloses no volume"):
        convex_pieces(flat, "sheet")


def test_a_cut_ends_at_its_time_limit(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also inside a native call; nothing is kept, and another try may take longer."""
    with monkeypatch.context() as patch:
        patch.setattr(decomposition, "run_coacd", never)
        message = r"ell is not cut .* after 0\.5 s; simplify or repair it, .*'decompose_time_limit'"
        with pytest.raises(MeshError, match=message):
            convex_pieces(ell(), "ell", Cut(time_limit=0.5))
        assert not cache.exists()
    assert len(convex_pieces(ell(), "ell")) == 2


def test_the_time_limit_is_for_all_parts_of_a_mesh(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decomposition, "run_coacd", slow)
    parts = [ell().apply_translation([0.0, place, 0.0]) for place in range(3)]
    with pytest.raises(MeshError, match=r"ells is not cut .* after 0\.5 s"):
        convex_pieces(joined(*parts), "ells", Cut(time_limit=0.5))
    assert len(convex_pieces(joined(*parts), "ells")) == 3


def test_a_mesh_has_no_more_pieces_than_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They are merged, so that all of it is still inside; a limit that is met changes nothing."""
    cut_here(monkeypatch)
    mesh = ell()
    free = convex_pieces(mesh, "ell", Cut(0.1))
    assert len(free) == 2
    (merged,) = convex_pieces(mesh, "ell", Cut(0.1, max_pieces=1))
    assert volume((merged,)) > volume(free)
    assert same(convex_pieces(mesh, "ell", Cut(0.1, max_pieces=2)), free)
    np.testing.assert_allclose(merged.min(axis=0), mesh.bounds[0], atol=0.02)
    np.testing.assert_allclose(merged.max(axis=0), mesh.bounds[1], atol=0.02)
    two = joined(mesh, ell().apply_translation([1.0, 0.0, 0.0]))
    assert len(convex_pieces(two, "ells", Cut(0.1, max_pieces=3))) <= 3
    with pytest.raises(MeshError, match="has 2 unconnected parts, more than max_pieces"):
        convex_pieces(two, "ells", Cut(0.1, max_pieces=1))
    for wrong in (0, 1001, 2.0, True):
        with pytest.raises(ArgumentError, match=r"max_pieces: is .*; it must be (a whole|from 1)"):
            Cut(max_pieces=wrong)  # pyright: ignore[reportArgumentType]


def test_coacd_itself_is_ended(cache: Path) -> None:
    """A few triangles that would take it many seconds."""
    mesh = joined(*(ell().apply_translation([0.02 * n, 0.05 * n, 0.0]) for n in range(8)))
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    with (
        pytest.warns(GrasplessPinWarning, match="not watertight"),
        pytest.raises(MeshError, match=r"ells is not cut .* after 0\.3 s"),
    ):
        convex_pieces(mesh, "ells", Cut(0.01, time_limit=0.3))


def test_a_crash_of_coacd_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decomposition, "run_coacd", crashes)
    with pytest.raises(MeshError, match=r"ell cannot be cut .* ended by SIGSEGV; repair it"):
        convex_pieces(ell(), "ell")


def test_slow_work_shows_that_it_goes_on(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """One line where nobody looks; nothing for what is done at once."""
    monkeypatch.setattr(decomposition, "run_coacd", slow)
    monkeypatch.setattr(progress, "_SHOWN_AFTER", 30.0)
    convex_pieces(ell(), "ell")
    assert capfd.readouterr().err == ""
    monkeypatch.setattr(progress, "_SHOWN_AFTER", 0.0)
    convex_pieces(ell(2.0), "ell")
    shown = capfd.readouterr()
    assert shown.out == ""
    assert shown.err == "cutting ell into convex pieces, for 60 s at most\n"


def test_a_changed_file_is_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, BAR, BAR + 1.0)
    path = tmp_path / "part.ply"
    ell().export(path)
    assert len(MeshShape(path, 1.0, "decompose").pieces()) == 2
    trimesh.creation.box([0.1] * 3).export(path)
    assert len(MeshShape(path, 1.0, "decompose").pieces()) == 1


def test_the_choice_is_checked() -> None:
    path = Path("part.stl")
    with pytest.raises(ArgumentError, match="convex: is 'soup'; it must be one of 'hull'"):
        MeshShape(path, 1.0, "soup")  # pyright: ignore[reportArgumentType]
    for value in (0.0, 0.001, 1.5):
        with pytest.raises(ArgumentError, match=r"concavity: needs 0\.01 to 1, got"):
            MeshShape(path, 1.0, "decompose", value)
    for value in (0.0, -1.0, 1e7):
        with pytest.raises(ArgumentError, match="decompose_time_limit: needs seconds above 0"):
            MeshShape(path, 1.0, "decompose", 0.02, value)
    for value in (float("nan"), float("inf"), True, "60"):
        with pytest.raises(ArgumentError, match=r"decompose_time_limit: is .* a finite number"):
            MeshShape(path, 1.0, "decompose", 0.02, value)  # pyright: ignore[reportArgumentType]
