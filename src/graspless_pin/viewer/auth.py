"""The guard of the viewer's server: of requests to it, and of messages from its pages.

viser answers whoever connects and sets whatever a message names. Here each request is checked for
the token of the page's address, for its Host and its Origin before viser sees it, and each message
for a value that its control can have. viser and its websocket library are imported on use.
"""

from __future__ import annotations

import gzip
import ipaddress
import math
import secrets
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from http import HTTPStatus
from typing import Any
from urllib.parse import urlsplit

from graspless_pin.errors import ArgumentError, GrasplessPinError

_LAST_PORT = 65_000  # viser tries the ports above for a free one
SCHEMES = ("light", "dark")
"""Paths below the page's own, which it requests to report its reader's colour scheme."""
# viser leaves some controls without a name and labels them too faintly to be read.
_ADDED = b"""<script>
(() => {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const tell = () => fetch(dark.matches ? "dark" : "light", { cache: "no-store" });
  dark.addEventListener("change", tell);
  tell();
  const name = (node, words) => {
    if (!node.getAttribute("aria-label")) node.setAttribute("aria-label", words);
  };
  let asked = false;
  const nameAll = () => {
    asked = false;
    for (const label of document.querySelectorAll("label[for]")) {
      const row = label.parentElement.parentElement.parentElement;
      if (row.querySelectorAll("label[for]").length > 1) continue;
      row.querySelectorAll("[role=slider], input").forEach((one) => name(one, label.textContent));
    }
    for (const button of document.querySelectorAll("button")) {
      if (button.textContent.trim()) continue;
      name(button, button.closest("[role=alert]") ? "Close" : "Options");
    }
  };
  new MutationObserver(() => {
    if (!asked) { asked = true; setTimeout(nameAll, 50); }
  }).observe(document, { childList: true, subtree: true });
})();
</script>
<style>
label[for], [class*=markLabel], [data-variant=outline] [class*=Button-label] {
  color: var(--mantine-color-text) !important;
}
</style>
</head>"""


def with_page_script(answer: Any) -> Any:
    """Return viser's answer, with a script and styles added to HTML pages.

    The script reports which colour scheme the reader prefers, and labels controls.

    Args:
        answer: Of the websocket library, to a request for a file.
    """
    body, headers = answer.body, answer.headers
    if "text/html" not in headers.get("Content-Type", "") or not body:
        return answer
    packed = headers.get("Content-Encoding") == "gzip"
    page = (gzip.decompress(body) if packed else body).replace(b"</head>", _ADDED, 1)
    answer.body = gzip.compress(page) if packed else page
    del headers["Content-Length"]
    headers["Content-Length"] = str(len(answer.body))
    return answer


def check_address(host: str, port: int) -> None:
    """Refuse an address at which viser would retry without end.

    Raises:
        ArgumentError: See `view`.
    """
    if not 0 <= port <= _LAST_PORT:
        raise ArgumentError("port", f"is {port}; it must be 0 (any free port) to {_LAST_PORT}")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
    except OSError as error:
        raise ArgumentError(
            "host", f"nothing can listen at {host!r} ({error}); use an address of this machine"
        ) from error


MOST_BYTES = 1 << 16
"""Largest message of a page, far above what its controls send."""
_TOKEN_BYTES = 16
_LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
_CAMERA = {
    "wxyz": 4, "position": 3, "look_at": 3, "up_direction": 3,
    "image_height": 0, "image_width": 0, "fov": 0, "near": 0, "far": 0,
}  # fmt: skip
"""Numbers of each entry of a camera message; 0: one that is no list."""
_GIZMO = {
    "TransformControlsUpdateMessage": {"wxyz": 4, "position": 3},
    "TransformControlsDragStartMessage": {},
    "TransformControlsDragEndMessage": {},
}
"""Numbers of each entry of messages about gizmos."""
_starting = threading.Lock()

Admits = Callable[[Any], bool]
"""Returns whether a control can have a value."""


