"""Memory and processor time of an identification from one long log.

    python benchmarks/long_log.py [--kind arrays|csv] [--minutes 60] [--read]

The log is that of tests/identify_cases.py, six joints at 500 Hz, repeated after its 60 s with new
noise of the efforts. Prints the largest resident memory (the log's own arrays and the imports are
in it) and the processor time, of reading alone with --read. Linux and macOS.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from identify_cases import excitation, guess, logged, motor_effort, truth

import pinfric as pf
from pinfric.identification.recordings import read_recordings

RATE = 500.0


def arrays(minutes: int) -> pf.Log:
    """The log."""
    motion = excitation(0, 60.0, RATE)
    one = logged(0, motion, motor_effort(truth(), motion))
    q, effort = (np.tile(x, (minutes, 1)) for x in (one.q, one.effort))
    rng = np.random.default_rng(0)
    for column in effort.T:
        column += 0.05 * np.std(column) * rng.normal(size=column.size)
    return pf.Log(np.arange(len(q)) / RATE, q, effort)


def write_csv(log: pf.Log, path: Path) -> None:
    """Write the log as a file."""
    names = truth().joint_names
    table = np.column_stack((log.t, log.q, log.effort))
    header = ",".join(["t", *names, *(f"{name}/effort" for name in names)])
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=header, comments="")


def peak() -> float:
    """Largest resident memory so far, GB."""
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(size) * (1.0 if sys.platform == "darwin" else 1024.0) / 1e9


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", choices=("arrays", "csv"), default="arrays")
    parser.add_argument("--minutes", type=int, default=60)
    parser.add_argument("--read", action="store_true")
    parser.add_argument("--file", type=Path, help="a log that --kind csv has written before")
    given = parser.parse_args()
    if given.kind == "csv" and given.file is None:
        path = Path(tempfile.mkdtemp()) / "log.csv"
        write_csv(arrays(given.minutes), path)
        print(f"wrote {path}: run again with --file {path}, so that writing does not count")
        return
    log = arrays(given.minutes) if given.kind == "arrays" else given.file
    scene, before, start = guess(0), peak(), time.process_time()
    if given.read:
        read_recordings(scene, [log], {}, {}, pf.ReadingOptions())
    else:
        pf.identify(scene, log)
    print(
        f"{peak():.2f} GB ({before:.2f} before), {time.process_time() - start:.1f} s of processor"
    )


if __name__ == "__main__":
    main()
