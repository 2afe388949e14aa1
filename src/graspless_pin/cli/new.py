"""``graspless-pin new``: a first scene of a robot and an object."""

from __future__ import annotations

import json
import math
import re
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from graspless_pin.atomic_write import draft_of
from graspless_pin.cli.outcome import ExitCode, echo_note, number_of, plain_errors
from graspless_pin.cli.outputs import (
    OutputKind,
    OverwriteOption,
    check_inputs_stay,
    check_output,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.findings import Finding, FindingCode, capture, emit
from graspless_pin.geometry.bodies.shapes import SHAPES, MeshShape, Shape
from graspless_pin.progress import waiting_for
from graspless_pin.scene import scene_json_schema
from graspless_pin.scene.new_scene import SCHEMA_FILE, NewSceneText, new_scene_text
from graspless_pin.scene.saving import write_scene_file
from graspless_pin.suggestions import first_of, names_in_words

_PRIMITIVES = {
    kind: ",".join(
        "X,Y,Z" if shape.lengths().get(key.name) == 3 else key.name.upper() for key in fields(shape)
    )
    for kind, shape in SHAPES.items()
    if shape.lengths()
}
_LENGTHS = ", ".join(f"{kind}:{names}" for kind, names in _PRIMITIVES.items())
_STEEPEST = 80.0  # degrees
_MOST_NAMED = 4
_UNITS = {"deg": 1.0, "°": 1.0, "rad": 180.0 / math.pi}


def new(
    robot: Annotated[
        str,
        typer.Argument(
            metavar="ROBOT",
            help="A URDF, xacro, MJCF or robot file, or the name of a robot, see graspless-pin "
            "robots.",
        ),
    ],
    obj: Annotated[
        str,
        typer.Argument(
            metavar="OBJECT",
            help="A mesh file (STL, OBJ, DAE, PLY, glTF), or a shape with its lengths in metres: "
            f"{_LENGTHS}.",
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="SCENE", help="The scene file to write.")
    ] = Path("scene.yaml"),
    effort: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]N_M",
            help="Effort limit, N m (N for prismatic joints and tendons). Without NAME: of all "
            "actuators whose limit the robot's files do not state. With NAME: of this finger, "
            "joint or tendon. May be repeated.",
        ),
    ] = None,
    support: Annotated[
        str, typer.Option(metavar="flat|slope:30deg", help="What the object rests on.")
    ] = "flat",
    mass: Annotated[float | None, typer.Option(help="Mass of the object, kg.")] = None,
    density: Annotated[
        float | None,
        typer.Option(
            help="Density of the object, kg/m^3. Default: 500, marked in the scene as a guess."
        ),
    ] = None,
    scale: Annotated[
        float, typer.Option(help="Metres per unit of the mesh file: 0.001 for millimetres.")
    ] = 1.0,
    decompose: Annotated[
        bool,
        typer.Option(
            "--decompose",
            help="Cut the mesh into convex pieces, which keeps its hollows. Default: its convex "
            "hull.",
        ),
    ] = False,
    visuals_collide: Annotated[
        bool,
        typer.Option(
            "--visuals-collide",
            help="For links without collision shapes, use their visual shapes as collision shapes.",
        ),
    ] = False,
    root_link: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="Take only this link and all links below it, such as the palm of a whole robot.",
        ),
    ] = None,
    package_dir: Annotated[
        list[Path] | None,
        typer.Option(help="Folder in which package:// addresses are looked up. May be repeated."),
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write a first scene of a robot and an object, complete and commented.

    The object rests on the support. The hand stands away from it; graspless-pin place finds a
    pose in which the hand holds the object.
    Effort limits that are missing from the robot's files stay unset, unless --effort gives them.

    Exit code 0: written; 2: bad input; 4: written, but the object is too large for any hand, or
    something else is seriously wrong.

    Examples:
        graspless-pin new hand.urdf box:0.06,0.04,0.06 --effort 0.5 -o scene.yaml
        graspless-pin new allegro_right mug.stl --mass 0.3 --support slope:20deg
    """
    with plain_errors():
        check_output("--output", output, OutputKind.SCENE, overwrite=overwrite)
        shape = _parse_shape(obj, scale, decompose=decompose)
        limits = dict(map(_parse_effort_limit, effort or []))
        slope = _parse_slope(support)
        new_scenes: list[NewSceneText] = []
        findings: list[Finding] = []

        def compose_text(target: Path) -> str:
            with waiting_for("reading the robot and the object"), capture() as emitted:
                new_scenes.append(
                    new_scene_text(
                        target,
                        robot,
                        Path(obj).stem if isinstance(shape, MeshShape) else obj.partition(":")[0],
                        shape,
                        package_dirs=package_dir or (),
                        mass=mass,
                        density=density,
                        slope=slope,
                        efforts={name: limit for name, limit in limits.items() if name},
                        effort=limits.get(""),
                        visuals_collide=visuals_collide,
                        root_link=root_link,
                    )
                )
            check_inputs_stay()
            emit(*emitted)
            findings.extend(emitted)
            return new_scenes[0].text

        typer.echo(f"wrote {write_scene_file(output, compose_text, overwrite=overwrite)}")
        if _write_schema(output.with_name(SCHEMA_FILE)):
            typer.echo(f"wrote {output.with_name(SCHEMA_FILE)}, the schema for text editors")
        is_huge = any(
            finding.code is FindingCode.UNLIKELY_SIZE and finding.key[:1] == ("object",)
            for finding in findings
        )
        _echo_next_steps(new_scenes[0], limits.get(""), output, huge=is_huge)
    if is_huge:
        raise typer.Exit(ExitCode.DOUBTFUL)


def _echo_next_steps(new: NewSceneText, effort: float | None, output: Path, *, huge: bool) -> None:
    if new.kept:
        stated = tuple(f"{name} ({limit:g})" for name, limit in new.kept.items())
        echo_note(
            f"--effort {effort:g} sets only limits that the robot's files do not state; unchanged: "
            f"{first_of(stated, _MOST_NAMED)}; --effort NAME={effort:g} replaces one"
        )
    steps = ["correct the size of the object"] if huge else []
    if new.left_open:
        steps.append(
            "fill in hand.effort_limits: the robot's files do not state the effort limits of "
            f"{first_of(new.left_open, _MOST_NAMED)}"
        )
    if new.unplaceable:
        steps.append(f"graspless-pin place refuses this hand as it is ({new.unplaceable})")
    out_of_reach = () if huge else new.out_of_reach
    move_base = " --move-base" if out_of_reach else ""
    steps.append(
        f"{'then' if steps else 'next'}: graspless-pin place {output} -o placed.yaml{move_base}"
    )
    if out_of_reach:
        palms = " or ".join(out_of_reach)
        steps.append(
            f"if the arm is in the way there, use new with the hand alone: --root-link {palms}"
        )
    typer.echo("; ".join(steps))


def _parse_shape(text: str, scale: float, *, decompose: bool) -> Shape:
    """Return the shape of the argument OBJECT: a primitive with lengths, or a mesh file."""
    kind, colon, lengths = text.partition(":")
    if colon and kind in _PRIMITIVES:
        names = _PRIMITIVES[kind]
        numbers = [number_of("OBJECT", number) for number in lengths.split(",")]
        if len(numbers) != len(names.split(",")):
            raise ArgumentError(
                "OBJECT", f"found {text!r}; needs {kind}:{names}, lengths in metres"
            )
        if scale != 1.0 or decompose:
            raise ArgumentError(
                "OBJECT", f"--scale and --decompose apply only to a mesh, not to a {kind}"
            )
        shape_class, unread = SHAPES[kind], iter(numbers)
        types = get_type_hints(shape_class)

        def value_of(key: str) -> Any:
            if shape_class.lengths().get(key) == 3:
                return tuple(islice(unread, 3))
            number = next(unread)
            return int(number) if types[key] is int and number.is_integer() else number

        return shape_class(*(value_of(key.name) for key in fields(shape_class)))
    if re.fullmatch(r"[-+.,\deE]+", lengths):
        raise ArgumentError(
            "OBJECT", f"{kind!r} is not a shape; {names_in_words(kind, _PRIMITIVES)}"
        )
    if not Path(text).suffix:
        raise ArgumentError("OBJECT", f"found {text!r}; needs a mesh file or one of {_LENGTHS}")
    return MeshShape(Path(text), scale, convex="decompose" if decompose else "hull")


def _parse_effort_limit(text: str) -> tuple[str, float]:
    """Return the name, empty for all actuators, and the limit (N m or N) of an --effort option."""
    name, _, number = text.rpartition("=")
    limit = number_of("--effort", number)
    if not 0.0 < limit < math.inf:
        raise ArgumentError("--effort", f"found {text!r}; needs a positive number, N m or N")
    return name, limit


def _parse_slope(text: str) -> float:
    """Return the angle of the --support option, rad."""
    if text == "flat":
        return 0.0
    angle = re.fullmatch(r"slope:\s*([-+.\deE]+?)\s*(deg|°|rad)", text)
    degrees = math.nan if angle is None else number_of("--support", angle[1]) * _UNITS[angle[2]]
    if not 0.0 <= degrees <= _STEEPEST:
        raise ArgumentError(
            "--support",
            f"found {text!r}; must be flat, or slope with an angle of 0 to {_STEEPEST:g} degrees "
            "and its unit, such as slope:30deg or slope:0.5rad",
        )
    return math.radians(degrees)


def _write_schema(file: Path) -> bool:
    """Write the JSON schema of scenes unless the file exists; return whether it was written."""
    if file.exists():
        return False
    with draft_of(file) as draft:
        draft.write_text(json.dumps(scene_json_schema(), indent=2) + "\n", encoding="utf-8")
    return True
