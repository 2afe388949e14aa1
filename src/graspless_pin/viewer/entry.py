"""Where the page is, what it tells of its reader, and what is added to viser's page for that."""

from __future__ import annotations

import gzip
import socket
from collections.abc import Callable
from typing import Any

from graspless_pin.errors import ArgumentError

_LAST_PORT = 65_000  # viser looks upward for a free one
SCHEMES = ("light", "dark")
"""Addresses under the page's own that it asks for, to say which mode its reader prefers."""
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


def with_reader(answer: Any) -> Any:
    """Return viser's answer with what its page tells of its reader; others as they are.

    Args:
        answer: Of websockets, to a request for a file.
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


def told_scheme(path: str, told: Callable[[bool], object]) -> bool:
    """Pass on what a request says of its reader; return whether it is such a request.

    Args:
        path: What is asked for, without the token.
        told: Called with whether the reader prefers a dark page.
    """
    name = path.strip("/")
    if name not in SCHEMES:
        return False
    told(name == "dark")
    return True


def check_address(host: str, port: int) -> None:
    """Refuse what viser would try in vain for ever.

    Raises:
        ArgumentError: See `view`.
    """
    if not 0 <= port <= _LAST_PORT:
        raise ArgumentError("port", f"is {port}; it must be 0 (any free one) to {_LAST_PORT}")
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, 0, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.bind(address)
    except OSError as error:
        raise ArgumentError(
            "host", f"nothing can listen at {host!r} ({error}); use an address of this machine"
        ) from error
