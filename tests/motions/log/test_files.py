"""Logs in the dialects of robots and their tools: columns, units, rows, bags, and bad files."""

import io
import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from log_cases import (
    PLAIN,
    Q,
    T,
    arm,
)
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.errors import PinfricWarning, TrajectoryError
from pinfric.motions.log.formats import registry
from pinfric.motions.log.formats.csv_file import open_csv
from pinfric.motions.log.frame import MOST_ROWS, arrays_log, check_size


def test_gzipped_files_with_a_mapping_beside_them(tmp_path):
    import gzip

    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(PLAIN.encode()))
    assert_allclose(pf.load_trajectory(tmp_path / "log.csv.gz", arm()).q, Q, atol=1e-11)
    (tmp_path / "log.columns.yaml").write_text("joints: {base_turn: arm_lift, arm_lift: base_turn}")
    turned = pf.load_trajectory(tmp_path / "log.csv.gz", arm()).q
    assert_allclose(turned, Q[:, ::-1], atol=1e-11)
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


def test_a_format_is_found_by_the_end_of_its_files_names(tmp_path, monkeypatch):
    """A new one is a function with `opens` above it: no list names it."""
    monkeypatch.setattr(registry, "_KNOWN", {**registry._KNOWN})

    @registry.opens(".own")
    def open_own(path):
        table = np.loadtxt(path)
        return arrays_log(dict(zip(("t", "base_turn", "arm_lift"), table.T, strict=True)), {})

    np.savetxt(tmp_path / "log.own", np.column_stack([T, Q]))
    assert_allclose(pf.load_trajectory(tmp_path / "log.own", arm()).q, Q, atol=1e-11)


def test_joints_of_one_row_each_stand_in_any_order_and_may_lack_one(tmp_path):
    rows = [f"{k / 100},{joint},{k}{joint == 'b':d}" for k in range(300) for joint in "ab"]
    rows[2:4] = rows[3:1:-1]
    del rows[10]  # a at the sixth time
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["time,joint,position", *rows]))
    log, problems = open_csv(file), []
    assert log.header == ["time", "a/position", "b/position"]
    a, b = log.read(["a/position", "b/position"], problems, ()).values.T
    assert problems == []
    expected = [10 * k for k in range(300) if k != 5]
    assert (a.tolist(), b.tolist()) == (expected, [x + 1 for x in expected])


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
    assert_allclose(motion.q, Q, atol=1e-12)
    assert_allclose(motion.reading.effort["arm_lift"], 7.0 * Q[:, 1], atol=1e-12)
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


def marked(whole, field, value):
    """A ZIP file whose members all have two other bytes in their headers, local and central."""
    changed = bytearray(whole)
    for mark, place in ((b"PK\x03\x04", field), (b"PK\x01\x02", field + 2)):
        start = -1
        while (start := whole.find(mark, start + 1)) >= 0:
            changed[start + place : start + place + 2] = value
    return bytes(changed)


def test_numpy_files_that_cannot_be_unpacked_are_refused(tmp_path):
    path, columns = tmp_path / "log.npz", {"t": T, "base_turn": Q[:, 0], "arm_lift": Q[:, 1]}
    np.savez_compressed(path, **columns)
    whole = path.read_bytes()
    large = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        large, {"descr": "<f8", "fortran_order": False, "shape": (10**12,)}
    )
    cases = [
        (marked(whole, 6, b"\x01\0"), "encrypted"),
        (marked(whole, 8, b"\x63\0"), "compression"),
    ]
    with zipfile.ZipFile(tmp_path / "large.npz", "w") as parts:
        parts.writestr("t.npy", large.getvalue() + bytes(80))
    cases.append(((tmp_path / "large.npz").read_bytes(), "Unable to allocate"))
    assert_allclose(pf.load_trajectory(path, arm()).q, Q)
    for content, why in cases:
        path.write_bytes(content)
        with pytest.raises(TrajectoryError, match=rf"log\.npz: cannot be read as a NumPy.*{why}"):
            pf.load_trajectory(path, arm())


