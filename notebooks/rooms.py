"""Pictures of the architecture: `python notebooks/rooms.py` writes rooms.svg and one_state.svg.

Rooms are in the order of their imports: each imports only from rooms below it. Arcs are the actual
imports, without `errors`, which all rooms import. `STEPS` are the functions that are called for one
state.
"""

from __future__ import annotations

import re
from html import escape
from pathlib import Path

NOTEBOOKS = Path(__file__).parent
PACKAGE = NOTEBOOKS.parent / "pinfric"
#: From the top: room, what it is for, its parts where it has no folders.
ROOMS = {
    "cli": ("commands, options, exit codes", "cli, terminal, __main__"),
    "paper": (
        "the paper's formulation, a judge of ours",
        "bodies, equations, inverse, forward, simulate: only NumPy and SciPy",
    ),
    "show": ("tables, figures, pages, replays", ""),
    "front": ("begins a scene; names the files that users write", "new_scene, formats"),
    "tasks": (
        "what users ask, one folder a question",
        "sizing, retiming, sweeps, identification, exporting, accuracy",
    ),
    "drives": (
        "catalogues, conditions, limits, stops, elastic gears; findings; motions and logs",
        "stops, checking, elastic, drives, motions",
    ),
    "dynamics": ("writes friction problems of states and reads their solutions", ""),
    "friction": (
        "solves friction problems, with proofs; independent of the robot",
        "given_modes, search, rest, holding, branching",
    ),
    "model": (
        "description: robot, twin, bearings, laws, gears, loops; file formats",
        "scene, robot, twin, bearings, friction_terms, transmission, loops, schema",
    ),
    "kernels": (
        "compiles, caches and, for small problems, interprets kernels",
        "compiled, interpreted",
    ),
}
#: Where a folder or a file of the package belongs, if it is not a room of that name.
PARTS = {
    **dict.fromkeys(("terminal", "__main__"), "cli"),
    **dict.fromkeys(("new_scene", "formats"), "front"),
    **dict.fromkeys(
        (
            "sizing",
            "retiming",
            "sweeps",
            "identification",
            "exporting",
            "accuracy",
        ),
        "tasks",
    ),
    **dict.fromkeys(("stops", "checking", "elastic", "motions"), "drives"),
}
#: One state through the program: function, its module, what it does.
STEPS = {
    "inverse dynamics": (
        ("inverse_dynamics", "dynamics.inverse.inverse", "checks the motion"),
        ("solve_tree", "dynamics.inverse.tree", "goes through the samples in batches"),
        ("reactions", "dynamics.samples.reactions", "wrench at each joint, by Pinocchio"),
        ("normal_loads", "model.bearings", "load of each bearing"),
        ("friction_bounds", "model.laws", "friction, an interval at rest"),
        ("effort_bounds", "dynamics.samples.motion_kernels", "effort = frictionless - friction"),
    ),
    "forward dynamics": (
        ("forward_dynamics", "dynamics.forward.forward", "checks the state"),
        ("solve_instant", "dynamics.problem.instant", "writes the problem, tries modes, finishes"),
        ("solve_given_modes", "friction.given_modes", "friction and loads of given modes"),
        ("judge", "friction.given_modes", "checks whether modes obey the law"),
        ("search", "friction.search", "which joints at rest stick or slip"),
        ("finish", "dynamics.problem.instant", "accelerations, wrenches, friction of each joint"),
    ),
}
WIDTH, LEFT, RIGHT, HEIGHT, GAP, MARGIN = 830, 16, 660, 62, 18, 12
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
    return PARTS.get(part, part)


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
    return framed(lines, height, "Rooms of pinfric and their imports, which go down only")


def framed(lines: list[str], height: int, label: str) -> str:
    """Return lines of SVG with head, style and background."""
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img"'
            f' aria-label="{label}">',
            f"<style>{STYLE}</style>",
            '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7"'
            ' markerHeight="7" orient="auto"><path d="M0 0 8 4 0 8z" fill="#94a3b8"/></marker>'
            "</defs>",
            f'<rect width="{WIDTH}" height="{height}" rx="8" fill="white"/>',
            *lines,
            "</svg>\n",
        ]
    )


def steps_picture() -> str:
    """Return the picture of one state's way as SVG: a column for each question."""
    column, room, lines = WIDTH // 2, HEIGHT + 8, []
    for i, (question, steps) in enumerate(STEPS.items()):
        x, width = MARGIN + i * column, column - 2 * MARGIN
        lines.append(f'<text class="why" x="{x + 4}" y="26">{escape(question)}</text>')
        for k, (function, module, what) in enumerate(steps):
            y = 38 + k * (room + GAP)
            lines += [
                f'<rect class="room" x="{x}" y="{y}" width="{width}" height="{room}" rx="8"/>',
                f'<text class="name" x="{x + 14}" y="{y + 25}">{escape(function)}</text>',
                f'<text class="why" x="{x + 14}" y="{y + 43}">{escape(what)}</text>',
                f'<text class="parts" x="{x + 14}" y="{y + 60}">{escape(module)}</text>',
            ]
            if k:
                middle = x + width / 2
                lines.append(
                    f'<path class="import" d="M{middle:g} {y - GAP} V{y - 1}"'
                    ' marker-end="url(#tip)"/>'
                )
    longest = max(len(steps) for steps in STEPS.values())
    return framed(lines, 38 + longest * (room + GAP), "What one state goes through, step by step")


if __name__ == "__main__":
    for name, text in (("rooms", picture()), ("one_state", steps_picture())):
        (NOTEBOOKS / "pictures" / f"{name}.svg").write_text(text, encoding="utf-8")
