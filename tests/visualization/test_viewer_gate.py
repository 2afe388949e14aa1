"""Whom the viewer answers, what a message may set, and a solver that dies."""

from __future__ import annotations

import ctypes
import http.client
import math
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest
import viser
from viser.infra import _infra
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection
from websockets.typing import Origin, Subprotocol

from graspless_pin.errors import GrasplessPinError, SceneError
from graspless_pin.scene import load_scene
from graspless_pin.viewer import Viewer, changed_scene, scene_process, view
from graspless_pin.viewer.auth import MOST_BYTES, Gate

SCENE = Path(__file__).resolve().parents[2] / "examples" / "paper" / "cuboid_at_rest.yaml"
PATIENCE = 300.0
CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [1.0, 2.0, 3.0],
    "look_at": [0, 0, 0], "up_direction": [0, 0, 1], "image_height": 800, "image_width": 1280,
    "fov": 1.3, "near": 0.01, "far": 1000,
}  # fmt: skip


GIZMO = {
    "type": "TransformControlsUpdateMessage", "name": "/scene/handles object", "owner": "",
    "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, 0.0, 0.0],
}  # fmt: skip


@pytest.fixture(scope="module")
def viewer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewer]:
    file = tmp_path_factory.mktemp("viewed") / "scene.yaml"
    file.write_text(SCENE.read_text(encoding="utf-8"), encoding="utf-8")
    running = view(load_scene(file), port=0)
    yield running
    running.stop()


def place(viewer: Viewer) -> tuple[str, int, str]:
    """Host, port and token of a viewer's page."""
    address = urlsplit(viewer.url)
    assert address.hostname is not None and address.port is not None
    return address.hostname, address.port, address.path.strip("/")


def status(viewer: Viewer, path: str, headers: dict[str, str]) -> tuple[int, str]:
    """Status and text of an answer; a header that is empty is not sent."""
    name, port, _ = place(viewer)
    connection = http.client.HTTPConnection(name, port, timeout=PATIENCE)
    connection.putrequest("GET", path, skip_host=True)
    for key, value in ({"Host": f"{name}:{port}"} | headers).items():
        if value:
            connection.putheader(key, value)
    connection.endheaders()
    answer = connection.getresponse()
    text = "" if answer.status == 101 else answer.read().decode()
    connection.close()
    return answer.status, text


def upgrade(viewer: Viewer, **headers: str) -> dict[str, str]:
    """Headers that ask for a websocket, as the page itself would."""
    name, port, _ = place(viewer)
    return {
        "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==", "Origin": f"http://{name}:{port}",
        "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}", **headers,
    }  # fmt: skip


def connected(viewer: Viewer) -> ClientConnection:
    name, port, token = place(viewer)
    return connect(
        f"ws://{name}:{port}/{token}",
        origin=Origin(f"http://{name}:{port}"),
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        compression=None,
        max_size=None,
    )


def send(page: Connection, message: Any) -> None:
    page.send(msgspec.msgpack.encode(message))


def update(uuid: str, value: Any) -> dict[str, Any]:
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}


def control(viewer: Viewer, label: str) -> Any:
    handles = viewer._server.gui._gui_input_handle_from_uuid.values()
    (found,) = (handle for handle in handles if handle.label == label)
    return found


def wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "it does not come about"
        time.sleep(0.01)


def settled(viewer: Viewer, **values: float) -> None:
    """Wait until the page shows some values, and compare its margin."""
    wait_until(lambda: viewer.evaluation.settings.values == values)
    solution = viewer.evaluation.solution
    assert solution is not None
    assert solution.margin == changed_scene(viewer.scene, values).solve().margin


def test_the_page_is_answered_with_its_token(viewer):
    name, port, token = place(viewer)
    code, text = status(viewer, f"/{token}/", {})
    assert code == 200 and "<html" in text
    assert status(viewer, f"/{token}", {"Host": f"localhost:{port}"})[0] == 200
    assert status(viewer, f"/{token}", upgrade(viewer))[0] == 101
    # Another port of this machine may be led here.
    forwarded = {"Host": "localhost:9000", "Origin": "http://localhost:9000"}
    assert status(viewer, f"/{token}", upgrade(viewer) | forwarded)[0] == 101
    assert len(token) >= 20 and token != Gate("localhost").token
    connection = http.client.HTTPConnection(name, port, timeout=PATIENCE)
    connection.request("GET", f"/{token}/")
    answer = connection.getresponse()
    answer.read()
    connection.close()
    assert answer.getheader("Referrer-Policy") == "no-referrer"
    assert answer.getheader("Cache-Control") == "no-store"


