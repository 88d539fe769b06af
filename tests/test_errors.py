"""Every message is one line of a readable length, whatever the names in it hold."""

from __future__ import annotations

import pytest
from cli_cases import told

from pinfric import cli
from pinfric.errors import PinfricError, SceneError, choose_from, one_line, problems_line

HOSTILE = "a\nb\r\x1b[2Kc\x00\x85\u2028\ud800"


def test_a_message_has_no_letter_that_a_terminal_obeys():
    text = str(PinfricError(HOSTILE))
    assert text == r"a\nb\r\x1b[2Kc\x00\x85\u2028\ud800"
    assert len(text.splitlines()) == 1
    text.encode()  # no half of a surrogate pair
    assert one_line("μ 0.5 – µm") == "μ 0.5 – µm"  # noqa: RUF001 - letters that are shown
    assert str(SceneError("x" * 100_000)).startswith("xxx")
    assert len(str(SceneError("x" * 100_000))) < 10_000


def test_problems_are_counted_and_cut():
    assert problems_line("m.csv", ["one"]) == "m.csv: one"
    assert problems_line("m.csv", ["one", "two", "one"]) == "m.csv: 2 problems: one; two"
    many = problems_line("m.csv", [f"no {i}" for i in range(1000)])
    assert many == "m.csv: 1000 problems: no 0; no 1; no 2; no 3; no 4; and 995 more"


@pytest.mark.parametrize(
    ("name", "allowed", "taken", "says"),
    [
        ("swnig", ("swing", "lift"), (), "did you mean 'swing'? there are: swing, lift"),
        ("zzz", ("swing", "lift"), (), "there are: swing, lift"),
        ("t21", ("t1", "t2"), ("t1",), "did you mean 't2'? there are: t1, t2"),
        ("swnig", ("swing",), ("swing",), "there are: swing"),
        ("swing", (), (), "there are none"),
    ],
)
def test_the_nearest_name_that_is_free_is_offered(name, allowed, taken, says):
    assert choose_from(name, allowed, taken=taken) == says


def test_of_long_lists_the_nearest_three_names_are_said():
    names = [f"joint{i}" for i in range(1000)]
    text = choose_from("jiont7", names)
    assert text.startswith("the nearest of 1000: 'joint7', ")
    assert text.count("'") == 6
    assert choose_from("INT99", names) == "the nearest of 1000: 'joint99', 'joint990', 'joint991'"


@pytest.mark.parametrize("command", ["explain", "inverse", "replay", "new", "simulate"])
def test_a_file_name_cannot_break_the_line(command, tmp_path, capsys):
    name = str(tmp_path / "no\nsuch\x1b[31m\rfile")
    more = ["ur5_pick_and_place.csv"] if command == "inverse" else []
    error = told(capsys, command, name, *more, code=cli.BAD_INPUT).err
    assert error.count("\n") == 1
    assert error.strip().isprintable()
    assert r"no\nsuch\x1b[31m\rfile" in error
