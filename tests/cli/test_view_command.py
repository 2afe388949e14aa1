"""``graspless-pin view``: what it says, that it answers, and how it ends."""

import subprocess
import sys
from urllib.request import urlopen

from cli_tools import PAPER, run

SCENE = PAPER / "sphere_on_slope.yaml"
COMMAND = "import typer; from graspless_pin.cli.view import view_scene; typer.run(view_scene)"
# The kernel may give a signal of the whole process to any of its threads, as a busy one does. Here
# it is struck in another thread, once a line is read from standard input.
TO_ANOTHER_THREAD = """
import signal, sys, threading
def strike():
    sys.stdin.readline()
    signal.pthread_kill(threading.get_ident(), signal.SIGINT)
from graspless_pin.viewer.page import Viewer
wait = Viewer.wait
def waiting(viewer):
    threading.Thread(target=strike).start()
    wait(viewer)
Viewer.wait = waiting
"""


def test_it_serves_a_page_until_it_is_interrupted_in_any_thread():
    words = [str(SCENE), "--no-open", "--port", "0"]
    with subprocess.Popen(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", TO_ANOTHER_THREAD + COMMAND, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        line = process.stdout.readline()
        assert line.endswith("(Ctrl-C ends it)\n"), process.stderr.read()
        url = line.split()[0]
        assert url.startswith("http://127.0.0.1:")
        with urlopen(url, timeout=300) as answer:  # noqa: S310 - our own page
            assert b"<html" in answer.read()
        try:
            _, errors = process.communicate("\n", timeout=300)
        finally:
            process.kill()  # one that does not end must not hold the whole run
        assert process.returncode == 0
        assert errors == ""


def test_bad_input_is_one_message_and_exit_code_2(tmp_path):
    for arguments, words in (
        ([tmp_path / "none.yaml"], "none.yaml"),
        ([SCENE, "--host", "198.51.100.1"], "host: nothing can listen at '198.51.100.1'"),
        ([SCENE, "--port", "70000"], "port: is 70000"),
    ):
        result = run("view", *arguments, "--no-open")
        assert result.exit_code == 2, result.stderr
        assert result.stderr.startswith("error: ")
        assert words in result.stderr
