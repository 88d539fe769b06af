"""Every URDF of a folder through check, new, inverse, size and export, as one table.

    python tools/corpus.py FOLDER [--mistakes] [--expected FILE] [--write FILE]

Columns: the exit code of each command, errors and warnings of check, what size signs, the kinds of
findings on the robot as a whole, seconds of processor time. Each robot has its own process.
With --mistakes each robot is spoilt by each of `MISTAKES` in turn. The exit code is 1 if a joint is
signed beside an error or, with --expected, a table that --write made, if codes or findings differ.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import json
import sys
import tempfile
import warnings
import xml.etree.ElementTree as ElementTree
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from time import process_time

_LIMITS = (("joint[@type='revolute']/limit", ("lower", "upper")),)
_SLIDES = (("joint[@type='prismatic']/limit", ("lower", "upper")),)
_MASSES = (("link/inertial/mass", ("value",)),)
_MOMENTS = (("link/inertial/inertia", ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),)
_COMS = (("link/inertial/origin", ("xyz",)),)
_LENGTHS = (("joint/origin", ("xyz",)), *_COMS, ("link/*/origin", ("xyz",)))
#: Mistake -> attributes of a URDF, a factor on them, and of how many elements, the last ones.
MISTAKES = {
    "none": ((), 1.0, None),
    "limits in degrees": (_LIMITS, 57.29578, None),
    "one limit in degrees": (_LIMITS, 57.29578, 1),
    "slide in mm": (_SLIDES, 1e3, None),
    "masses in g": (_MASSES, 1e3, None),
    "masses and inertias in g": ((*_MASSES, *_MOMENTS), 1e3, None),
    "masses in t": ((*_MASSES, *_MOMENTS), 1e-3, None),
    "one mass in g": (_MASSES, 1e3, 1),
    "lengths in mm": (_LENGTHS, 1e3, None),
    "one joint in mm": ((("joint/origin", ("xyz",)),), 1e3, 1),
    "inertias in g mm^2": (_MOMENTS, 1e9, None),
    "inertias in kg mm^2": (_MOMENTS, 1e6, None),
    "centres of mass in mm": (_COMS, 1e3, None),
    "turns in degrees": ((("joint/origin", ("rpy",)),), 57.29578, None),
    "no mass": ((*_MASSES, *_MOMENTS), 0.0, None),
}
COMMANDS = ("check", "new", "inverse", "size", "export")
#: Findings that the table names; the others are those of single links and joints.
KINDS = (
    *("no mass", "masses", "equal masses", "one density", "equal inertias"),
    *("effort limit", "weak limit", "equal limits", "mimic", "does not load"),
)


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("--mistakes", action="store_true")
    arguments.add_argument("--expected", type=Path)
    arguments.add_argument("--write", type=Path)
    given = arguments.parse_args()
    files = sorted(given.folder.rglob("*.urdf"))
    with tempfile.TemporaryDirectory() as spoilt:
        folder = given.folder
        if given.mistakes:
            folder, files = Path(spoilt), [x for file in files for x in spoil(file, Path(spoilt))]
        with ProcessPoolExecutor(2, max_tasks_per_child=1) as pool:
            rows = list(pool.map(row_of, files, [folder] * len(files)))
    for row in rows:
        print(*row.values(), sep="\t")
    codes = [row[command] for row in rows for command in COMMANDS]
    counts = ", ".join(f"exit {code}: {codes.count(code)}" for code in (0, 2, 70))
    print(f"{len(rows)} robots; {counts}")
    wrong = [row["robot"] for row in rows if row["errors"] and row["signed"]]
    print(f"{len(wrong)} signed beside an error: {', '.join(map(str, wrong))}")
    if given.write:
        with given.write.open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, [*("robot", "found"), *COMMANDS], extrasaction="ignore")
            table.writeheader()
            table.writerows(rows)
    if not given.expected:
        return int(bool(wrong) or 70 in codes)
    with given.expected.open(encoding="utf-8") as file:
        wanted = {row["robot"]: row for row in csv.DictReader(file)}
    names = {str(row["robot"]) for row in rows}
    others = [f"{name}: only in one of the two tables" for name in names ^ wanted.keys()]
    others += [
        f"{row['robot']}: {key} {row[key]}, expected {wanted[row['robot']][key]}"
        for row in rows
        for key in ("found", *COMMANDS)
        if row["robot"] in wanted and str(row[key]) != wanted[row["robot"]][key]
    ]
    print(*others, f"{len(others)} differ from {given.expected.name}", sep="\n")
    return int(bool(others or wrong) or 70 in codes)


def spoil(urdf: Path, folder: Path) -> list[Path]:
    """Write a copy of a URDF for each mistake that changes it; its meshes are not there."""
    files = []
    for name, (parts, factor, count) in MISTAKES.items():
        tree, changed = ElementTree.parse(urdf), not parts
        for path, attributes in parts:
            elements = tree.getroot().findall(path)
            for element in elements[-count if count else 0 :]:
                for key in attributes:
                    values = [factor * float(x) for x in element.get(key, "").split()]
                    changed |= any(values) or factor == 0.0
                    if values:
                        element.set(key, " ".join(f"{x:.12g}" for x in values))
        if changed:
            files.append(folder / f"{urdf.stem}-{name}.urdf".replace(" ", "_"))
            tree.write(files[-1])
    return files


def row_of(urdf: Path, folder: Path) -> dict[str, object]:
    """Run the commands on one robot."""
    from pinfric import cli

    def run(*words: object) -> tuple[int, str]:
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(io.StringIO()):
            try:
                cli.main([str(word) for word in words])
            except SystemExit as ended:
                return int(ended.code or 0), said.getvalue()
        return 0, said.getvalue()

    warnings.simplefilter("ignore")
    begun = process_time()
    with tempfile.TemporaryDirectory() as made:
        code, text = run("check", urdf, "--json")
        findings = json.loads(text).get("result", {}).get("findings", []) if text else []
        kinds = {finding["kind"] for finding in findings}
        codes = [code, run("new", urdf, "--out", made)[0]]
        scene, way = (Path(made) / f"{urdf.stem}{end}" for end in (".yaml", ".waypoints.yaml"))
        codes.append(run("inverse", scene, way)[0])
        code, text = run("size", scene, way, "--catalog", "default", "--json")
        verdict = json.loads(text)["result"]["verdict"] if text else {}
        codes.append(code)
        codes += [run("export", scene, "--to", "mjcf", "--out", Path(made) / "robot.xml")[0]]
    return {
        "robot": urdf.relative_to(folder).as_posix(),
        **dict(zip(COMMANDS, codes, strict=True)),
        "errors": sum(finding["severity"] == "error" for finding in findings),
        "warnings": sum(finding["severity"] == "warning" for finding in findings),
        "signed": verdict.get("fitted", 0),
        "headline": verdict.get("headline", ""),
        "remarks": " | ".join(verdict.get("remarks", ())),
        "seconds": round(process_time() - begun, 1),
        "found": ", ".join(kind for kind in KINDS if kind in kinds),
    }


if __name__ == "__main__":
    sys.exit(main())
