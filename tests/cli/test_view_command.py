"""``graspless-pin view``: what it says, that it answers, and how it ends."""

import signal
import subprocess
import sys
from urllib.request import urlopen

from cli_tools import PAPER, run

SCENE = PAPER / "sphere_on_slope.yaml"
COMMAND = "import typer; from graspless_pin.cli.view import view_scene; typer.run(view_scene)"
# The kernel may give a signal of the whole process to any of its threads, as a busy one does.
TO_ANOTHER_THREAD = """
import signal, threading, time
def strike():
    time.sleep(0.5)
    signal.pthread_kill(threading.get_ident(), signal.SIGINT)
from graspless_pin.viewer.page import Viewer
wait = Viewer.wait
def waiting(viewer):
    threading.Thread(target=strike).start()
    wait(viewer)
Viewer.wait = waiting
"""


def start(*arguments: str, before: str = "") -> subprocess.Popen[str]:
    return subprocess.Popen(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", before + COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_it_serves_a_page_until_it_is_interrupted():
    with start(str(SCENE), "--no-open", "--port", "0") as process:
        assert process.stdout is not None
        assert process.stderr is not None
        line = process.stdout.readline()
        assert line.endswith("(Ctrl-C ends it)\n"), process.stderr.read()
        url = line.split()[0]
        assert url.startswith("http://127.0.0.1:")
        with urlopen(url, timeout=300) as answer:  # noqa: S310 - our own page
            assert b"<html" in answer.read()
        process.send_signal(signal.SIGINT)
        try:
            _, errors = process.communicate(timeout=300)
        finally:
            process.kill()  # one that does not end must not hold the whole run
        assert process.returncode == 0
        assert errors == ""


def test_a_signal_that_another_thread_gets_ends_it_too():
    with start(str(SCENE), "--no-open", "--port", "0", before=TO_ANOTHER_THREAD) as process:
        try:
            _, errors = process.communicate(timeout=300)
        finally:
            process.kill()
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
