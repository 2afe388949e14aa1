"""A study: a scene, variables, samples and what is computed for each of them.

The scene of a sample reuses parts of earlier ones. A study may place the hand or close its fingers
before a sample is computed.
"""

from __future__ import annotations

import hashlib
import json
import reprlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from graspless_pin.algorithms.options import why_without_effect
from graspless_pin.caching import Bounded, is_alike
from graspless_pin.errors import GrasplessPinError, SceneError, StudyError
from graspless_pin.findings import capture
from graspless_pin.intake.files import FileKind, files_read, is_file, read_bytes
from graspless_pin.intake.yaml_source import Location, YamlSource, key_text, validated
from graspless_pin.intake.yaml_text import all_texts
from graspless_pin.planning.placing import HandPlacement, place_hand
from graspless_pin.scene.body_building import SceneParts
from graspless_pin.scene.entry_findings import materials_in_words, other_materials
from graspless_pin.scene.keys import Tree, deep_copy
from graspless_pin.scene.load import FIELDS_BY_KEY, build_scene
from graspless_pin.scene.poses import close_fingers
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.scene_schema import SCENE, SceneEntry
from graspless_pin.scene.units import in_radians, si_advice
from graspless_pin.solution import TorqueSolution
from graspless_pin.studies.keys import MOVABLE, Sample, Variable, displace, make_variable
from graspless_pin.studies.sampling import adaptive_samples, samples_of
from graspless_pin.studies.study_schema import CloseEntry, PlaceEntry, PosingEntry, StudyEntry

Row = dict[str, Any]
"""Results by column."""
NOT_PLACED = "not_placed"
"""Status of a sample whose hand has no place of the required rank."""
_MOST_FIELDS = 4096
_MOST_PLACEMENTS = 16
_LARGEST_BLOCK = 64
_LEAST_BLOCKS = 256
"""Least number of blocks where there are enough samples, for as many workers."""


@dataclass(eq=False)
class SampleParts(SceneParts):
    """Cache of parts of a study's scenes for later samples; it never changes a scene.

    Attributes:
        placements: The latest placements of the hand, by all data that they depend on.
    """

    placements: Bounded[str, HandPlacement] = field(
        default_factory=lambda: Bounded(_MOST_PLACEMENTS)
    )
    _last: tuple[Sample, Scene] | None = None
    _fields: dict[tuple[int, str], tuple[str, Any]] = field(default_factory=dict)
    _names: tuple[str, ...] = ()

    def scene_if_known(self, sample: Sample) -> Scene | None:
        """Return the scene of a sample from the last scene and cached fields.

        Args:
            sample: The values of all variables.

        Returns:
            The scene; None if a changed value has no cached field: build it, then `learn` it.
        """
        if self._last is None:
            return None
        fields, (last_sample, scene) = {}, self._last
        for index, (value, last_value) in enumerate(zip(sample, last_sample, strict=True)):
            if not is_alike(value, last_value):
                known = self._fields.get((index, repr(value)))
                if known is None:
                    return None
                fields[known[0]] = known[1]
        scene = scene._with_fields(fields)
        self._last = sample, scene
        return scene

    def learn(self, variables: Sequence[Variable], sample: Sample) -> None:
        """Cache those fields of the scene built last that depend on one variable alone.

        Args:
            variables: The variables.
            sample: Their values in that scene.
        """
        if self.last is None:
            return
        entry, bodies, scene = self.last
        has_findings = scene.load_findings or (scene.hand is not None and scene.hand.findings)
        # Scenes with findings are built anew, to report them again; so are those that refuse them.
        self._last = None if has_findings or entry.warnings == "error" else (sample, scene)
        if bodies.names != self._names or len(self._fields) > _MOST_FIELDS:
            self._fields, self._names = {}, bodies.names
        keys = [{location[0] for location, *_ in variable.targets} for variable in variables]
        for index, own_keys in enumerate(keys):
            other_keys = set().union(*keys[:index], *keys[index + 1 :])
            names = {FIELDS_BY_KEY.get(str(key)) for key in own_keys - other_keys}
            name = names.pop() if len(own_keys) == len(names) == 1 else None
            if name is not None:
                self._fields[index, repr(sample[index])] = name, vars(scene)[name]


class SolutionWriter(Protocol):
    """Stores the solutions of samples, in the process that computes them."""

    def __call__(self, number: int, scene: Scene, solution: TorqueSolution) -> None:
        """Store the solution of a sample.

        Raises:
            GrasplessPinError: If it cannot be stored, which ends the study.
        """

    def has(self, number: int) -> bool:
        """Return whether the solution of a sample is stored."""
        ...


