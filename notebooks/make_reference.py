"""Write keys, options and results from the code into the reference's pages.

    python notebooks/make_reference.py

A page holds them between two marks, so that a clone shows them, too; tests/repository/test_docs.py
compares.
"""

from __future__ import annotations

import re
from pathlib import Path

import typer
from file_keys import FormatPage
from result_keys import result_lines

from pinfric.cli import app
from pinfric.formats import FORMATS

FOLDER = Path(__file__).parent / "reference"
_BEGIN, _END = "<!-- made from the code by make_reference.py -->", "<!-- end of what is made -->"


def command_lines() -> list[str]:
    """Return what `--help` of each command says, as Markdown."""
    lines = []
    for name, command in typer.main.get_command(app).commands.items():  # type: ignore[attr-defined]
        context = command.make_context(
            f"pinfric {name}", [], resilient_parsing=True, terminal_width=78, max_content_width=78
        )
        lines += [f"## pinfric {name}", "", "```text", command.get_help(context), "```", ""]
    return lines


def made() -> dict[Path, str]:
    """Return the pages of the reference that hold what the code says, as they should be."""
    places: dict[str, tuple[str, str]] = {}
    order = dict.fromkeys(("scene", "catalog", *FORMATS))  # where what several have is stated
    parts = {name: FormatPage(name, places).lines for name in order}
    parts |= {"commands": command_lines(), "results": result_lines()}
    pages = {}
    for name, lines in parts.items():
        page = FOLDER / f"{name}.md"
        before, mark, rest = page.read_text(encoding="utf-8").partition(_BEGIN)
        after = rest.partition(_END)[2]
        assert mark, page
        text = re.sub(r"[ \t]+$", "", "\n".join(lines).strip(), flags=re.MULTILINE)
        pages[page] = f"{before}{_BEGIN}\n\n{text}\n\n{_END}{after}"
    return pages


if __name__ == "__main__":
    for page, text in made().items():
        page.write_text(text, encoding="utf-8")
