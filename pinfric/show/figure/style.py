"""Style of all pictures."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

#: Colours of text: what is read first, what is read second; of grids.
INK, QUIET, GRID = "#222222", "#6B6B6B", "#E6E6E6"
#: Okabe and Ito's palette, told apart with every kind of colour vision, and two light tints of it.
BLUE, ORANGE, GREEN, RED = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, YELLOW, PURPLE = "#56B4E9", "#F0E442", "#CC79A7"
BAND, PALE_RED = "#A9CFE8", "#F2B38B"


#: Fonts that have the Chinese, Japanese and Korean letters that DejaVu lacks.
_FALLBACK = ("Noto Sans CJK JP", "Noto Sans CJK SC", "WenQuanYi Micro Hei", "IPAGothic")


@cache
def _others() -> list[str]:
    """Return the fallback fonts installed here: matplotlib logs a line for each missing one."""
    from matplotlib.font_manager import get_font_names

    return sorted(set(_FALLBACK) & set(get_font_names()), key=_FALLBACK.index)


def style() -> AbstractContextManager[None]:
    """Within, matplotlib draws in our style, whatever layout a user has on."""
    from matplotlib import rc_context

    return rc_context(
        {
            "font.size": 8.5,
            "font.family": ["DejaVu Sans", *_others()],
            "axes.edgecolor": QUIET,
            "axes.labelcolor": QUIET,
            "axes.titlelocation": "left",
            "axes.titlesize": 9,
            "axes.axisbelow": True,
            "legend.frameon": False,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "figure.constrained_layout.use": False,
            "figure.autolayout": False,
        }
    )
