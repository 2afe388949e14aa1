"""Typical mistakes, and what is said of each: ``make mistakes`` prints them one after the other.

Each is made in a folder with a sound scene, as a command or as a line of Python. What is said must
name the cause and the cure.
"""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
import textwrap
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cli_tools import EXAMPLES, LINES, run, spoilt

BOX = "{type: box, size: [0.2, 0.2, 0.2]}"
POSE = "position: [-0.1, -0.1, 0.0]"
TURN = "rpy: [3.141592653589793, 0, 0]"
FLOOR = "pose: {position: [0, 0, -0.1]}"
Q = "q: {hinge: 0.0}"
FRICTION = "friction: 0.3"
MASS = "mass: 1.0"
WALL = "\n  - name: wall\n    shape: {type: box, size: [0.04, 0.04, 0.04]}\n    pose: {position: "
CUBE = (
    "".join(f"v {x} {y} {z}\n" for x in (0, 200) for y in (0, 200) for z in (0, 200))
    + "f 1 2 4\nf 1 4 3\nf 5 7 8\nf 5 8 6\nf 1 5 6\nf 1 6 2\nf 3 4 8\nf 3 8 7\nf 1 3 7\nf 1 7 5\n"
    "f 2 6 8\nf 2 8 4\n"
)


@dataclass(frozen=True)
class Mistake:
    """A mistake.

    Attributes:
        what: What the user did.
        cause: What the message must say of the cause.
        cure: What it must say of the cure.
        changes: What is changed in the sound scene: pairs of old and new text.
        files: Further files by name.
        command: What is called; None: Python.
        python: The line of Python, with all names of the package and ``scene``.
        code: Exit code.
    """

    what: str
    cause: str
    cure: str
    changes: tuple[tuple[str, str], ...] = ()
    files: tuple[tuple[str, str | bytes], ...] = ()
    command: tuple[str, ...] | None = ("solve", "scene.yaml")
    python: str = ""
    code: int = 2


def _scene(
    what: str, old: str, new: str, cause: str, cure: str, code: int = 2, **more: Any
) -> Mistake:
    return Mistake(what, cause, cure, ((old, new),), code=code, **more)


def _command(what: str, words: str, cause: str, cure: str, **files: str | bytes) -> Mistake:
    named = tuple((name.replace("__", "."), content) for name, content in files.items())
    return Mistake(what, cause, cure, files=named, command=tuple(words.split()))


def _python(what: str, line: str, cause: str, cure: str) -> Mistake:
    return Mistake(what, cause, cure, command=None, python=line)