class Gate:
    """Decides which requests and messages a page's server accepts.

    Attributes:
        token: Random text in the page's address; requests without it are refused.
        scheme_told: Called with whether a page's reader prefers dark pages.
    """

    def __init__(self, host: str) -> None:
        """Make a gate for a server that listens at a host; no control is admitted yet."""
        self.token = secrets.token_urlsafe(_TOKEN_BYTES)
        self._host = host.lower()
        self._checks: dict[str, Admits] = {}
        self._gizmos: set[str] = set()
        self.scheme_told: Callable[[bool], object] = bool

    def admit(self, control: Any, check: Admits, then: Callable[[Any], object]) -> Any:
        """Let messages set a control of viser's to values that pass a check; return the control.

        Args:
            control: The control.
            check: Whether a value is possible for the control.
            then: Called with viser's event once it is set or clicked.
        """
        self._checks[control._impl.uuid] = check
        (control.on_update if hasattr(control, "on_update") else control.on_click)(then)
        return control

    def admit_gizmo(self, gizmo: Any) -> None:
        """Let messages move a gizmo of viser's."""
        self._gizmos.add(gizmo.name)

    def refusal(self, path: str, headers: Mapping[str, list[str]]) -> str:
        """Return why a request is refused; empty if it is not.

        Args:
            path: The requested path, as it was sent.
            headers: All values of the headers ``host``, ``origin`` and ``upgrade``.
        """
        hosts, origins = headers["host"], headers["origin"]
        if len(hosts) != 1 or not self._is_own_name(hosts[0]):
            return "this is not an address of the viewer; open the one that it printed"
        own = (f"http://{hosts[0]}".lower(), f"https://{hosts[0]}".lower())
        # Browsers state the Origin of every websocket, but not of an opened page.
        if headers["upgrade"] and not origins:
            return "a websocket request without an Origin header is refused"
        if any(origin.lower() not in own for origin in origins):
            return "a request from a page of another site is refused"
        first = path.removeprefix("/").partition("?")[0].partition("/")[0]
        if not path.startswith("/") or not secrets.compare_digest(
            first.encode(errors="surrogateescape"), self.token.encode()
        ):
            return "the address has no valid token; open the address that the viewer printed"
        return ""

    def accepts(self, message: Any) -> bool:
        """Return whether a decoded message sets a control to a value that it can have."""
        if not isinstance(message, dict):
            return False
        kind = message.get("type")
        if isinstance(kind, str) and kind in _GIZMO:
            return (
                message.keys() == {"type", "name", "owner", *_GIZMO[kind]}
                and isinstance(message["name"], str)
                and message["name"] in self._gizmos
                and message["owner"] == ""
                and all(_has_numbers(message[name], n) for name, n in _GIZMO[kind].items())
            )
        if kind == "ViewerCameraMessage":
            return message.keys() == {"type", *_CAMERA} and all(
                _has_numbers(message[name], count) for name, count in _CAMERA.items()
            )
        if kind != "GuiUpdateMessage" or message.keys() != {"type", "uuid", "updates"}:
            return False
        uuid, updates = message["uuid"], message["updates"]
        if not isinstance(uuid, str) or not isinstance(updates, dict):
            return False
        check = self._checks.get(uuid)
        return check is not None and updates.keys() == {"value"} and check(updates["value"])

    def _is_own_name(self, host: str) -> bool:
        """Return whether a Host header names this machine, and no other site that leads here."""
        try:
            name = urlsplit(f"//{host}").hostname
        except ValueError:
            return False
        if name is None or "@" in host:
            return False
        if name in (*_LOCAL_NAMES, self._host):
            return True
        own = _parsed_address(self._host)
        if self._host in _LOCAL_NAMES or (own is not None and own.is_loopback):
            return False
        # Only names can be made to resolve elsewhere. A server that listens beyond this machine
        # may be reached at any of its addresses.
        return _parsed_address(name) is not None or name == socket.gethostname().lower()


