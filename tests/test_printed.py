"""What compares printed text sees a word, a count and a figure that are others."""

import pytest
from printed import assert_printed

KEPT = "joint_12: 2.31 N m, 12 % friction, 31 rests of 1976 samples; 1.20e-5 rad, -2e-12 %"


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("2.31", "2.32", True),
        ("2.31", "2.33", False),
        ("2.31", "2.310", True),
        ("12 %", "13 %", True),
        ("12 %", "14 %", False),
        ("31 rests", "32 rests", False),
        ("1976", "1977", True),
        ("1.20e-5", "1.21e-5", True),
        ("1.20e-5", "1.24e-5", False),
        ("1.20e-5", "-1.20e-5", False),
        ("-2e-12", "3.4e-13", True),
        ("-2e-12", "3.4e-6", False),
        ("joint_12", "joint_13", False),
        ("rests", "stops", False),
        (", in", ",\n  in", True),
        ("; 1.20e-5 rad, -2e-12 %", "", False),
    ],
)
def test_text_is_what_is_kept(tmp_path, old, new, same):
    (tmp_path / "printed").mkdir()
    (tmp_path / "printed/a.txt").write_text(KEPT)
    if same:
        assert_printed(tmp_path / "test.py", "a", KEPT.replace(old, new))
    else:
        with pytest.raises(AssertionError):
            assert_printed(tmp_path / "test.py", "a", KEPT.replace(old, new))
