"""The picture of the rooms: `python notebooks/rooms.py` draws pictures/rooms.svg from the imports.

Rooms stand in the order in which they may import: only what stands below. Arcs are imports that
there are; `errors` is left out, which all of them know.
"""

from __future__ import annotations

import re
from html import escape
from pathlib import Path

NOTEBOOKS = Path(__file__).parent
PACKAGE = NOTEBOOKS.parent / "pinfric"
#: From the top: room, what it is for, its parts where it has no folders.
ROOMS = {
    "cli": ("what a shell sees: commands, options, exit codes", "cli, terminal, __main__"),
    "paper": ("the paper's formulation, which judges ours", "bodies, equations, inverse, forward, "
              "simulate: NumPy and SciPy alone"),
    "show": ("tables, figures, pages, replays", ""),
    "study": ("what users ask: files, cycles, drives, logs", ""),
    "dynamics": ("from states to friction problems and back, in batches and in time",
                 "inverse, forward, simulate, holds, solver, check"),
    "friction": ("given a problem, finds friction and proofs; knows no robot",
                 "given_modes, modes, rest, holding, branching"),
    "model": ("what there is: robot, twin, bearings, laws, gears, loops; file formats",
              "scene, robot, twin, bearings, friction_terms, transmission, loops, schema"),
}  # fmt: skip
FRONT = {"cli": "cli", "terminal": "cli", "__main__": "cli"}
WIDTH, LEFT, RIGHT, HEIGHT, GAP, MARGIN = 760, 16, 590, 62, 18, 12
STYLE = (
    "text{font-family:system-ui,sans-serif;fill:#1f2937}"
    ".name{font-size:17px;font-weight:600}.why{font-size:13px}"
    ".parts{font-size:12px;fill:#6b7280}.room{fill:#eff6ff;stroke:#3b82f6;stroke-width:1.2}"
    ".judge{fill:#fff7ed;stroke:#ea8a2f;stroke-width:1.2;stroke-dasharray:5 3}"
    ".import{fill:none;stroke:#94a3b8;stroke-width:1.3}"
)


def room_of(module: str) -> str:
    """Return the room of a module of the package, given by its path or its name."""
    part = module.removeprefix("pinfric.").split(".")[0]
    return FRONT.get(part, part)


def imports() -> set[tuple[str, str]]:
    """Return which rooms import which others; without names for type checkers.

    Packages' own files and `model/upward.py` list such names.
    """
    found = set()
    for file in PACKAGE.rglob("*.py"):
        if file.name in ("__init__.py", "upward.py"):
            continue
        room = room_of(".".join(file.relative_to(PACKAGE).with_suffix("").parts))
        imported = re.findall(r"^ *from (pinfric\.[\w.]+) import", file.read_text("utf-8"), re.M)
        found |= {(room, room_of(module)) for module in imported}
    return {(a, b) for a, b in found if a != b and {a, b} <= set(ROOMS)}


def parts_of(room: str) -> str:
    """Return the folders of a room, or what stands in `ROOMS`."""
    folders = sorted(f.name for f in (PACKAGE / room).glob("*/") if (f / "__init__.py").is_file())
    return ROOMS[room][1] or ", ".join(folders)


def picture() -> str:
    """Return the picture as SVG."""
    top = {room: MARGIN + i * (HEIGHT + GAP) for i, room in enumerate(ROOMS)}
    lines = []
    for room, (why, _) in ROOMS.items():
        y, kind = top[room], "judge" if room == "paper" else "room"
        lines += [
            f'<rect class="{kind}" x="{LEFT}" y="{y}" width="{RIGHT - LEFT}" height="{HEIGHT}"'
            ' rx="8"/>',
            f'<text class="name" x="{LEFT + 14}" y="{y + 36}">{escape(room)}</text>',
            f'<text class="why" x="{LEFT + 124}" y="{y + 26}">{escape(why)}</text>',
            f'<text class="parts" x="{LEFT + 124}" y="{y + 46}">{escape(parts_of(room))}</text>',
        ]
    order = list(ROOMS)
    for upper, lower in sorted(imports(), key=lambda pair: [order.index(room) for room in pair]):
        span = order.index(lower) - order.index(upper)
        start = top[upper] + HEIGHT / 2 + 4 * span
        end = top[lower] + HEIGHT / 2 - 5 * (order.index(lower) - span)
        reach = RIGHT + 22 * abs(span) + 8
        curve = f"M{RIGHT} {start:g} C{reach} {start:g} {reach} {end:g} {RIGHT + 2} {end:g}"
        lines.append(f'<path class="import" d="{curve}" marker-end="url(#tip)"/>')
    height = MARGIN * 2 + len(ROOMS) * (HEIGHT + GAP) - GAP
    return "\n".join([
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img"'
        ' aria-label="Rooms of pinfric and their imports, which go down only">',
        f"<style>{STYLE}</style>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7"'
        ' markerHeight="7" orient="auto"><path d="M0 0 8 4 0 8z" fill="#94a3b8"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{height}" rx="8" fill="white"/>',
        *lines,
        "</svg>",
    ]) + "\n"  # fmt: skip


if __name__ == "__main__":
    (NOTEBOOKS / "pictures" / "rooms.svg").write_text(picture(), encoding="utf-8")
