"""Names cut so that each stands for one joint only."""

from __future__ import annotations

import re

from report_cases import FINGERS, printed

from pinfric.show.report.names import affixes, least_room, said_short, short_names, shortened
from pinfric.show.report.tables import Column, Kind, Table


def test_names_no_cut_tells_apart_are_folded_whole():
    names = [f"{'a' * 60}{i}{'z' * 60}" for i in range(3)]
    assert affixes(names) == ("", "")
    table = Table("", [Column("joint", Kind.NAME), Column("x")], [(n, "1.5") for n in names])
    lines = printed([table], 40)
    assert max(map(len, lines)) <= 40
    assert "".join(line.split()[0] for line in lines[2:]) == "".join(names)


def test_affixes_end_at_separators_and_leave_something():
    assert affixes(["panda_joint1", "panda_joint2"]) == ("panda_", "")
    assert affixes(["arm_1_joint", "head_joint"]) == ("", "_joint")
    assert affixes(["ns/arm/q.pos", "ns/leg/q.pos"]) == ("ns/", "/q.pos")
    assert affixes(["arm_1_joint", "arm_2_joint"]) == ("", "_joint")  # "1" says too little
    assert affixes(["a_joint", "a_joint"]) == ("", "")
    assert affixes(["left", "lever"]) == ("", "")
    assert affixes(["abc_", "abc_d"]) == ("", "")


def test_a_name_cut_in_its_middle_is_one_name_only():
    room = least_room(FINGERS)
    for size in (room, room + 3, 40):
        for short, name in zip(shortened(FINGERS, size), FINGERS, strict=True):
            assert len(short) <= size
            pattern = re.escape(short).replace("…", ".+")
            assert [x for x in FINGERS if re.fullmatch(pattern, x)] == [name]
    assert any("…" in name for name in shortened(FINGERS, room))
    assert shortened(["short", "names"], 16) == ["short", "names"]
    assert len(shortened(["x" * 50], 10)[0]) == 10


def test_sentences_name_joints_as_tables_do_but_not_in_keys_files_and_quotes():
    short = short_names(["panda_joint1", "panda_joint10"])
    line = "panda_joint10, panda_joint1: mu.panda_joint1 of 'panda_joint1' in panda_joint1.csv."
    said = "joint10, joint1: mu.panda_joint1 of 'panda_joint1' in panda_joint1.csv."
    assert said_short(line, short) == said
    assert said_short(line, {}) == line
    assert said_short("at (panda_joint1).", short) == "at (joint1)."


def test_long_names_are_cut_around_what_tells_them_apart():
    names = [f"left_front_gripper_number_{i}_proximal_joint" for i in range(12)]
    cut = shortened(names, 16)
    assert len(set(cut)) == 12
    assert all(len(name) == 16 for name in cut)
    assert all(f"_{i}_" in name for i, name in enumerate(cut))
    assert shortened(["short", "names"], 16) == ["short", "names"]
    assert len(shortened(["x" * 50], 10)[0]) == 10