JSON = {"t": T.tolist(), "names": ["arm_lift", "base_turn"], "position": Q[:, ::-1].tolist()}
RECORDS = [
    {"time": t, "base_turn": {"position": a}, "arm_lift": {"position": b}}
    for t, (a, b) in zip(T.tolist(), Q.tolist(), strict=True)
]


@pytest.mark.parametrize(
    "content",
    [
        JSON,
        {"log": {"t": T.tolist(), "q": Q.tolist()}},
        RECORDS,
        {"t": T.tolist(), "q": Q.T.tolist(), "note": "a text", "gear": 101.0},
    ],
)
def test_json_and_numpy_files(content, tmp_path):
    path = tmp_path / "log.json"
    path.write_text(json.dumps(content))
    if "log" in content:
        (tmp_path / "log.columns.yaml").write_text(
            "time: log.t\njoints: {base_turn: log.q_1, arm_lift: log.q_2}"
        )
    motion = pf.load_trajectory(path, arm())
    assert_allclose(motion.q, Q, atol=1e-12)
    assert_allclose(motion.t, T, atol=1e-9)
    if isinstance(content, dict) and "log" not in content:
        np.savez(tmp_path / "log.npz", **{key: np.array(x) for key, x in content.items()})
        assert_array_equal(pf.load_trajectory(tmp_path / "log.npz", arm()).q, motion.q)
    for name in ("log.json", "log.npz"):
        for damaged in (b"", b"{", b"PK\x03\x04" + bytes(100), b"[1, 2]", b'{"a": "text"}'):
            (tmp_path / name).write_bytes(damaged)
            with pytest.raises(TrajectoryError, match=rf"{name}: (cannot be read|holds no)") as e:
                pf.load_trajectory(tmp_path / name, arm())
            assert "\n" not in str(e.value)


NAMED = [
    {
        "header": {"stamp": {"sec": 1_700_000_000 + int(t), "nanosec": round(t % 1 * 1e9)}},
        "name": ["arm_lift", "base_turn"],
        "position": [b, a],
        "effort": [1.0, 2.0],
    }
    for t, (a, b) in zip(T.tolist(), Q.tolist(), strict=True)
]
PLAIN_RECORDS = [
    {"t": r["time"], "q": [r[n]["position"] for n in r if n != "time"]} for r in RECORDS
]


def lines_of(records):
    return "".join(json.dumps(record) + "\n" for record in records)


@pytest.mark.parametrize("ending", [".jsonl", ".ndjson"])
@pytest.mark.parametrize("records", [RECORDS, PLAIN_RECORDS, NAMED])
def test_json_lines(records, ending, tmp_path):
    path = tmp_path / f"log{ending}"
    path.write_text("\ufeff" + lines_of(records).replace("}\n", "}\n\n", 1))
    motion = pf.load_trajectory(path, arm())
    assert_allclose(motion.q, Q, atol=1e-12)
    assert_allclose(motion.t, T, atol=1e-9)
    if records is NAMED:
        assert_array_equal(motion.reading.effort["base_turn"], 2.0)


def test_json_lines_that_cannot_be_a_log(tmp_path):
    path = tmp_path / "log.jsonl"
    turned = [*NAMED[:7], NAMED[7] | {"name": ["base_turn", "arm_lift"]}, *NAMED[8:]]
    without = [{key: x for key, x in record.items() if key != "arm_lift"} for record in RECORDS]
    rows, whole = lines_of(RECORDS), lines_of(PLAIN_RECORDS)
    again = lines_of([*RECORDS[:200], *RECORDS[:200]])
    for text, says in (
        (whole[: whole.index("\n", 5000) + 9], "line 85 cannot be read as a JSON record"),
        (whole.replace("}\n", "\n", 1), "line 1 cannot be read"),
        ("[1, 2]\n" + whole, "line 1 cannot be read as a JSON record .no names with values"),
        ("\n", "has no records"),
        (lines_of([{"a": "text"}]), "holds no arrays of numbers"),
        (lines_of(turned), "the names of joints in name, or their order, change at record 8;"),
        (lines_of(without), "joints without a column: arm_lift"),
        (rows.replace("base_turn", "turn"), "joints without a column: base_turn"),
        (again, "at line 201"),
    ):
        path.write_text(text)
        with pytest.raises(TrajectoryError, match=rf"log\.jsonl: .*{says}") as caught:
            pf.load_trajectory(path, arm())
        assert "\n" not in str(caught.value)
    path.write_bytes(b"\xff\xfe{}\n")
    with pytest.raises(TrajectoryError, match="not a text file in UTF-8"):
        pf.load_trajectory(path, arm())


