"""YAML as version 1.2 reads it, and files made to break a reader."""

from pathlib import Path

import pytest
from tables import table

from pinfric.errors import SceneError
from pinfric.model.yamlfile import brief, read_yaml, yaml_line, yaml_text


def content(tmp_path, text):
    path = tmp_path / "file.yaml"
    path.write_text(text, encoding="utf-8")
    return read_yaml(path, SceneError)


def message(tmp_path, text):
    with pytest.raises(SceneError) as caught:
        content(tmp_path, text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500
    return str(caught.value).removeprefix(str(tmp_path))


#: As it is written, and as Python writes what is read.
SCALARS = """
010   10
-007  -7
+3    3
0o17  15
0x1F  31
0     0
1e-6  1e-06
1e3   1000.0
.5    0.5
5.    5.0
-1.5E+2  -150.0
-.inf    -inf
1:30     '1:30'
190:20:30.15  '190:20:30.15'
1_000  1000
0b101  5
true   True
False  False
yes    'yes'
off    'off'
~      None
null   None
2024-01-01  '2024-01-01'
'10'   '10'
1e     '1e'
0x     '0x'
"""


@pytest.mark.parametrize(("text", "value"), table(SCALARS))
def test_scalars_are_those_of_yaml_1_2(tmp_path, text, value):
    assert repr(content(tmp_path, f"key: {text}")["key"]) == value


def test_on_is_a_key_like_any_other(tmp_path):
    assert content(tmp_path, "{kind: guide, on: parent}") == {"kind": "guide", "on": "parent"}


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("a: " + "[" * 600 + "]" * 600, ["nested too deep"]),
        ("a: " + "{b: " * 600 + "}" * 600, ["nested too deep"]),
        ("a: " + "9" * 5000, ["line 1", "999 ... 999", "is no !!int"]),
        ("a: *" + "x" * 5000, ["line 1", "undefined alias"]),
        ("a: &a [*a]", ["within what it refers to"]),
        ("a: !!float wide", ["line 1", "'wide' is no !!float"]),
        ("a: !!int wide", ["line 1", "'wide' is no !!int"]),
        ("a: !!python/object:os.system x", ["not valid YAML", "python/object"]),
        (f"{'k' * 900}: 1\n{'k' * 900}: 1", ["line 2", "duplicate key"]),
        ("a: {b: 1, b: 2}", ["line 1", 'duplicate key "b" in one mapping; keep one']),
        ("a:\n\tb: 1", ["line 2", "a tab; indent with blanks"]),
    ],
    ids=lambda x: x[:12] if isinstance(x, str) else "",
)
def test_files_made_to_break_a_reader_get_one_short_line(tmp_path, text, parts):
    found = message(tmp_path, text)
    assert all(part in found for part in parts), found


def test_alias_bomb_is_refused_and_plain_aliases_are_not(tmp_path):
    lines = ["a: &a [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]"]
    for last, name in zip("abcdefghi", "bcdefghij", strict=True):
        lines.append(f"{name}: &{name} [{', '.join([f'*{last}'] * 10)}]")
    assert "its aliases (*name) make 1.2e+10 entries" in message(tmp_path, "\n".join(lines))
    shared = content(tmp_path, "mu: &mu {static: 0.2}\na: *mu\nb: *mu")
    assert shared["a"] == shared["b"] == {"static": 0.2}


def test_what_was_found_is_shown_in_brief():
    assert brief("word") == "'word'"
    assert len(brief(list(range(100_000)))) < 100
    assert brief("x" * 500).endswith("x'")


def test_what_is_written_is_read_back_with_comments_beside_it(tmp_path):
    content = {
        "friction": {"a b": {"mu": {"static": 0.25, "kinetic": 5e-5}, "viscous": 3.0}, "yes": {}},
        "drives": [{"joint": "010", "on": None}, {"joint": "#2", "q": [1, 2.5, True]}],
    }
    beside = {("friction", "a b", "mu"): "per load", ("drives", "1", "joint"): "the second"}
    text = yaml_text(content, beside)
    path = tmp_path / "a.yaml"
    path.write_text(text, encoding="utf-8")
    assert read_yaml(path, SceneError) == content
    assert "    mu: {static: 0.25, kinetic: 5.0e-05} # per load\n" in text
    assert "'#2' # the second\n" in text
    assert yaml_line(["a: b", 6e-5, None, [1e300]]) == "['a: b', 6.0e-05, null, [1.0e+300]]"


def test_a_file_without_end_is_refused():
    with pytest.raises(SceneError, match=r"^/dev/zero: is larger than 64 MiB$"):
        read_yaml(Path("/dev/zero"), SceneError)
