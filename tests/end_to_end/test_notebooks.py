"""The notebooks run from top to bottom, quickly, to the outputs they keep, on public names only."""

import ast
import base64
import io
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import nbclient
import nbformat
import numpy as np
import pytest
from PIL import Image

import pinfric as pf

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
#: What a reader waits at most (s).
PATIENCE = 120


def read(file):
    return nbformat.read(file, as_version=4)


def python_of(notebook):
    """The code of a notebook as one module; other languages (`%%bash`) and magics left out."""
    cells = [c.source for c in notebook.cells if c.cell_type == "code"]
    python = [source for source in cells if not source.startswith("%%")]
    return ast.parse(re.sub(r"^%.*$", "", "\n".join(python), flags=re.MULTILINE))


def test_these_are_all():
    numbers = [file.name[:2] for file in NOTEBOOKS]
    assert numbers == ["01", "02", "03", "04", "05", "06", "07", "08", "09", "10"]


NUMBER = re.compile(r"-?\d+(?:\.(\d+))?(?:e([+-]\d+))?")


def printed(outputs):
    """What a cell says: printed text, then that of results, without a terminal's bold and lines."""
    streams = [o.text for o in outputs if o.output_type == "stream" and o.name == "stdout"]
    results = [o.data.get("text/plain", "") for o in outputs if o.output_type != "stream"]
    text = re.sub(r"\x1b\[\d*m", "", "".join(streams) + " ".join(results))
    return " ".join(re.sub(r"sample=\d+|─+", "", text).split())  # sample: of the largest rounding


def same_text(now, kept, measured):
    """Equal words, and numbers to 0.2 % or their last digit; rounding alone differs by machine."""
    words = [NUMBER.sub("#", text).replace(" ", "") for text in (now, kept)]
    if measured:  # a time may be below what the clock tells
        words = [text.replace("<#", "#") for text in words]
    assert words[0] == words[1], "python notebooks/make_outputs.py renews what is kept"
    for a, b in zip(NUMBER.finditer(now), NUMBER.finditer(kept), strict=True):
        digit = 10.0 ** (int(b[2] or 0) - len(b[1] or ""))
        x, y = float(a[0]), float(b[0])
        tiny = max(abs(x), abs(y)) < 1e-7
        assert measured or tiny or abs(x - y) <= max(1.5 * digit, 2e-3 * abs(y)), (a[0], b[0], kept)


def pictures(outputs):
    """The pictures of a cell, 80 x 60 and gray; None for a replay, which is kept as a frame."""
    for output in outputs:
        data = output.get("data", {})
        if "<iframe" in data.get("text/html", ""):
            yield None
        elif "image/png" in data:
            picture = Image.open(io.BytesIO(base64.b64decode(data["image/png"]))).convert("L")
            yield np.asarray(picture.resize((80, 60)), dtype=float)


@pytest.mark.slow
@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_runs_from_top_to_bottom(file, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", os.defpath)  # `pinfric` is found without an activated environment
    monkeypatch.setenv("PYTHONWARNINGS", "error::RuntimeWarning")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))  # no profile of the user's
    notebook = read(file)
    client = nbclient.NotebookClient(
        notebook, timeout=PATIENCE, resources={"metadata": {"path": tmp_path}}
    )
    begin = time.monotonic()
    client.execute()  # an exception in a cell is one here
    assert time.monotonic() - begin < PATIENCE
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    shown = [set(output.get("data", {})) for output in outputs]
    assert any("image/png" in data for data in shown)
    assert any("<iframe" in output.get("data", {}).get("text/html", "") for output in outputs)
    # a line may arrive in pieces; kernels are compiled in the first run of all
    errors = "".join(o.text for o in outputs if o.output_type == "stream" and o.name == "stderr")
    errors = re.sub(r".* faster than friction was measured, .*\n.*\n", "", errors)  # the UR10 is
    usual = re.compile("pinfric: (wrote|compiling|warning: .* entries are guesses)")
    assert all(usual.match(line) for line in errors.splitlines()), errors
    for now, kept in zip(notebook.cells, read(file).cells, strict=True):
        if now.cell_type == "code":
            measured = "measured" in kept.metadata.get("tags", ())
            same_text(printed(now.outputs), printed(kept.outputs), measured)
            for ours, theirs in zip(pictures(now.outputs), pictures(kept.outputs), strict=True):
                assert measured or ours is None or np.abs(ours - theirs).mean() < 3.0


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_outputs_are_kept_and_small(file):
    notebook = read(file)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == [*range(1, len(code) + 1)]
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert notebook.metadata.kernelspec.name == "python3"
    text = file.read_text(encoding="utf-8")
    assert text == nbformat.writes(notebook, indent=1) + "\n"  # as Jupyter saves it
    assert len(text) < 400_000
    assert "<iframe" not in text


@pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)
def test_uses_public_names_only(file):
    tree = python_of(read(file))
    used = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            ours = [alias for alias in node.names if alias.name.split(".")[0] == "pinfric"]
            assert all(alias.name == "pinfric" and alias.asname == "pf" for alias in ours)
        elif isinstance(node, ast.ImportFrom):
            assert (node.module or "").split(".")[0] != "pinfric"
        elif (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id == "pf"
        ):
            used.add(node.attr)
        elif isinstance(node, ast.Attribute):
            assert not node.attr.startswith("_") or node.attr.endswith("__"), node.attr
    assert used
    assert used <= set(pf.__all__)


def test_pictures_are_small_and_shown():
    files = sorted((FOLDER / "pictures").glob("*.png"))
    assert [p.stem for p in files] == ["efforts", "replay", "work_precision"]
    pages = [ROOT / "README.md", FOLDER / "evidence.md", *FOLDER.glob("guide/*.md")]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    for picture in files:
        assert picture.stat().st_size < 150_000
        assert f"pictures/{picture.name})" in text


@pytest.mark.slow
@pytest.mark.parametrize("picture", ["efforts", "replay", "work_precision"])
def test_paper_of_the_pictures_is_white(picture):
    pixels = np.asarray(Image.open(FOLDER / "pictures" / f"{picture}.png").convert("RGB"))
    colors, counts = np.unique(pixels.reshape(-1, 3), axis=0, return_counts=True)
    assert tuple(colors[np.argmax(counts)]) == (255, 255, 255)


def test_pictures_script_says_what_it_makes():
    run = subprocess.run(
        [sys.executable, FOLDER / "make_pictures.py", "--help"], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    for name in ("efforts", "replay", "work_precision"):
        assert name in run.stdout