def test_names_beside_nested_values_say_the_joints(tmp_path):
    path = tmp_path / "log.json"
    nested = [
        {"stamp": r["time"], "msg": {k: n[k] for k in ("name", "position")}}
        for r, n in zip(RECORDS, NAMED, strict=True)
    ]
    path.write_text(json.dumps(nested))
    assert_allclose(pf.load_trajectory(path, arm()).q, Q, atol=1e-12)


def test_lists_of_parquet_files_are_columns(tmp_path):
    """As LeRobot records: `observation.state` of all joints, and what was asked of them."""
    import pandas as pd

    lists = {"observation.state": list(Q.astype(np.float32)), "action": list(-Q)}
    pd.DataFrame({"timestamp": T, "frame_index": range(len(T)), **lists}).to_parquet(
        tmp_path / "episode.parquet"
    )
    motion = pf.load_trajectory(tmp_path / "episode.parquet", arm())
    assert_allclose(motion.q, Q, atol=1e-6)
    assert "'frame_index', 'action_0', 'action_1'" in "\n".join(motion.warnings)


def episodes(file, numbers, joints=2, **columns):
    """A file of LeRobot 3.0 with a recording for each number, each from 0 s on."""
    import pandas as pd

    count = len(numbers)
    number = np.repeat(numbers, len(T))
    signs = np.repeat((-1.0) ** np.arange(count), len(T))
    state = (signs[:, None] * np.tile(Q, (count, 1))).astype(np.float32)
    rows = {
        "observation.state": list(state[:, :joints]),
        "action": list(-state[:, :joints]),
        "timestamp": np.tile(T, count).astype(np.float32),
        "frame_index": np.tile(np.arange(len(T)), count),
        "episode_index": number,
        "index": np.arange(number.size),
        "task_index": np.zeros(number.size, dtype=int),
    }
    pd.DataFrame(rows | columns).to_parquet(file)
    return file


def test_one_episode_of_a_file_is_a_log(tmp_path):
    file = episodes(tmp_path / "log.parquet", (3, 4, 5))
    with pytest.raises(
        TrajectoryError, match=r"has 3 recordings .*3, 4, 5.*`episode: 3`"
    ) as caught:
        pf.load_trajectory(file, arm())
    assert "\n" not in str(caught.value)
    mapping = tmp_path / "log.columns.yaml"
    for number, sign in ((3, 1.0), (4, -1.0), (5, 1.0)):
        mapping.write_text(f"episode: {number}")
        motion = pf.load_trajectory(file, arm())
        assert_allclose(motion.q, sign * Q, atol=1e-6)
        assert_allclose(motion.t, T, atol=1e-6)
        assert f"recording {number} of 3" in motion.warnings
        assert "episode" not in "".join(motion.warnings)
    mapping.unlink()
    assert_allclose(pf.load_trajectory(episodes(file, (7,)), arm()).q, Q, atol=1e-6)