@pytest.mark.parametrize("asks", ["page", "websocket"])
@pytest.mark.parametrize(
    ("path", "headers", "why"),
    [
        ("/", {}, "has no valid token"),
        ("", {}, "has no valid token"),
        ("/index.html", {}, "has no valid token"),
        ("/{token}x", {}, "has no valid token"),
        ("/x/../{token}", {}, "has no valid token"),
        ("//{token}", {}, "has no valid token"),
        ("/?{token}", {}, "has no valid token"),
        ("http://127.0.0.1/{token}", {}, "has no valid token"),
        ("/{token}/", {"Host": "evil.example"}, "not an address of the viewer"),
        ("/{token}/", {"Host": "127.0.0.1.evil.example:{port}"}, "not an address of the viewer"),
        ("/{token}/", {"Host": "localhost@evil.example"}, "not an address of the viewer"),
        ("/{token}/", {"Host": "192.0.2.7:{port}"}, "not an address of the viewer"),
        ("/{token}/", {"Host": "[::1"}, "not an address of the viewer"),
        ("/{token}/", {"Host": ""}, "not an address of the viewer"),
        ("/{token}/", {"Origin": "http://evil.example"}, "of another site"),
        ("/{token}/", {"Origin": "http://127.0.0.1:1"}, "of another site"),
        ("/{token}/", {"Origin": "http://localhost:{port}"}, "of another site"),
        ("/{token}/", {"Origin": "null"}, "of another site"),
    ],
)
def test_all_else_is_refused(viewer, asks, path, headers, why):
    _, port, token = place(viewer)
    path = path.format(token=token)
    headers = {key: value.format(port=port) for key, value in headers.items()}
    if asks == "websocket":
        headers = upgrade(viewer) | headers
    code, text = status(viewer, path, headers)
    assert code == 403 and why in text
    assert token not in text and "cuboid" not in text


def test_a_websocket_without_an_origin_is_refused(viewer):
    _, _, token = place(viewer)
    code, text = status(viewer, f"/{token}", upgrade(viewer, Origin=""))
    assert code == 403 and "without an Origin" in text


def test_who_listens_beyond_this_machine_is_called_by_address_or_name():
    gate = Gate("0.0.0.0")  # noqa: S104 - nothing listens
    other = Gate("arm.example")
    for name in ("192.0.2.7:8080", "[2001:db8::7]:8080", "localhost", socket.gethostname()):
        assert gate._is_own_name(name), name
    for name in ("evil.example", "arm.example", "1.2.3.4.example", "[1.2.3.4"):
        assert not gate._is_own_name(name), name
    assert other._is_own_name("ARM.example:8080") and not other._is_own_name("arm.example.org")
    assert not Gate("127.0.0.2")._is_own_name("192.0.2.7")


def test_messages_move_controls(viewer):
    friction = control(viewer, "friction, supports")
    with connected(viewer) as page:
        send(page, CAMERA)
        send(page, update(friction._impl.uuid, 0.5))
        settled(viewer, **{"friction/supports": 0.5})
        send(page, update(friction._impl.uuid, 1))
        settled(viewer, **{"friction/supports": 1.0})
        send(page, update(control(viewer, "steps")._impl.uuid, "As loaded"))
        settled(viewer)


def shows(viewer: Viewer, **values: float) -> None:
    """Wait until the page shows a setting, whether or not it is feasible."""
    wait_until(lambda: viewer.evaluation.settings.values == values)


def test_handles_move_the_object_within_its_range(viewer):
    """Dragged along the slope, turned about its normal, undone and done again."""
    along, steps = control(viewer, "stay on slope"), control(viewer, "steps")._impl.uuid
    start = viewer.scene.object.center_of_mass_world
    half = math.sin(math.radians(5.0))
    drag = {**GIZMO, "wxyz": [math.cos(math.radians(5.0)), 0.0, half, 0.0]}
    ends = [{**GIZMO, "type": f"TransformControlsDrag{end}Message"} for end in ("Start", "End")]
    for end in ends:
        del end["wxyz"], end["position"]
    with connected(viewer) as page:
        send(page, CAMERA)
        send(page, ends[0])
        send(page, {**drag, "position": np.add(start, [0.004, 0.0, 3.0]).tolist()})
        shows(viewer, **{"object/x": 4.0, "object/z": 100.0, "object/turn_y": 10.0})
        send(page, {**GIZMO, "position": np.add(start, [0.004, 0.0, 0.0]).tolist()})
        send(page, ends[1])
        shows(viewer, **{"object/x": 4.0})
        wait_until(lambda: len(viewer._desk._steps) > 1)
        send(page, update(along._impl.uuid, True))  # noqa: FBT003
        shows(viewer, **{"object/x": 4.0, "object/along": 1.0})
        normal = viewer.scene.supports[0].T_world_support[:3, 2]
        moved = viewer.evaluation.scene.object.center_of_mass_world - start
        assert moved @ normal == pytest.approx(0.0, abs=1e-12) and moved[0] > 0.001
        send(page, update(steps, "Undo"))
        shows(viewer, **{"object/x": 4.0})
        assert along.value is False
        send(page, update(steps, "Redo"))
        shows(viewer, **{"object/x": 4.0, "object/along": 1.0})
        send(page, update(steps, "As loaded"))
        settled(viewer)


