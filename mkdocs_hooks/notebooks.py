"""The notebooks as pages, with the outputs that they are stored with."""

from __future__ import annotations

import base64
import re
from pathlib import Path

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

FOLDER = Path(__file__).resolve().parents[1] / "examples" / "notebooks"
_PANDAS = "dataframe"  # wider than the page as a table
_PLAIN = re.compile(r"^<[^>\n]*>$|^Text\(.*\)$")
"""What a cell that draws returns, too: the name of an object in memory."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, and its pictures."""
    for file in sorted(FOLDER.glob("*.ipynb")):
        text, pictures = page_of(file)
        files.append(File.generated(config, f"notebook_{file.stem}.md", content=text))
        for name, content in pictures.items():
            files.append(File.generated(config, f"pictures/{name}", content=content))
    return files


def page_of(file: Path) -> tuple[str, dict[str, bytes]]:
    """Return a notebook as Markdown, and its pictures by name."""
    parts: list[str] = []
    pictures: dict[str, bytes] = {}
    heading = ""
    for cell in nbformat.read(file, as_version=4).cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            found = re.findall(r"^#+ (.+)$", cell.source, re.MULTILINE)
            heading = found[-1] if found else heading
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            data = output.get("data", {})
            text = output.get("text") or data.get("text/plain", "")
            if "image/png" in data:
                name = f"{file.stem}-{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode(data["image/png"])
                image = f"![{heading}](pictures/{name})"
                parts.append(f'<figure class="plot" markdown="span">\n{image}\n</figure>')
            elif "text/html" in data and _PANDAS not in data["text/html"]:
                # The theme lets only tables without a class scroll in themselves.
                table = re.sub(r"<table [^>]*>", "<table>", data["text/html"])
                parts.append(re.sub(r"\n\s*\n", "\n", table))
            elif text and not _PLAIN.match(text.strip()):
                parts.append(f"```text\n{text.rstrip()}\n```")
    if not pictures:
        raise PluginError(f"{file}: is stored without outputs; run: make notebooks")
    where = f"*This page is `examples/notebooks/{file.name}`, with the outputs of its last run.*"
    parts.insert(1, where)
    return "\n\n".join(parts) + "\n", pictures
