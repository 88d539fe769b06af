"""Pictures of pages: places are rounded, text is not."""

from __future__ import annotations

from pinfric.show.figure.panel import panel, svg


def test_ticks_keep_all_their_decimals():
    figure, axes = panel("time, s", "what is left, N m")
    axes.plot([0.0, 1.0], [0.0, 0.004])
    axes.set_yticks([0.001, 0.0025])
    shown = svg(figure, "a small figure")
    assert ">0.0010<" in shown
    assert ">0.0025<" in shown
    assert 'aria-label="a small figure"' in shown
