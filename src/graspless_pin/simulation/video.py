"""A simulated run as a video, if a renderer and an encoder are available."""

from __future__ import annotations

import os
import shutil
import subprocess
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.atomic_write import draft_of
from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import GrasplessPinError, SceneError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.problem.checks import FloatArray
from graspless_pin.simulation.mjcf import OBJECT
from graspless_pin.simulation.protocol import LOOK_TIME, Simulation, load_mujoco

_SIZE = 480, 640  # rows, columns
_FRAMES = 50  # a second, of simulated time; played at half the speed
_PLAYED = 25
_TIME_LIMIT = 300.0  # s
_CAMERA_DISTANCE = 5.0  # radii of the object between it and the camera


class _EncoderError(GrasplessPinError):
    """The encoder failed; the message is its own."""


def write_video(simulation: Simulation, path: Path) -> bool:
    """Write the run with stiff bodies as a video at half speed.

    Args:
        simulation: The simulation.
        path: MP4 file.

    Returns:
        Whether it was written; else a warning says what is missing.

    Raises:
        SceneError: If the file cannot be written.

    Warns:
        GrasplessPinWarning: If no encoder is found, it fails, or MuJoCo cannot draw here.
    """
    encoder = _encoder()
    if encoder is None:
        return _no_video("no encoder was found (the program ffmpeg or the package imageio-ffmpeg)")
    run = simulation.runs[0]
    every = round(1.0 / (_FRAMES * LOOK_TIME))
    poses = run.T_world_object[::every]
    turns = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)
    moves = run.joint_moves[::every]
    states = np.hstack([moves, poses[:, :3, 3], turns])
    variables = {} if "DISPLAY" in os.environ else {"MUJOCO_GL": "egl"}
    try:
        with draft_of(path) as draft, ChildProcess(environment=variables) as child:
            # Rendering needs the machine's graphics library, which may crash the process.
            child.call(
                _render, simulation.model.xml, states, encoder, str(draft), limit=_TIME_LIMIT
            )
    except OSError as error:
        raise SceneError(f"{path}: cannot be written ({error.strerror})") from error
    except _EncoderError as error:
        return _no_video(f"the encoder failed ({error})")
    except Exception as error:  # of any graphics library
        return _no_video(f"MuJoCo cannot draw here ({error})")
    return True


def _no_video(reason: str) -> bool:
    emit(
        Finding(
            FindingCode.NO_VIDEO, "video", f"no video was written: {reason}", "save .html instead"
        )
    )
    return False


def _encoder() -> str | None:
    """Return the path of a program that encodes videos; None if there is none."""
    program = shutil.which("ffmpeg")
    if program is None and find_spec("imageio_ffmpeg") is not None:
        from imageio_ffmpeg import get_ffmpeg_exe  # pyright: ignore[reportMissingImports]

        program = get_ffmpeg_exe()
    return program


def _render(xml: str, states: FloatArray, encoder: str, path: str) -> None:
    """Render and encode states (K, nq), in a separate process."""
    mujoco = load_mujoco()
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = states[0, -7:-4]
    radius = float(model.geom_rbound[model.geom_bodyid == model.body(OBJECT).id].max())
    camera.distance, camera.azimuth, camera.elevation = _CAMERA_DISTANCE * radius, 120.0, -20.0
    rows, columns = _SIZE
    command = [
        encoder, "-y", "-loglevel", "error", "-f", "rawvideo", "-pixel_format", "rgb24",
        "-video_size", f"{columns}x{rows}", "-framerate", str(_PLAYED), "-i", "-",
        "-pix_fmt", "yuv420p", "-f", "mp4", path,
    ]  # fmt: skip
    with mujoco.Renderer(model, rows, columns) as renderer, TemporaryFile() as log:
        with (
            suppress(BrokenPipeError),  # an encoder that ended: its exit code and its log say why
            subprocess.Popen(  # noqa: S603 - the encoder that was found
                command, stdin=subprocess.PIPE, stdout=log, stderr=log
            ) as process,
        ):
            pipe: Any = process.stdin
            for state in states:
                data.qpos[:] = state
                mujoco.mj_forward(model, data)
                renderer.update_scene(data, camera)
                pipe.write(renderer.render().tobytes())
        if process.returncode:
            log.seek(0)
            message = log.read().decode(errors="replace").strip()[-200:]
            raise _EncoderError(f"{encoder}: {message or f'exit code {process.returncode}'}")