@dataclass(frozen=True, eq=False)
class Study:
    """A study, checked without computing samples. Make one with `load_study`.

    See the example of `run_study`.

    Attributes:
        entry: Content of the study file.
        source: The study file.
        scene: The scene file with the study's options in its ``solve`` section.
        variables: The variables, in the order of the file.
        samples: The values of all variables, sample by sample, computed when they are asked for;
            of an adaptive study those of the first round.
        fingerprint: Hash of all that the results depend on except the versions of libraries.
        block: Number of consecutive samples in which each may start warm from those before it; 1:
            no warm starts.
        record: Stores each sample's solution as it is found; None: only its row is stored.
    """

    entry: StudyEntry
    source: YamlSource
    scene: YamlSource
    variables: tuple[Variable, ...]
    samples: Sequence[Sample]
    fingerprint: str
    block: int = 1
    record: SolutionWriter | None = None

    @property
    def name(self) -> str:
        """Its name, or that of its file."""
        return self.entry.name or self.source.path.stem

    @property
    def is_adaptive(self) -> bool:
        """Whether the outcomes of samples decide on further ones."""
        return self.entry.sampling.method == "adaptive"

    @classmethod
    def from_data(cls, data: Mapping[str, Any], folder: str | Path = ".") -> Study:
        """Make a study in Python from the content of a study file.

        Args:
            data: The keys ``scene``, ``vary``, ``sampling``, ``compute``, ...
            folder: The folder that the path of the scene is relative to.

        Raises:
            StudyError: See `load_study`.
        """
        if not isinstance(data, Mapping):
            raise StudyError(f"study: found {reprlib.repr(data)}; needs a mapping of keys")
        return _make_study(YamlSource(Path("study"), deep_copy(dict(data)), _STUDY), Path(folder))

    def unmoved_tree_at(self, sample: Sample) -> Tree:
        """Return the scene's tree with the keys of one sample set, before bodies are moved."""
        tree = self.scene.data
        for variable, value in zip(self.variables, sample, strict=True):
            tree = variable.with_value(tree, value)
        return tree

    def tree_at(self, sample: Sample) -> Tree:
        """Return the scene's tree at one sample, bodies moved."""
        tree = self.unmoved_tree_at(sample)
        motions = [
            (motion, (value - motion.as_in_scene) * variable.unit.factor)
            for variable, value in zip(self.variables, sample, strict=True)
            if (motion := variable.entry.move or variable.entry.turn) is not None
        ]
        if motions:
            tree = tree | {name: deep_copy(tree[name]) for name in MOVABLE if name in tree}
        for motion, amount in motions:
            displace(tree, motion, amount)
        return tree

    def scene_at(self, sample: Sample, parts: SampleParts | None = None) -> Scene:
        """Return the scene at one sample, its hand placed or closed where the study says so.

        Args:
            sample: The values of all variables, e.g. one of `samples`.
            parts: Cache from earlier samples; None: no cache.

        Raises:
            SceneError: If the scene cannot be used with these values, or the hand has no place.
            ArgumentError: If the hand cannot be placed or closed with these options.
        """
        scene, row = self.posed_at(sample, parts)
        if scene is None:
            raise SceneError(f"{self.scene.path}: {row['reason']}")
        return scene

    def posed_at(
        self, sample: Sample, parts: SampleParts | None = None
    ) -> tuple[Scene | None, Row]:
        """Return the scene of `scene_at`, or None, and the columns on the hand's place."""
        parts = parts or SampleParts()
        scene = self.unposed_at(sample, parts)
        if self.entry.place is None and self.entry.close is None:
            return scene, {}
        tree = self.tree_at(sample)
        entry = posing_of(scene, tree)
        if entry.place is not None:
            return _place_hand(scene, tree, entry.place, parts)
        return (scene, {}) if entry.close is None else _close_hand(scene, entry.close, parts)

    def unposed_at(self, sample: Sample, parts: SampleParts) -> Scene:
        """Return the scene at one sample before its hand is placed or closed."""
        scene = parts.scene_if_known(sample)
        if scene is None:
            file = self.scene
            tree = scene_and_posing(self.tree_at(sample))[0]
            content = YamlSource(file.path, tree, file.kind, file.lines)
            scene = build_scene(Scene, content, parts)
            parts.learn(self.variables, sample)
        return scene


def scene_and_posing(tree: Tree) -> tuple[Tree, Tree]:
    """Split a sample's tree into the scene's keys and those of `PosingEntry`."""
    posing = {name: tree[name] for name in PosingEntry.model_fields if name in tree}
    return {name: item for name, item in tree.items() if name not in posing}, posing


def posing_of(scene: Scene, tree: Tree) -> PosingEntry:
    """Return the entries ``place`` and ``close`` of a sample, validated."""
    assert scene.path is not None  # noqa: S101 - the scene of a study comes from a file
    return validated(YamlSource(scene.path, scene_and_posing(tree)[1], SCENE), PosingEntry)


