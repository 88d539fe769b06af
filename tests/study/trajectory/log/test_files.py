"""Logs in the dialects of robots and their tools: columns, units, rows, bags, and bad files."""

import sys

import numpy as np
import pytest
from log_cases import (
    PLAIN,
    Q,
    T,
    arm,
)

import pinfric as pf
from pinfric.errors import TrajectoryError


def test_gzipped_files_with_a_mapping_beside_them(tmp_path):
    import gzip

    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(PLAIN.encode()))
    np.testing.assert_allclose(pf.load_trajectory(tmp_path / "log.csv.gz", arm()).q, Q, atol=1e-11)
    (tmp_path / "log.columns.yaml").write_text("joints: {base_turn: arm_lift, arm_lift: base_turn}")
    turned = pf.load_trajectory(tmp_path / "log.csv.gz", arm()).q
    np.testing.assert_allclose(turned, Q[:, ::-1], atol=1e-11)
    whole = (tmp_path / "log.csv.gz").read_bytes()
    for content in (
        whole[: len(whole) // 2],
        b"t,base_turn",
        whole[:200] + bytes(50) + whole[250:],
    ):
        (tmp_path / "log.csv.gz").write_bytes(content)
        with pytest.raises(
            TrajectoryError, match=r"log\.csv\.gz: (cannot be read|is not)"
        ) as caught:
            pf.load_trajectory(tmp_path / "log.csv.gz", arm())
        assert "\n" not in str(caught.value)


def test_matlab_files_with_a_mapping(tmp_path):
    from scipy.io import savemat

    rec = {"time": T, "deg": np.degrees(Q).T, "tau": 7.0 * Q, "note": "a text", "gear": 101.0}
    savemat(tmp_path / "log.mat", {"rec": rec, "other": np.zeros((3, 4)), "long": np.zeros(999)})
    (tmp_path / "log.columns.yaml").write_text("""
time: {column: rec.time, unit: s}
unit: deg
joints:
  base_turn: {position: rec.deg_1, effort: rec.tau_1}
  arm_lift: {position: rec.deg_2, effort: rec.tau_2}
""")
    motion = pf.load_trajectory(tmp_path / "log.mat", arm())
    np.testing.assert_allclose(motion.q, Q, atol=1e-12)
    np.testing.assert_allclose(motion.reading.effort["arm_lift"], 7.0 * Q[:, 1], atol=1e-12)
    (tmp_path / "log.columns.yaml").unlink()
    with pytest.raises(TrajectoryError, match=r"there are: rec\.time, rec\.deg_1, rec\.deg_2"):
        pf.load_trajectory(tmp_path / "log.mat", arm())
    whole = (tmp_path / "log.mat").read_bytes()
    newer = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"  # the header of version 7.3
    damaged, other = "cannot be read as a MATLAB file: ", "is of MATLAB's version 7.3; save it"
    for content, message in (
        (whole[: len(whole) // 2], damaged),
        (b"", damaged),
        (b"MATLAB 7.3" + bytes(200), damaged),
        (newer + bytes(512), other),
    ):
        (tmp_path / "log.mat").write_bytes(content)
        with pytest.raises(TrajectoryError, match=rf"log\.mat: {message}") as caught:
            pf.load_trajectory(tmp_path / "log.mat", arm())
        assert "\n" not in str(caught.value)


def test_parquet(tmp_path):
    import pandas as pd

    stamps = pd.to_datetime(1_700_000_000_000_000_000 + np.rint(T * 1e9).astype(np.int64))
    frame = pd.DataFrame({"timestamp": stamps, "base_turn": Q[:, 0], "arm_lift": Q[:, 1]})
    frame.to_parquet(tmp_path / "log.parquet")
    motion = pf.load_trajectory(tmp_path / "log.parquet", arm())
    np.testing.assert_allclose(motion.t, T, atol=1e-9)
    np.testing.assert_array_equal(motion.q, Q)
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "log.parquet").read_bytes()[:-100])
    with pytest.raises(TrajectoryError, match="cannot be read as a Parquet file") as caught:
        pf.load_trajectory(tmp_path / "cut.parquet", arm())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "package"), [("log.db3", "rosbags.highlevel"), ("log.parquet", "pyarrow.parquet")]
)
def test_a_missing_reader_names_the_extra(name, package, tmp_path, monkeypatch):
    (tmp_path / name).write_bytes(b"")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(TrajectoryError, match=r"pip install 'pinfric\[logs\]'"):
        pf.load_trajectory(tmp_path / name, arm())
