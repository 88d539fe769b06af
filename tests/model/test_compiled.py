"""Kernels outlive a damaged cache: it is said, and they are compiled anew."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
KERNEL = """
from pinfric.model.compiled import kernel

@kernel
def twice(x):
    return 2.0 * x

if __name__ == "__main__":
    import warnings
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        answer = twice(21.0)
    print(answer, sum(twice._cache_hits.values()), *[str(w.message) for w in said])
"""


def run(folder):
    done = subprocess.run(
        [sys.executable, "kernel_of_a_test.py"], cwd=folder, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(folder / "cache")},
        check=True, timeout=60,
    )  # fmt: skip
    answer, hits, *said = done.stdout.split(maxsplit=2)
    return float(answer), int(hits), "".join(said)


@pytest.mark.parametrize(
    ("suffix", "damage"),
    [
        (".nbc", lambda content: content[: len(content) // 2]),
        (".nbc", lambda content: b""),
        (".nbi", lambda content: content[:-5]),
        (".nbc", lambda content: content[:700] + bytes([content[700] ^ 1]) + content[701:]),
    ],
    ids=["truncated", "empty", "truncated index", "one bit"],
)
def test_a_damaged_cache_is_said_and_compiled_anew(suffix, damage, tmp_path):
    (tmp_path / "kernel_of_a_test.py").write_text(KERNEL)
    assert run(tmp_path) == (42.0, 0, "")
    assert run(tmp_path) == (42.0, 1, "")  # from the cache
    (file,) = (tmp_path / "cache").rglob(f"*{suffix}")
    file.write_bytes(damage(file.read_bytes()))
    answer, hits, said = run(tmp_path)
    assert (answer, hits) == (42.0, 0)
    assert f"{file}: a compiled kernel in numba's cache is damaged" in said
    assert run(tmp_path) == (42.0, 1, "")  # mended
