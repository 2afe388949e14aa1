"""Each notebook runs from its first cell to its last and gives the outputs it is stored with."""

import base64
import io
import re
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient
from PIL import Image
from shown_output import difference

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "examples" / "notebooks").glob("*.ipynb"))
FIRST_CELL = """
import os, warnings
warnings.simplefilter("error")
os.sched_getaffinity = lambda _: {0}
%matplotlib inline
"""
"""Warnings are errors; and with one core, a study has one process."""


def read(file):
    return nbformat.read(file, as_version=4)


def test_there_is_the_paper_and_a_real_hand():
    assert {file.stem for file in NOTEBOOKS} == {"paper_figures", "allegro_study"}


def printed(cell) -> str:
    """What a cell prints and returns, as text, without the addresses of objects.

    One line that is printed may arrive in pieces: it depends on when the kernel sends them.
    """
    streamed = "".join(item["text"] for item in cell.outputs if item["output_type"] == "stream")
    returned = [item.get("data", {}).get("text/plain", "") for item in cell.outputs]
    return re.sub(r"<[^<>]*>", "<...>", "\n".join([streamed, *returned]))


def test_a_line_that_arrives_in_pieces_is_one_line():
    pieces = [nbformat.v4.new_output("stream", text=text) for text in ("from 0.0 N ", "to 0.1 N\n")]
    whole = nbformat.v4.new_output("stream", text="from 0.0 N to 0.1 N\n")
    now = printed(nbformat.v4.new_code_cell(outputs=pieces))
    assert not difference(printed(nbformat.v4.new_code_cell(outputs=[whole])), now)


def pictures(cell) -> list[np.ndarray]:
    data = [
        item["data"]["image/png"] for item in cell.outputs if "image/png" in item.get("data", {})
    ]
    return [
        np.asarray(Image.open(io.BytesIO(base64.b64decode(one))).convert("RGB")) for one in data
    ]


# The kernel's own sockets and event loop belong to jupyter_client.
@pytest.mark.filterwarnings("default:::(zmq|jupyter_client|nbclient|asyncio|traitlets)")
@pytest.mark.sampled(1)
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.name)
def test_notebook_runs_and_gives_what_it_is_stored_with(file):
    stored = [cell for cell in read(file).cells if cell.cell_type == "code"]
    notebook = read(file)
    notebook.cells.insert(0, nbformat.v4.new_code_cell(FIRST_CELL))
    client = NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": file.parent}}
    )
    client.execute()
    outputs = [item for cell in notebook.cells for item in cell.get("outputs", [])]
    assert [item for item in outputs if item.get("name") == "stderr"] == []
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"][1:]
    count = 0
    for before, now in zip(stored, cells, strict=True):
        assert not (wrong := difference(printed(before), printed(now))), f"make notebooks: {wrong}"
        for old, new in zip(pictures(before), pictures(now), strict=True):
            assert old.shape == new.shape, "run: make notebooks"
            assert np.abs(old.astype(float) - new).mean() < 1.0, "run: make notebooks"
            count += 1
    assert count >= 4