def test_episodes_that_are_no_log(tmp_path):
    file, mapping = tmp_path / "log.parquet", tmp_path / "log.columns.yaml"
    mixed = np.where(np.arange(len(T)) % 2, 0, 1)
    for numbers, chosen, change, says in (
        ((0, 1), 2, {}, "columns: episode: there is no 2; there are 0, 1"),
        ((0, 1, 0), 0, {}, "0 is there again from line 801 on"),
        ((0, 1), 0, {"episode_index": np.tile(mixed, 2)}, "0 is there again from line 4 on"),
        ((0, 1), None, {"episode_index": np.tile(mixed, 2)}, "has 2 recordings"),
        ((0, 0), None, {}, "at line 401"),
        ((0, 0), 0, {}, "at line 401"),
        ((0, 1), 1, {"timestamp": np.r_[T, 0 * T]}, "at line 40[0-9]"),
        ((0, 1), 1, {"episode_index": [None] * 99 + [1] * 701}, "column episode_index"),
        ((0, 1), 1, {"joints": 1}, "no column is a joint of the scene"),
    ):
        mapping.write_text("{}" if chosen is None else f"episode: {chosen}")
        episodes(file, numbers, **change)
        with pytest.raises(TrajectoryError, match=rf"log\.parquet: .*{says}") as caught:
            pf.load_trajectory(file, arm())
        assert "\n" not in str(caught.value)
    (tmp_path / "plain.columns.yaml").write_text("episode: 1")
    (tmp_path / "plain.csv").write_text(PLAIN)
    with pytest.raises(TrajectoryError, match="episode: the log has no column episode_index"):
        pf.load_trajectory(tmp_path / "plain.csv", arm())


def test_parquet(tmp_path):
    import pandas as pd

    stamps = pd.to_datetime(1_700_000_000_000_000_000 + np.rint(T * 1e9).astype(np.int64))
    frame = pd.DataFrame({"timestamp": stamps, "base_turn": Q[:, 0], "arm_lift": Q[:, 1]})
    frame.to_parquet(tmp_path / "log.parquet")
    motion = pf.load_trajectory(tmp_path / "log.parquet", arm())
    assert_allclose(motion.t, T, atol=1e-9)
    assert_array_equal(motion.q, Q)
    (tmp_path / "cut.parquet").write_bytes((tmp_path / "log.parquet").read_bytes()[:-100])
    with pytest.raises(TrajectoryError, match="cannot be read as a Parquet file") as caught:
        pf.load_trajectory(tmp_path / "cut.parquet", arm())
    assert "\n" not in str(caught.value)


def write_parquet(file, metadata=None, **columns):
    import pyarrow as pa
    import pyarrow.parquet as parquet

    given = {"t": T, "base_turn": Q[:, 0], "arm_lift": Q[:, 1]} | columns
    made = pa.table(given)
    parquet.write_table(made.replace_schema_metadata(metadata), file)
    return file


def in_nanoseconds(kind):
    import pyarrow as pa

    return pa.array(1_700_000_000_000_000_000 + np.rint(T * 1e9).astype(np.int64)).cast(kind)


@pytest.mark.parametrize("zone", ["UTC", "Asia/Tokyo", "+01:00", None])
@pytest.mark.parametrize("unit", ["us", "ns"])
def test_parquet_times_with_a_zone_are_read_without_a_word(tmp_path, recwarn, zone, unit):
    import pyarrow as pa

    times = in_nanoseconds(pa.timestamp("ns")).cast(pa.timestamp(unit, zone))
    file = write_parquet(tmp_path / "log.parquet", t=times)
    motion = pf.load_trajectory(file, arm())
    assert_allclose(motion.t, T, atol=1e-9)
    assert_array_equal(motion.q, Q)
    assert [w for w in recwarn if not issubclass(w.category, PinfricWarning)] == []