def number_between(low: float, high: float) -> Admits:
    """Return a check for numbers of a range, with a tolerance for rounding."""
    slack = 1e-9 * max(abs(low), abs(high)) if math.isfinite(high) else 0.0
    return lambda value: _is_number(value) and low - slack <= value <= high + slack


def one_of(values: tuple[str, ...]) -> Admits:
    """Return a check for texts out of a list."""
    return lambda value: isinstance(value, str) and value in values


def is_switch(value: Any) -> bool:
    """Return whether a value is a boolean."""
    return isinstance(value, bool)


@contextmanager
def guarded_by(gate: Gate) -> Iterator[None]:
    """Guard the servers that viser starts in this context by a gate.

    viser has no hook for that. It starts its server with ``websockets.asyncio.server.serve``, which
    has one for requests and another for connections; both are added by giving viser's own module
    another ``websockets`` for that time.

    Raises:
        GrasplessPinError: If viser starts its server in another way: then there is no gate.
    """
    from viser.infra import _infra

    passed: list[bool] = []
    with _starting:
        module: Any = _infra
        library = module.websockets
        module.websockets = _Websockets(library, gate, passed)
        try:
            yield
        finally:
            module.websockets = library
    if not passed:
        raise GrasplessPinError(
            "this version of viser starts its server in a way that cannot be protected; install "
            "the version that graspless_pin requires: pip install 'graspless-pin[viewer]'"
        )


class _Websockets:
    """The module ``websockets`` with another ``serve``."""

    def __init__(self, library: Any, gate: Gate, passed: list[bool]) -> None:
        self._library, self._gate, self._passed = library, gate, passed
        self.asyncio = self.server = self  # ``websockets.asyncio.server.serve`` is looked up in it

    def __getattr__(self, name: str) -> Any:
        return getattr(self._library, name)

    def serve(self, handler: Any, host: str, port: int, **options: Any) -> Any:
        """Start a server behind the gate."""
        self._passed.append(True)
        inner = options.pop("process_request")
        options |= {
            "process_request": lambda connection, request: _process_request(
                self._gate, inner, connection, request
            ),
            "create_connection": _connection_class(self._gate),
            "max_size": MOST_BYTES,
        }
        return self._library.asyncio.server.serve(handler, host, port, **options)


def _process_request(gate: Gate, inner: Any, connection: Any, request: Any) -> Any:
    """Refuse a request, or let viser answer it."""
    names = ("host", "origin", "upgrade")
    why = gate.refusal(request.path, {name: request.headers.get_all(name) for name in names})
    if why:
        response = connection.respond(HTTPStatus.FORBIDDEN, f"{why}\n")
    else:
        path = request.path.removeprefix(f"/{gate.token}")
        scheme = path.strip("/")
        if scheme in SCHEMES:
            gate.scheme_told(scheme == "dark")
            response = connection.respond(HTTPStatus.NO_CONTENT, "")
        else:
            response = inner(connection, replace(request, path="/" + path.removeprefix("/")))
            response = None if response is None else with_page_script(response)
    if response is not None:
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["Cache-Control"] = "no-store"
        response.headers["X-Content-Type-Options"] = "nosniff"
    return response


def _connection_class(gate: Gate) -> Any:
    import msgspec
    from websockets.asyncio.server import ServerConnection

    class Connection(ServerConnection):
        """Passes on the messages that a page can send, and drops all others."""

        async def recv(self, decode: bool | None = None) -> Any:
            while True:
                message = await super().recv(decode)
                if not isinstance(message, bytes):
                    continue
                try:
                    accepted = gate.accepts(msgspec.msgpack.decode(message))
                except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                    continue
                if accepted:
                    return message

    return Connection


def _has_numbers(value: Any, count: int) -> bool:
    if count == 0:
        return _is_number(value)
    return isinstance(value, list) and len(value) == count and all(map(_is_number, value))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _parsed_address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None
