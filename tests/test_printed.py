"""The comparison of printed text notices another word, count or figure."""

import pytest
import yaml
from printed import assert_printed
from tables import table

KEPT = "joint_12: 2.31 N m, 12 % friction, 31 rests of 1976 samples; 1.20e-5 rad, -2e-12 %"


CASES = """
2.31      2.32      true
2.31      2.33      false
2.31      2.310     true
12 %      13 %      true
12 %      14 %      false
31 rests  32 rests  false
1976      1977      true
1.20e-5   1.21e-5   true
1.20e-5   1.24e-5   false
1.20e-5   -1.20e-5  false
-2e-12    3.4e-13   true
-2e-12    3.4e-6    false
joint_12  joint_13  false
rests     stops     false
, in      ,LINEin   true
, -2e-12 %  NONE    false
"""


@pytest.mark.parametrize(("old", "new", "same"), table(CASES, str, str, yaml.safe_load))
def test_text_is_what_is_kept(tmp_path, old, new, same):
    new = new.replace("LINE", "\n  ").replace("NONE", "")
    (tmp_path / "printed").mkdir()
    (tmp_path / "printed/a.txt").write_text(KEPT)
    if same:
        assert_printed(tmp_path / "test.py", "a", KEPT.replace(old, new))
    else:
        with pytest.raises(AssertionError):
            assert_printed(tmp_path / "test.py", "a", KEPT.replace(old, new))
