"""Style of all pictures."""

from __future__ import annotations

from contextlib import AbstractContextManager

#: Colours of text: what is read first, what is read second.
INK, QUIET = "#222222", "#6B6B6B"


def style() -> AbstractContextManager[None]:
    """Let matplotlib draw as all pictures do; places are ours, whatever layout a user has on."""
    from matplotlib import rc_context

    return rc_context(
        {
            "font.size": 8.5,
            "font.family": "DejaVu Sans",
            "axes.edgecolor": QUIET,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "figure.constrained_layout.use": False,
            "figure.autolayout": False,
        }
    )
