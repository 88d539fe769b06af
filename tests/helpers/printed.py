"""Printed text and figures beside the stored text, `printed/NAME.txt` in the test's folder.

`PINFRIC_PRINTED=write pytest ...` writes them anew: read the difference before you commit.
"""

import os
import re
from pathlib import Path

import numpy as np

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
    """Assert stored words in their order, and figures within a unit of their last digit.

    Below 1e-7 a figure is an error of rounding or integration, and compared as 0.

    Args:
        test: `__file__` of the test. name: of the stored text. text: what was printed.
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


def part_of(axes, name):
    """The part of a panel that is drawn under a name."""
    (found,) = [artist for artist in axes.get_children() if artist.get_gid() == name]
    return found


def figure_text(figure):
    """A figure's content: of each panel its titles, range of time, texts and named parts.

    Of a line the ends of its places, how many are drawn and missing; of areas and bars their boxes.
    """
    lines = [f"{text.get_text()}" for text in figure.texts]
    for legend in figure.legends:
        words = [legend.get_title(), *legend.get_texts()]
        lines.append("key: " + "; ".join(text.get_text() for text in words))
    for axes in (axes for axes in figure.axes if axes.get_visible()):
        titles = [axes.get_title(loc=side) for side in ("left", "center", "right")]
        titles += [axes.get_ylabel().replace("\n", " "), axes.get_xlabel()]
        lines.append(f"panel: {' | '.join(filter(None, titles))}")
        lines += [f"  says {text.get_text()}" for text in axes.texts if text.get_text()]
        for artist in axes.get_children():
            if name := artist.get_gid() or ("line" if artist in axes.lines else ""):
                lines += [f"  {name} {part}" for part in drawn(artist)]
    return "\n".join(lines)


def drawn(artist):
    """The parts of one artist in words: boxes of its paths, or the ends of its places."""
    if hasattr(artist, "get_data"):
        x, y = (np.asarray(data, dtype=float) for data in artist.get_data())
        missing = np.isnan(y).sum()
        ends = np.r_[np.nanmin(x), np.nanmax(x), np.nanmin(y), np.nanmax(y)] if len(x) else []
        return [f"{len(x)} places, {missing} missing: " + " ".join(f"{x:.3g}" for x in ends)]
    boxes = [path.get_extents().extents for path in artist.get_paths() if len(path.vertices)]
    return ["box " + " ".join(f"{x:.3g}" for x in box) for box in boxes[:4]]