def test_parquet_durations_decimals_and_rows_without_a_time(tmp_path):
    import decimal

    import pyarrow as pa

    durations = pa.array(np.rint(T * 1e9).astype(np.int64)).cast(pa.duration("ns"))
    places = pa.array([decimal.Decimal(f"{x:.9f}") for x in Q[:, 0]], pa.decimal128(12, 9))
    motion = pf.load_trajectory(
        write_parquet(tmp_path / "log.parquet", t=durations, base_turn=places), arm()
    )
    assert_allclose(motion.t, T, atol=1e-9)
    assert_allclose(motion.q, Q, atol=1e-9)
    stamps = in_nanoseconds(pa.timestamp("ns")).to_pylist()
    holes = pa.array([None if i == 200 else s for i, s in enumerate(stamps)], pa.timestamp("ns"))
    motion = pf.load_trajectory(write_parquet(tmp_path / "hole.parquet", t=holes), arm())
    assert_allclose(motion.t[-1], T[-1], atol=1e-9)
    assert_allclose(motion.t, np.delete(T, 200), atol=1e-9)


@pytest.mark.parametrize("metadata", [b"{}", b"no json", b'{"index_columns": ["gone"]}'])
def test_parquet_takes_any_metadata_of_pandas(tmp_path, metadata):
    file = write_parquet(tmp_path / "log.parquet", {b"pandas": metadata})
    assert_array_equal(pf.load_trajectory(file, arm()).q, Q)


def test_parquet_that_cannot_be_a_log(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as parquet

    file = write_parquet(tmp_path / "log.parquet", t=T[:0], base_turn=T[:0], arm_lift=T[:0])
    with pytest.raises(TrajectoryError, match=r"log\.parquet: has no rows"):
        pf.load_trajectory(file, arm())
    parquet.write_table(pa.table([T, T, T], names=["t", "base_turn", "base_turn"]), file)
    with pytest.raises(TrajectoryError, match=r"log\.parquet: two columns have the same name"):
        pf.load_trajectory(file, arm())
    parquet.write_table(pa.table({"t": np.zeros(MOST_ROWS + 1, dtype=np.int8)}), file)
    assert file.stat().st_size < 2**16
    with pytest.raises(TrajectoryError, match=r"log\.parquet: has more than 5,000,000 rows"):
        pf.load_trajectory(file, arm())


def test_many_columns_of_fewer_rows_are_too_much_as_well():
    check_size(Path("log.mat"), 2_500_000, 100)
    with pytest.raises(TrajectoryError, match=r"log\.mat: has more than 250,000,000 numbers"):
        check_size(Path("log.mat"), 2_500_001, 100)


def test_small_files_that_hold_far_more(tmp_path, monkeypatch):
    import gzip

    from scipy.io import savemat

    file = tmp_path / "log.csv.gz"
    for content, says in (
        (b"t,base_turn\n" + bytes(2**22), r"line 2 has more than 1,048,576 bytes"),
        (b"t,base_turn\n0,0\n" + b"\n" * MOST_ROWS, "has more than 5,000,000 rows"),
    ):
        file.write_bytes(gzip.compress(content, 1))
        with pytest.raises(TrajectoryError, match=rf"log\.csv\.gz: {says}"):
            pf.load_trajectory(file, arm())
    for module in ("frame", "formats.arrays"):
        monkeypatch.setattr(f"pinfric.motions.log.{module}.MOST_BYTES", 2**20)
    file.write_bytes(gzip.compress(b"t,base_turn\n" + b" " * 99 * 2**14 + b"\n" * 2**19))
    savemat(tmp_path / "log.mat", {"t": np.zeros(2**20)}, do_compression=True)
    for path in (file, tmp_path / "log.mat"):
        with pytest.raises(TrajectoryError, match="has more than 1,048,576 decompressed bytes"):
            pf.load_trajectory(path, arm())


@pytest.mark.parametrize(
    ("name", "package"), [("log.db3", "rosbags.highlevel"), ("log.parquet", "pyarrow.parquet")]
)
def test_a_missing_reader_names_the_extra(name, package, tmp_path, monkeypatch):
    (tmp_path / name).write_bytes(b"")
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(TrajectoryError, match=r"pip install 'pinfric\[logs\]'"):
        pf.load_trajectory(tmp_path / name, arm())
