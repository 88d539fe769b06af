"""Printed text beside the text that is kept, `printed/NAME.txt` in the folder of the test.

`PINFRIC_PRINTED=write pytest ...` writes them anew: read the difference before it is committed.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

#: A number that stands alone: digits in names, files and units are words.
NUMBER = re.compile(r"(?<![\w.])(-?\d+(?:\.\d+)?(?:e[-+]?\d+)?)(?![\w.]*[A-Za-z_]|\.\d)( %)?")


def unit(number, percent=""):
    """One in the last printed digit; 0 of a count, which rounding does not move."""
    number = number.removeprefix("-")
    mantissa, _, power = number.partition("e")
    if number.isdigit() and len(number) < 3 and not percent:
        return 0.0
    return 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))


def assert_printed(test, name, text):
    """Words as they are kept, in their order; figures within a unit of their last digit.

    What is below 1e-7 is an error of rounding or integration: it is compared as 0.

    Args:
        test: `__file__` of the test.
        name: of the text that is kept.
        text: what was printed.
    """
    file = Path(test).parent / "printed" / f"{name}.txt"
    if os.environ.get("PINFRIC_PRINTED") == "write":
        file.parent.mkdir(exist_ok=True)
        lines = (line.rstrip() for line in text.splitlines())
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    said, kept = (re.sub("─+", "─", x) for x in (text, file.read_text(encoding="utf-8")))
    assert NUMBER.sub("#", said).split() == NUMBER.sub("#", kept).split()
    for new, old in zip(NUMBER.findall(said), NUMBER.findall(kept), strict=True):
        most = 1.001 * max(unit(*new), unit(*old), 1e-7)
        assert abs(float(new[0]) - float(old[0])) <= most, f"{file.name}: {new[0]}, kept {old[0]}"