def test_an_answer_that_comes_late_does_not_take_a_drag_back(viewer, monkeypatch):
    """The answer to an earlier step is shown just when the handle is let go."""
    gizmos, change = viewer._gizmos, viewer._desk.change
    handle, moves = gizmos._handles["object/"], []

    class Overtaken:
        position = property(lambda _: handle.position)

        @property
        def wxyz(self) -> Any:
            gizmos.place({})
            return handle.wxyz

        def __setattr__(self, name: str, value: Any) -> None:
            setattr(handle, name, value)

    def record(values: Any) -> None:
        moves.append(values)
        change(values)

    monkeypatch.setitem(gizmos._handles, "object/", Overtaken())
    monkeypatch.setattr(viewer._desk, "change", record)
    start = viewer.scene.object.center_of_mass_world
    with connected(viewer) as page:
        send(page, CAMERA)
        for message in (
            {"type": "TransformControlsDragStartMessage", "name": GIZMO["name"], "owner": ""},
            {**GIZMO, "position": np.add(start, [0.004, 0.0, 0.0]).tolist()},
            {"type": "TransformControlsDragEndMessage", "name": GIZMO["name"], "owner": ""},
        ):
            send(page, message)
        wait_until(lambda: len(moves) == 2)
        assert moves[0] == moves[1] and moves[0]["object/x"] == 4.0
        send(page, update(control(viewer, "steps")._impl.uuid, "As loaded"))
        settled(viewer)


def test_a_reader_who_likes_the_dark_gets_it(viewer):
    _, _, token = place(viewer)
    code, page = status(viewer, f"/{token}/", {})
    assert code == 200 and 'matchMedia("(prefers-color-scheme: dark)")' in page
    for scheme, dark in (("dark", True), ("light", False)):
        assert status(viewer, f"/{token}/{scheme}", {})[0] == 204
        wait_until(lambda dark=dark: viewer._dark is dark)
    assert status(viewer, "/dark", {})[0] == 403


def test_it_saves_what_it_shows_under_a_free_name(viewer):
    folder = viewer.scene.path.parent
    mass = control(viewer, "mass [kg]")._impl.uuid
    save = control(viewer, "Save as scene file")._impl.uuid
    with connected(viewer) as page:
        send(page, CAMERA)
        send(page, update(mass, 1.5))
        settled(viewer, mass=1.5)
        for _ in range(2):  # the same again is not written again
            send(page, update(save, True))  # noqa: FBT003
            wait_until(lambda: "scene_1.yaml" in viewer._saying.content)
        assert sorted(one.name for one in folder.iterdir()) == ["scene.yaml", "scene_1.yaml"]
        saved = load_scene(folder / "scene_1.yaml")
        assert saved.object.mass == 1.5
        shown = viewer.evaluation.solution
        assert shown is not None and saved.solve().margin == pytest.approx(shown.margin)
        with pytest.raises(SceneError, match="exists already"):
            viewer.save(folder / "scene_1.yaml")
        send(page, update(control(viewer, "steps")._impl.uuid, "As loaded"))
        settled(viewer)


def hostile(viewer: Viewer) -> list[Any]:
    """Messages that no page of ours sends."""
    slider = control(viewer, "friction, supports")._impl.uuid
    box = control(viewer, "normal force")._impl.uuid
    choice = control(viewer, "algorithm")._impl.uuid
    updates = [
        {"update_cb": []}, {"value": 0.4, "update_cb": []}, {"removed": True}, {"sync_cb": None},
        {"gui_api": None}, {"is_button": True}, {"uuid": "x"}, {"props": {}}, {}, {"min": -1.0},
    ]  # fmt: skip
    values = [
        "abc", "0.4", [], [0.4], {}, None, True, math.nan, math.inf, -math.inf, -0.1, 1e9, 1e300,
        b"0.4",
    ]  # fmt: skip
    return [
        *({"type": "GuiUpdateMessage", "uuid": slider, "updates": item} for item in updates),
        *(update(slider, value) for value in values),
        *(update(box, value) for value in (1, "", None, [True])),
        *(update(choice, value) for value in ("3: none", 0, None, ["1: largest margin"])),
        update("unknown", 0.4),
        {"type": "GuiUpdateMessage", "uuid": slider, "updates": [["value", 0.4]]},
        {"type": "GuiUpdateMessage", "uuid": [slider], "updates": {"value": 0.4}},
        {"type": "GuiUpdateMessage", "uuid": slider},
        {**update(slider, 0.4), "more": 1},
        {"type": "GuiRemoveMessage", "uuid": slider},
        {"type": "ResetGuiMessage"},
        {"type": "FileTransferStartUpload", "source_component_uuid": slider},
        {"type": "SceneNodeUpdateMessage", "name": "/scene", "updates": {"position": [9, 9, 9]}},
        {**GIZMO, "name": "/scene"}, {**GIZMO, "name": ["x"]}, {**GIZMO, "owner": "else"},
        {**GIZMO, "position": [0.0, 0.0]}, {**GIZMO, "wxyz": [math.inf] * 4}, {**GIZMO, "more": 1},
        {"type": "TransformControlsDragEndMessage", "name": "/scene", "owner": ""},
        {"type": "Message"}, {"type": ["x"]}, {"type": None}, {}, [], None, 7, "text",
        {**CAMERA, "wxyz": [math.nan] * 4}, {**CAMERA, "fov": "wide"}, {**CAMERA, "near": []},
        {**CAMERA, "position": [0, 0]}, {**CAMERA, "look_at": 3}, {"type": "ViewerCameraMessage"},
    ]  # fmt: skip


