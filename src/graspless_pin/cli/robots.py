"""``graspless-pin robots`` and ``inspect``: the known robots, and audits of others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer
from tabulate import tabulate

from graspless_pin.cli.outcome import ExitCode, plain_errors
from graspless_pin.errors import RobotError
from graspless_pin.findings import is_serious
from graspless_pin.geometry.hand.assembly import EffortRecord
from graspless_pin.geometry.inspection import AuditReport, RobotRecord, audit_urdf, list_robots

_FINGERS = 20
"""Columns for the names of fingers: then a table of robots fits 80."""


def robots_text(robots: Sequence[RobotRecord]) -> str:
    """Return a table of robots: fingers, joints and effort limits, at most 80 columns wide."""
    rows = []
    for robot in robots:
        if robot.problem is not None:
            rows.append([robot.name, "-", "-", robot.problem])
            continue
        driven = [joint for joint in robot.joints if joint.effort is not None]
        coupled = sum(bool(joint.follows) for joint in robot.joints)
        joints = f"{len(robot.joints)}" + (f", {coupled} coupled" if coupled else "")
        efforts = [joint.effort for joint in driven if joint.effort and not joint.is_held]
        efforts += robot.tendons.values()
        rows.append([robot.name, ", ".join(robot.fingers), joints, _effort_range_text(efforts)])
    headers = ["robot", "fingers", "joints", "limits [N m, N]"]
    widths = [None, _FINGERS, None, 21]
    return tabulate(rows, headers, maxcolwidths=widths, break_long_words=False)


def robot_text(robot: RobotRecord) -> str:
    """Return one robot in full: every joint with its limits and their sources."""
    rows = []
    for joint in robot.joints:
        state = "locked" if joint.is_locked else "held" if joint.is_held else "driven"
        if joint.effort is None and not joint.is_locked:
            state = "pulled by tendons"
        if joint.follows:
            state = "follows " + ", ".join(
                f"{factor:g} x {name}" for name, factor in joint.follows.items()
            )
        effort = (
            "-" if joint.effort is None else f"{joint.effort.lower:g} .. {joint.effort.upper:g}"
        )
        position = f"{joint.lower:.3f} .. {joint.upper:.3f}"
        rows.append([joint.name, joint.kind, position, effort, state])
    for name, pull in robot.tendons.items():
        rows.append([name, "tendon", "-", f"{pull.lower:g} .. {pull.upper:g}", "driven"])
    fingers = "\n".join(
        f"  {name}: {', '.join(finger.joints)}" for name, finger in robot.fingers.items()
    )
    efforts = [joint.effort for joint in robot.joints if joint.effort is not None]
    efforts += robot.tendons.values()
    sources = dict.fromkeys(f"  {effort.source}" for effort in efforts)
    table = tabulate(rows, ["joint", "kind", "position [rad, m]", "effort [N m, N]", ""])
    return (
        f"{robot.name}, {robot.origin}\nfingers:\n{fingers or '  none found'}\n\n{table}\n\n"
        "where the limits come from:\n" + "\n".join(sources) + _controller_text(robot)
    )


def _controller_text(robot: RobotRecord) -> str:
    """Return the controller gains that a robot file states, as text; empty without any."""
    lines = []
    gains = ("stiffness", robot.stiffness, "N m/rad"), ("damping", robot.damping, "N m s/rad")
    for name, value, unit in gains:
        if isinstance(value, Mapping):
            listed = ", ".join(f"{joint} {gain:g}" for joint, gain in value.items())
            lines.append(f"\n  {name} {listed} {unit}")
        elif value is not None:
            lines.append(f"\n  {name} {value:g} {unit}")
    return f"\n\ncontroller:{''.join(lines)}" if lines else ""


def audit_text(report: AuditReport) -> str:
    """Return the findings of an audit as text, each with its advice."""
    loads = "can be mounted as it is" if report.loads else "cannot be mounted as it is"
    if report.loads and report.findings:
        loads = "can be mounted, but see below"
    if report.loads and is_serious(report.findings):
        loads = "can be mounted, but something serious is wrong"
    weightless = (
        " without mass (verdicts and simulations are impossible)" if not report.mass else ""
    )
    lines = [f"{report.name} ({report.urdf_path}): {loads}"]
    if report.links:  # empty for a file that cannot be read
        lines.append(
            f"{len(report.links)} links{weightless}, {len(report.joints)} movable joints; palm: "
            f"{', '.join(report.palms) or 'none found'}"
        )
    lines += [f"finger {name}: {', '.join(joints)}" for name, joints in report.fingers.items()]
    if not report.findings:
        lines.append("no problems found")
    for finding in report.findings:
        about = "" if finding.message.startswith(finding.subject) else f"{finding.subject}: "
        lines.append(f"{finding.code.words}: {about}{finding.message}\n    {finding.advice}")
    return "\n".join(lines)


def _effort_range_text(efforts: Sequence[EffortRecord]) -> str:
    """Return the range of |effort limits| as text, and how many of them are unknown."""
    if not efforts:
        return "-"
    largest = sorted({max(abs(effort.lower), abs(effort.upper)) for effort in efforts})
    text = f"{largest[0]:g}" if len(largest) == 1 else f"{largest[0]:g} to {largest[-1]:g}"
    unknown = sum(not effort.known for effort in efforts)
    return text if not unknown else f"{text} ({unknown} unknown)"


def robots(
    name: Annotated[str | None, typer.Argument(help="Robot to show in full.")] = None,
) -> None:
    """List the robots with fingers, joints and effort limits, or show one in full.

    Examples:
        graspless-pin robots
        graspless-pin robots allegro_right
    """
    with plain_errors():
        if name is None:
            typer.echo(robots_text(list_robots()))
        else:
            (robot,) = list_robots([name])
            if robot.problem is not None:
                raise RobotError(robot.problem)
            typer.echo(robot_text(robot))


def inspect(
    urdf: Annotated[str, typer.Argument(help="A URDF, a robot file or the name of a robot.")],
    package_dir: Annotated[
        list[Path] | None,
        typer.Option(help="Folder in which package:// addresses are looked up. May be repeated."),
    ] = None,
    root_link: Annotated[
        str | None, typer.Option(help="Keep only this link and all links below it.")
    ] = None,
) -> None:
    """Audit a URDF: meshes, mimic joints, effort and joint limits; and say what to correct.

    Exit code 0: it can be mounted as it is; 1: it cannot; 2: no such file or robot; 4: it can, and
    something serious is wrong.

    Examples:
        graspless-pin inspect my_hand.urdf
    """
    with plain_errors():
        report = audit_urdf(urdf, package_dir or [], root_link)
        typer.echo(audit_text(report))
    exit_code = ExitCode.DOUBTFUL if is_serious(report.findings) else ExitCode.FOUND
    raise typer.Exit(exit_code if report.loads else ExitCode.INFEASIBLE)
