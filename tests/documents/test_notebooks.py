"""Each notebook runs from its first cell to its last, without a warning, as it was committed."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = sorted((Path(__file__).resolve().parents[2] / "examples" / "notebooks").glob("*.ipynb"))
WARNINGS_ARE_ERRORS = 'import warnings\nwarnings.simplefilter("error")\n%matplotlib inline'


def read(file):
    return nbformat.read(file, as_version=4)


def test_there_is_the_paper_and_a_real_hand():
    assert {file.stem for file in NOTEBOOKS} == {"paper_figures", "allegro_study"}


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook_is_stored_without_what_it_printed(file):
    for cell in read(file).cells:
        if cell.cell_type == "code":
            assert (cell.outputs, cell.execution_count) == ([], None)


# The kernel's own sockets and event loop belong to jupyter_client.
@pytest.mark.filterwarnings("default:::(zmq|jupyter_client|nbclient|asyncio|traitlets)")
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_notebook_runs(file):
    notebook = read(file)
    notebook.cells.insert(0, nbformat.v4.new_code_cell(WARNINGS_ARE_ERRORS))
    client = NotebookClient(
        notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": file.parent}}
    )
    client.execute()
    outputs = [item for cell in notebook.cells for item in cell.get("outputs", [])]
    assert [item for item in outputs if item.get("name") == "stderr"] == []
    pictures = [item for item in outputs if "image/png" in item.get("data", {})]
    assert len(pictures) >= 4