def test_hostile_messages_leave_the_controls_working(viewer, capfd, caplog):
    friction = control(viewer, "friction, supports")
    callbacks = len(friction._impl.update_cb)
    with connected(viewer) as page:
        for message in hostile(viewer):
            send(page, message)
        page.send("text")
        page.send(b"")
        page.send(b"\xc1")
        page.send(b"\x91" * 20_000)  # lists in lists
        page.send(bytes(MOST_BYTES - 1))
        send(page, CAMERA)
        send(page, update(friction._impl.uuid, 0.45))
        settled(viewer, **{"friction/supports": 0.45})
        send(page, update(control(viewer, "steps")._impl.uuid, "As loaded"))
        settled(viewer)
    assert len(friction._impl.update_cb) == callbacks and friction.value == friction._impl.value
    captured = capfd.readouterr()
    assert "Traceback" not in captured.err + captured.out + caplog.text


def test_a_message_too_large_ends_its_connection_alone(viewer):
    with connected(viewer) as other:
        with connected(viewer) as page:
            page.send(bytes(MOST_BYTES + 1))
            with pytest.raises(Exception, match="1009"):
                while True:
                    page.recv(timeout=PATIENCE)
        send(other, CAMERA)
        send(other, update(control(viewer, "mass [kg]")._impl.uuid, 1.2))
        settled(viewer, mass=1.2)
        send(other, update(control(viewer, "steps")._impl.uuid, "As loaded"))
        settled(viewer)


def test_a_viser_that_passes_by_is_refused(monkeypatch):
    """Rather no page than one that answers everybody."""
    module: Any = _infra
    library = module.websockets
    started = module.WebsockServer._background_worker

    def passing_by(self, ready):
        module.websockets = library
        started(self, ready)

    monkeypatch.setattr(_infra.WebsockServer, "_background_worker", passing_by)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with pytest.raises(GrasplessPinError, match="cannot be protected"):
        view(load_scene(SCENE), port=port)
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0


def crashes(_settings):
    """A fault in native code, as a backend may have it."""
    ctypes.string_at(0)


def test_a_solver_that_dies_leaves_the_page(viewer, monkeypatch):
    mass = control(viewer, "mass [kg]")._impl.uuid
    with connected(viewer) as page:
        send(page, CAMERA)
        with monkeypatch.context() as patch:
            patch.setattr(scene_process, "_evaluate_kept", crashes)
            send(page, update(mass, 1.5))
            # Not the answer to what was asked for before.
            wait_until(lambda: viewer.evaluation.settings.values == {"mass": 1.5})
            wait_until(lambda: "SIGSEGV" in viewer._result.content)
            wait_until(lambda: "no torques" in viewer._torques.content)
        assert "Why there are no torques" in viewer._result.content
        shown = viewer.evaluation
        assert shown.solution is None and shown.settings.values == {"mass": 1.5}
        assert {mesh.role for mesh in shown.picture.meshes} <= {"hand", "object", "support"}
        send(page, update(mass, 1.25))
        settled(viewer, mass=1.25)
        wait_until(lambda: "SIGSEGV" not in viewer._result.content)
        send(page, update(control(viewer, "steps")._impl.uuid, "As loaded"))
        settled(viewer)


def test_a_scene_that_kills_its_solver_is_shown_without_torques(monkeypatch):
    monkeypatch.setattr(scene_process, "_evaluate_kept", crashes)
    running = view(load_scene(SCENE), port=0)
    try:
        assert running.evaluation.solution is None
        assert "SIGSEGV" in running.evaluation.reason
    finally:
        running.stop()