URDF = (EXAMPLES.parent / "robots" / "lever_100mm.urdf").read_text(encoding="utf-8")
STUDY = "scene: scene.yaml\nvary:\n  mu: {key: friction, values: [0.3]}\n"
MISTAKES = [
    # Placing things
    _scene("hand half a metre away", POSE, "position: [-0.1, -0.6, 0.0]",
           "no link of the hand touches object 'box'; the nearest one, 'tip', is 500 mm away",
           "move the hand (base_pose", 4),
    _scene("pose of the hand in millimetres", POSE, "position: [-100, -100, 0.0]",
           "the nearest one, 'tip', is 141 m away",
           "the hand's base is at [-100.0, -100.0, 0.0] m: centimetres are [-1, -1, 0] m, "
           "millimetres are [-0.1, -0.1, 0] m", 4),
    _scene("pose of the object in millimetres", "[0, 0, 0]}", "[0, 300, 0]}",
           "the nearest one, 'tip', is 300 m away",
           "object 'box' is at [0.0, 300.0, 0.0] m: centimetres are [0, 3, 0] m", 4),
    _scene("pose of the hand in degrees", TURN, "rpy: [180, 0, 0]",
           "the angles [180, 0, 0] rad of 'hand' are more than a turn", "degrees are [3.1416", 0),
    _scene("joint angle in degrees", Q, "q: {hinge: 45}",
           ":6: hand.q.hinge: is 45, outside the joint's limits", "45 degrees are 0.7854"),
    _scene("table ten micrometres too low", FLOOR, "pose: {position: [0, 0, -0.10101]}",
           "is 1.01 mm from object 'box', so it is not a contact",
           "graspless-pin settle", 1),
    _scene("fingertip four millimetres short", POSE, "position: [-0.1, -0.104, 0.0]",
           "'tip' is 4 mm from object 'box', so it is not a contact",
           "graspless-pin close", 4),
    _scene("object almost five millimetres in the table", FLOOR,
           "pose: {position: [0, 0, -0.0951]}", "overlap by 4.9 mm",
           "settle the object (graspless-pin settle)", 0),
    _scene("fingertip a little in the object", POSE, "position: [-0.1, -0.097, 0.0]",
           "'tip' and object 'box' overlap by 3 mm", "open the finger (q), then close it", 0),
    _scene("object deep in the table", FLOOR, "pose: {position: [0, 0, -0.05]}",
           "support 'floor' and object 'box' overlap by 50.00 mm", "move"),
    _scene("finger in a wall", FLOOR, f"{FLOOR}{WALL}[0, -0.133, 0]}}",
           "hand link 'tip' and support 'wall' overlap by 7.00 mm", "move the hand", 4),
    Mistake("nothing touches at all", "nothing touches object 'box' within 0.001 m",
            "move the hand or the object",
            ((FLOOR, "pose: {position: [0, 0, -0.2]}"), (POSE, "position: [-0.1, -1.1, 0]"))),
    # Figures
    _scene("friction in per cent", FRICTION, "friction: 80",
           "the coefficient of friction 80", "not a percentage", 0),
    _scene("mass in grams", MASS, "mass: 1000", "has 1.25e+05 kg/m^3", "in kilograms", 1),
    _scene("sizes in millimetres", BOX, "{type: box, size: [200, 200, 200]}",
           "less than air", "the size looks like millimetres"),
    _scene("contact tolerance in millimetres", FRICTION, f"{FRICTION}\ncontact_tolerance: 1",
           "contact_tolerance is 1 m, but the smallest extent of object 'box' is 0.2 m",
           "1 mm are 0.001 m", 0),
    _scene("penetration in millimetres", FRICTION, f"{FRICTION}\nmax_penetration: 5",
           "max_penetration is 5 m", "5 mm are 0.005 m", 0),
    _scene("inertia in kg mm^2", MASS, f"{MASS}\n  inertia: [7000, 7000, 7000]",
           "a moment of 7e+03 kg m^2, but 1 kg inside its shape have at most 0.03", "in kg m^2", 0),
    _scene("gravity in mm/s^2", "-9.8]", "-9800]", "gravity is 9800 m/s^2", "9.81 on Earth", 1),
    _scene("mesh in millimetres", BOX, "{type: mesh, path: cube.obj}", "is 200 m large",
           "needs scale 0.001", files=(("cube.obj", CUBE),)),
    _scene("limits without limit", Q, f"{Q}\n  effort_limits: {{finger: 1e+6}}",
           "effort limits that look like placeholders: 'hinge' (1e+06)",
           "give the motors' real limits", 0),
    _scene("comma for a decimal point", MASS, "mass: 1,5", "object.mass: found '1,5'",
           "write 1.5"),
    _scene("number with its unit", MASS, "mass: 2 kg", "scene.yaml:10: object.mass: found '2 kg'",
           "write 2, without 'kg'"),
    _scene("mass with grams", MASS, "mass: 300 g", "object.mass: found '300 g'",
           "write 0.3 (kg), without 'g': units are SI"),
    _scene("sizes with millimetres", BOX, "{type: box, size: [60 mm, 0.2, 0.2]}",
           "object.shape.size[0]: found '60 mm'", "write 0.06 (m), without 'mm': units are SI"),
    _scene("friction with per cent", FRICTION, "friction: 30 %", "friction: found '30 %'",
           "write 0.3, without '%'"),
    _scene("negative friction", FRICTION, "friction: -0.3", ":2: friction: found -0.3", ">= 0"),
    # Names and keys
    _scene("misspelt key", FRICTION, f"{FRICTION}\nsupport: []",
           "support: unknown key", "did you mean 'supports'?"),
    _scene("misspelt shape", "type: box", "type: bx", "'type': 'bx'", "did you mean 'box'?"),
    _scene("misspelt joint", "hinge: 0.0", "hing: 0.0", ":6: hand.q: unknown joint 'hing'",
           "did you mean 'hinge'?"),
    _scene("positions in a mount", "  robot: lever_100mm\n",
           "  mounts: [{prefix: a/, robot: lever_100mm, q: {hinge: 0.1}}]\n", "found q",
           "beside 'mounts', not in one, with the prefix before names"),
    _scene("misspelt robot", "lever_100mm", "lever_100m",
           ":4: hand.robot: unknown robot 'lever_100m'", "near: lever_100mm"),
    _scene("friction of a misspelt support", FRICTION, "friction: {default: 0.3, flor: 0.2}",
           "scene.yaml:2: friction.flor: is not the name of a body", "did you mean 'floor'?"),
    _scene("no mass", f"  {MASS}\n", "",
           ":7: object: found neither of 'mass' (kg) and 'density' (kg/m^3)", "needs one"),
    _scene("two supports of one name", "supports:\n",
           "supports:\n  - {name: floor, shape: {type: half_space}}\n",
           "scene.yaml:14: supports[1].name: 'floor' is the name of another body, too",
           "names must be distinct"),
    _scene("tab in YAML", f"  {MASS}", f"\t{MASS}", "is not plain YAML", "indent with spaces"),
    _scene("findings as errors", FRICTION, "friction: 80\nwarnings: error",
           "scene.yaml:2: friction.default: the coefficient of friction 80",
           "give the ratio of friction to normal force"),
    # Files and commands
    _command("URDF solved", "solve hand.urdf", "is a URDF, not a scene",
             "graspless-pin inspect hand.urdf", hand__urdf=URDF),
    _command("study solved", "solve study.yaml", "is a study, not a scene",
             "graspless-pin study study.yaml -o", study__yaml=STUDY),
    _command("scene run as a study", "study scene.yaml -o x.csv", "is a scene, not a study",
             "graspless-pin solve scene.yaml"),
    _command("scene inspected", "inspect scene.yaml", "is a scene, not a robot file",
             "graspless-pin solve scene.yaml"),
    _command("scene verified", "verify scene.yaml", "is a scene, not a JSON document",
             "graspless-pin solve scene.yaml"),
    _command("document solved", "solve out.json", "is a JSON document, not a scene",
             "graspless-pin verify out.json", out__json='{"status": 1, "certificate": {}}'),
    _command("mesh solved", "solve cube.obj", "is a mesh file, not a scene",
             "type: mesh, path: cube.obj", cube__obj=CUBE),
    _command("folder solved", "solve .", "is a directory; a scene must be a regular file",
             "such as scene.yaml in this folder"),
    _command("binary file solved", "solve scene.bin", "is a binary file, not a scene",
             "give a file of YAML", scene__bin=b"\x01\x00\x02\x00"),
    _command("scene in a Windows encoding", "solve windows.yaml", "line 1 is in a Windows encoding",
             "save it as UTF-8", windows__yaml=b"name: B\xfcchse\n" + LINES.encode()),
    _command("misspelt file", "solve scen.yaml", "scen.yaml: there is no such file",
             "did you mean 'scene.yaml'?"),
    _command("misspelt command", "sovle scene.yaml", "No such command 'sovle'",
             "Did you mean 'solve'?"),
    _command("misspelt solver", "solve scene.yaml --solver pipq",
             "'pipq' is unknown or not installed", "did you mean 'piqp'?"),
    _command("margin asked of Algorithm 1", "solve scene.yaml --margin 0.1",
             "error: --margin: has no effect with algorithm 'margin'", "use algorithm 'torque'"),
    # Python
    _python("object changed by its mass alone", "scene.with_changes(object={'mass': 2})",
            "object: found {'mass': 2}; needs a ManipulatedObject",
            "dataclasses.replace(scene.object, mass=2.0)"),
    _python("scene changed to negative friction", "scene.with_changes(friction=-1)",
            "friction: found -1", ">= 0"),
    _python("scene changed by a misspelt name", "scene.with_changes(frction=0.4)",
            "frction: is not a field of a scene", "did you mean 'friction'?"),
    _python("margin of a scene", "maximize_margin(scene)",
            "problem: is a Scene; it must be a QuasistaticProblem",
            "pass scene.problem(), or call scene.solve"),
    _python("force bounds of a file", "contact_force_bounds('scene.yaml', [0.0])",
            "problem: is a str", "load_scene(path).problem()"),
    _python("explanation of a scene", "explain(scene)", "solution: is a Scene",
            "pass what scene.solve() returns"),
    _python("evaluator of a file", "Evaluator('scene.yaml')", "scene: is a str",
            "load it with load_scene(path)"),
    _python("problem settled", "settle(scene.problem())", "scene: is a QuasistaticProblem",
            "pass the Scene that it came from"),
    _python("scene loaded twice", "load_scene(scene)", "path: is a Scene", "it is loaded already"),
    _python("misspelt option", "scene.solve(sign_rule='strickt')", "sign_rule: is 'strickt'",
            "did you mean 'strict'?"),
    _python("torques of nothing", "scene.solve('torque', margin=1e6).torques",
            "There is no solution to read (infeasible", "check .found first"),
]  # fmt: skip


