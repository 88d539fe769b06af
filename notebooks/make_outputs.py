"""Run the notebooks and keep what they show: python notebooks/make_outputs.py [NUMBER ...]

Without numbers all of them. Pictures are kept with few colours; in place of a replay, megabytes
that the web does not play, stands a frame of it (needs Chromium), from the middle or, of a cell
with the tag `replay-1.2`, at 1.2 s. tests/end_to_end/test_notebooks.py compares what is kept with
what a notebook shows when it is run.
"""

from __future__ import annotations

import base64
import html
import io
import os
import re
import sys
import tempfile
from pathlib import Path

import nbformat
from make_pictures import screenshot, small_png
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).parent
#: Wider pictures are made smaller (pixels).
WIDEST = 900


def run(file: Path) -> nbformat.NotebookNode:
    """Return a notebook with all that its cells show, run in a folder of its own."""
    notebook = nbformat.read(file, as_version=4)
    os.environ["PYTHONWARNINGS"] = "error::RuntimeWarning"
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        NotebookClient(notebook, timeout=600, resources=resources).execute()
    return notebook


def whole_streams(outputs: list[nbformat.NotebookNode]) -> list[nbformat.NotebookNode]:
    """Return outputs with printed text that arrived in pieces put together."""
    found: list[nbformat.NotebookNode] = []
    for output in outputs:
        last = found[-1] if found else None
        if last and output.output_type == last.output_type == "stream" and output.name == last.name:
            last.text += output.text
        else:
            found.append(output)
    return found


def keep(output: nbformat.NotebookNode, tags: list[str]) -> nbformat.NotebookNode | None:
    """Return an output of a cell with `tags` as it is kept; None for what no reader wants."""
    if output.output_type == "stream":
        output.text = re.sub(r"\x1b\[\d*m", "", output.text)  # bold and dim of a terminal
        return output if output.name == "stdout" and output.text.strip() else None
    data = output.data
    page = re.match(r'<iframe srcdoc="(.*?)" style=', data.get("text/html", ""), re.DOTALL)
    if page:
        duration = float(re.search(r"replay of ([\d.e+-]+) s", data["text/plain"])[1])
        moments = [float(tag[7:]) for tag in tags if tag.startswith("replay-")]
        picture = screenshot(html.unescape(page[1]), *(moments or [0.5 * duration]))
        del data["text/html"]
    elif "image/png" in data:
        picture = Image.open(io.BytesIO(base64.b64decode(data["image/png"])))
    else:
        return output
    data["image/png"] = base64.b64encode(small_png(picture, WIDEST)).decode() + "\n"
    return output


def main() -> None:
    """Renew the notebooks whose numbers the command line names."""
    for file in sorted(FOLDER.glob("*.ipynb")):
        if sys.argv[1:] and file.name[:2] not in sys.argv[1:]:
            continue
        notebook = run(file)
        for cell in notebook.cells:
            cell.metadata.pop("execution", None)  # when each cell ran: different each time
            if cell.cell_type == "code":
                tags = cell.metadata.get("tags", [])
                outputs = whole_streams(cell.outputs)
                cell.outputs = [kept for o in outputs if (kept := keep(o, tags))]
        notebook.metadata = nbformat.read(file, as_version=4).metadata
        file.write_text(nbformat.writes(notebook, indent=1) + "\n", encoding="utf-8")
        print(f"{file.name}: {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
