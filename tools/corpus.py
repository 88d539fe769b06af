"""Every URDF of a folder through check, new, inverse, size and export, as one table.

    python tools/corpus.py FOLDER [--expected FILE] [--write FILE]

Columns: the exit code of each command, the kinds of findings on the robot as a whole, seconds of
processor time. Each robot runs in a process of its own. With --expected, a table that --write made,
the exit code is 1 if a robot's codes or findings differ.
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
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from time import process_time

COMMANDS = ("check", "new", "inverse", "size", "export")
#: Findings that the table names; the others are those of single links and joints.
KINDS = (
    *("no mass", "masses", "equal masses", "one density", "equal inertias"),
    *("effort limit", "weak limit", "equal limits", "mimic", "does not load"),
)


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("folder", type=Path)
    arguments.add_argument("--expected", type=Path)
    arguments.add_argument("--write", type=Path)
    given = arguments.parse_args()
    files = sorted(given.folder.rglob("*.urdf"))
    with ProcessPoolExecutor(2, max_tasks_per_child=1) as pool:
        rows = list(pool.map(row_of, files, [given.folder] * len(files)))
    for row in rows:
        print(*row.values(), sep="\t")
    codes = [row[command] for row in rows for command in COMMANDS]
    counts = ", ".join(f"exit {code}: {codes.count(code)}" for code in (0, 2, 70))
    print(f"{len(rows)} robots; {counts}")
    if given.write:
        with given.write.open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, [*("robot", "found"), *COMMANDS], extrasaction="ignore")
            table.writeheader()
            table.writerows(rows)
    if not given.expected:
        return int(70 in codes)
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
    return int(bool(others) or 70 in codes)


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
        codes += [run("inverse", scene, way)[0], run("size", scene, way, "--catalog", "default")[0]]
        codes += [run("export", scene, "--to", "mjcf", "--out", Path(made) / "robot.xml")[0]]
    return {
        "robot": urdf.relative_to(folder).as_posix(),
        **dict(zip(COMMANDS, codes, strict=True)),
        "seconds": round(process_time() - begun, 1),
        "found": ", ".join(kind for kind in KINDS if kind in kinds),
    }


if __name__ == "__main__":
    sys.exit(main())