def placement_of(scene: Scene, entry: PlaceEntry) -> HandPlacement:
    """Return the placement of the hand, without a time limit: time must not decide on rows."""
    return place_hand(scene, time_limit=None, workers=1, **entry.model_dump(exclude={"rank"}))


def _place_hand(
    scene: Scene, tree: Tree, entry: PlaceEntry, parts: SampleParts
) -> tuple[Scene | None, Row]:
    search = {**tree, "place": entry.model_dump(exclude={"rank"})}
    key = json.dumps(search, sort_keys=True, default=str)
    if key not in parts.placements:
        parts.placements[key] = placement_of(scene, entry)
    placement = parts.placements[key]
    row: Row = {"place_rank": entry.rank, "places_found": placement.found}
    if entry.rank <= placement.found:
        return placement.places[entry.rank - 1].scene, row
    if placement.places:
        reason = f"there is no place of rank {entry.rank}; places found: {placement.found}"
    else:
        faults = [f"{count} x {fault.words}" for fault, count in placement.faults.items()]
        reason = f"no place among {placement.tried} candidates: {'; '.join(faults)}"
    return None, {"status": NOT_PLACED, "found": False, **row, "reason": reason}


def _close_hand(scene: Scene, entry: CloseEntry, parts: SampleParts) -> tuple[Scene | None, Row]:
    # With the same hand and object the closed hand is the same object, and so are its contacts.
    sources = scene.hand, scene.object, repr(entry)
    result = parts.latest.value(
        "closed fingers", sources, lambda: close_fingers(scene, **entry.model_dump()).closing
    )
    untouching = [finger.finger for finger in result.fingers if not finger.touching]
    row: Row = {"open_fingers": "; ".join(untouching) or None}
    return scene.with_changes(hand=result.hand), row


def load_study(path: str | Path) -> Study:
    """Load a study file and the scene that it names.

    Args:
        path: The study file (YAML). The scene's path is relative to it.

    Raises:
        StudyError: Naming file, line and key, the value found and the values allowed.
        ArgumentError: If it is no path.
        SceneError: If the scene file itself is wrong.

    Examples:
        >>> from graspless_pin import load_study
        >>> study = load_study("examples/studies/allegro_box_load.yaml")
        >>> study.name
        'Allegro hand, box on a slope'
    """
    source = YamlSource.read(path, _STUDY)
    return _make_study(source, source.path.parent)


def _make_study(source: YamlSource, folder: Path) -> Study:
    if not isinstance(source.data, dict):
        raise StudyError(f"{source.where(())}: a study is a mapping with the keys scene, vary, ...")
    entry = validated(source, StudyEntry)
    fail = source.error
    file = folder / entry.scene
    if not is_file(file):
        raise fail(
            ("scene",), f"there is no file {str(file)!r}; paths are relative to the study file"
        )
    scene = YamlSource.read(file, SCENE)
    validated_scene = validated(scene, SceneEntry)
    _check_posing(entry, validated_scene, fail)
    tree = in_radians(scene.data)
    options = entry.compute.solve_options()
    tree["solve"] = {**(tree.get("solve") or {}), **options}
    tree |= deep_copy(scene_and_posing(source.data)[1])
    defaults = validated_scene.model_dump() | entry.model_dump(include={*PosingEntry.model_fields})
    variables = tuple(
        make_variable(
            name,
            variable_entry,
            tree,
            defaults,
            lambda part, message, name=name: fail(("vary", name, part), message),
        )
        for name, variable_entry in entry.vary.items()
    )
    _check_targets(entry, variables, options, fail)
    _check_materials(validated_scene, variables, fail)
    _check_algorithm(tree, variables, options, fail)
    make_samples = samples_of if entry.sampling.method != "adaptive" else adaptive_samples
    samples = make_samples(entry.sampling, variables, fail)
    return Study(
        entry=entry,
        source=source,
        scene=replace(scene, data=tree),
        variables=variables,
        samples=samples,
        fingerprint=_fingerprint(entry, replace(scene, data=tree), variables),
        block=_block_size(entry, tree, variables, len(samples)),
    )