@contextlib.contextmanager
def _folder(mistake: Mistake) -> Iterator[Path]:
    text = LINES
    for old, new in mistake.changes:
        text = spoilt(old, new, text)
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file, content in (("scene.yaml", text), *mistake.files):
            (folder / file).write_bytes(content if isinstance(content, bytes) else content.encode())
        os.chdir(folder)
        try:
            yield folder
        finally:
            os.chdir(before)


def said_of(mistake: Mistake) -> tuple[int, str]:
    """Make a mistake; return the exit code (2 for an exception) and what is said."""
    with _folder(mistake):
        if mistake.command is not None:
            # What a verdict says has nothing to do with a mistake, and takes seconds.
            quick = ("--no-verdict",) if mistake.command == ("solve", "scene.yaml") else ()
            result = run(*mistake.command, *quick)
            return result.exit_code, result.stderr
        import graspless_pin

        names = {name: getattr(graspless_pin, name) for name in dir(graspless_pin)}
        names["scene"] = graspless_pin.load_scene("scene.yaml")
        try:
            exec(mistake.python, names)  # noqa: S102 - our own lines
        except graspless_pin.GrasplessPinError as error:
            return 2, f"{type(error).__name__}: {error}\n"
        return 0, ""


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for number, item in enumerate(MISTAKES, 1):
        code, said = said_of(item)
        call = f"$ graspless-pin {' '.join(item.command)}" if item.command else f">>> {item.python}"
        out = io.StringIO()
        for line in said.splitlines():
            print(
                textwrap.fill(line, 96, initial_indent="    ", subsequent_indent="      "), file=out
            )
        print(f"{number:2}. {item.what}\n    {call} ({code})\n{out.getvalue()}")