def _block_size(entry: StudyEntry, tree: Tree, variables: tuple[Variable, ...], count: int) -> int:
    """Return the number of samples in a block of warm starts.

    It has to depend on the study alone. It is 1 under a time limit: time would decide on the
    outcome of a sample, and through warm starts on later ones.
    """
    limits = entry.compute.sample_time_limit, tree["solve"].get("time_limit")
    of_time = ("solve",), ("solve", "time_limit")
    varies_time = any(place in of_time for one in variables for place, *_ in one.targets)
    if varies_time or any(limit is not None for limit in limits):
        return 1
    return max(1, min(_LARGEST_BLOCK, count // _LEAST_BLOCKS))


def _check_posing(entry: StudyEntry, scene: SceneEntry, fail: Any) -> None:
    """Refuse to place or close the hand in a scene without a hand, or with stated contacts."""
    for key in PosingEntry.model_fields:
        if getattr(entry, key) is not None and scene.hand is None:
            raise fail((key,), "the scene has no hand; add a hand, or leave this key out")
        if getattr(entry, key) is not None and scene.contacts is not None:
            raise fail(
                (key,),
                "the scene states its contacts, which would stay where they are; leave 'contacts' "
                "out of the scene to have them found from the shapes",
            )


def _check_targets(
    entry: StudyEntry, variables: tuple[Variable, ...], options: Mapping[str, Any], fail: Any
) -> None:
    """Refuse two variables that set the same key, or a key below another one's.

    Refuse keys of ``place`` or ``close`` in a study without that section, too.
    """
    taken = {("solve", name): "compute" for name in options}
    for variable in variables:
        for location, _, _ in variable.targets:
            key = str(location[0])
            if key in PosingEntry.model_fields and getattr(entry, key) is None:
                raise fail(
                    ("vary", variable.name),
                    f"sets {key_text(location)}, but the study has no {key!r}; add '{key}: {{}}'",
                )
            for taken_key, name in taken.items():
                shared = min(len(location), len(taken_key))
                if location[:shared] == taken_key[:shared]:
                    raise fail(
                        ("vary", variable.name),
                        f"sets {key_text(location)}, which {name!r} sets already; keep one of them",
                    )
        taken |= {location: variable.name for location, _, _ in variable.targets}


def _check_materials(entry: SceneEntry, variables: tuple[Variable, ...], fail: Any) -> None:
    """Refuse to vary a pair of materials that no two bodies have."""
    keys: list[Location] = [("object", "material"), ("hand", "material")]
    keys += [("supports", index, "material") for index in range(len(entry.supports))]
    targets = [(variable, location) for variable in variables for location, *_ in variable.targets]
    if any(key[: len(location)] == location for key in keys for _, location in targets):
        return
    own, others = entry.object.material, other_materials(entry)
    pairs = [frozenset((own, other)) for other in others]
    for variable, location in targets:
        if (
            len(location) == 3
            and location[0] == "materials"
            and frozenset(location[1:]) not in pairs
        ):
            raise fail(
                ("vary", variable.name),
                f"sets {key_text(location)}, which has no effect: "
                f"{materials_in_words(own, others)}",
            )


def _check_algorithm(
    tree: Tree, variables: tuple[Variable, ...], options: Mapping[str, Any], fail: Any
) -> None:
    """Refuse options that the algorithm does not use."""
    varied = {
        location[1]: variable.name
        for variable in variables
        for location, *_ in variable.targets
        if len(location) > 1 and location[0] == "solve"
    }
    if "algorithm" in varied:
        return
    algorithm = tree["solve"].get("algorithm", "margin")
    for key in (*options, *varied):
        if reason := why_without_effect(str(key), algorithm):
            if key in options:
                raise fail(("compute", key), reason)
            name, scene_key = varied[key], f"solve.{key}"
            raise fail(("vary", name), reason if name == scene_key else f"{scene_key} {reason}")


def _fingerprint(entry: StudyEntry, scene: YamlSource, variables: tuple[Variable, ...]) -> str:
    """Return the hash of study, scene and all files that are named by the scene or by its files."""
    stated = entry.model_dump(mode="json", exclude={"name", "description", "scene"})
    folder, tree = scene.path.parent, scene.data
    named_files: dict[str, Path] = {}
    with capture(), files_read() as read:
        for variant in (
            tree,
            *(v.with_value(tree, end) for v in variables for end in v.extremes()),
        ):
            present = {text: folder / text for text in all_texts(variant) if is_file(folder / text)}
            if variant is tree or present.keys() - named_files.keys():
                named_files |= present
                with suppress(GrasplessPinError):  # reported in the rows of its samples
                    build_scene(Scene, replace(scene, data=scene_and_posing(variant)[0]))
    # Files inside of a glTF are left out: they are known only if it was not read before.
    inner = {(path.name, path) for path in read.values() if path.suffix.lower() not in _OF_GLTF}
    files = {
        (name, hashlib.sha256(read_bytes(path, _NAMED)).hexdigest())
        for name, path in {*named_files.items(), *inner}
    }
    content = json.dumps([stated, tree, sorted(files)], sort_keys=True, default=str)
    return hashlib.sha256(content.encode()).hexdigest()


_OF_GLTF = (".bin", ".png", ".jpg", ".jpeg")
_STUDY = FileKind("study", 4, StudyError, si_advice)
_NAMED = FileKind("file of a scene", 64, StudyError)
