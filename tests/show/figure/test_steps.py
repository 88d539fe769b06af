import pytest
from identify_cases import NAMES, parameter

import pinfric as pf
from pinfric.errors import StateError
from pinfric.show.figure.elastic import tool_figure
from pinfric.show.figure.panel import panel, svg

# Elastic: pictures of elastic gears.


def test_figure_and_table_of_the_result(door):
    figure = door.plot(title="UR10")
    assert len(figure.axes) == 3
    lines = {text.get_text() for text in figure.legends[0].get_texts()}
    assert "positions that friction can hold" in lines
    table = door.summary()
    assert table.loc["shoulder_pan_joint", "strain_energy"] == pytest.approx(0.858, abs=1e-3)
    assert (table["lower"] <= table["upper"]).all()


def test_no_picture_without_a_tool(door):
    nameless = door.result.scene.with_(tool=None)
    motion = pf.load_trajectory("ur10_machine_tending", nameless)
    found = pf.elasticity(pf.inverse_dynamics(nameless, motion))
    with pytest.raises(StateError, match="no position of the tool at rest to draw: no `tool`"):
        tool_figure(found)


# Measured: measured efforts over the computed ones.


def test_measured_and_identified_efforts_are_shown_together(found):
    figure = found.plot()
    assert len(figure.axes) == len(NAMES)
    drawn = {line.get_gid() for line in figure.axes[1].lines}
    assert {"measured", "computed"} <= drawn
    table = found.summary()
    assert (
        table.loc[f"friction.{NAMES[2]}.mu", "value"] == parameter(found, "friction", 2, "mu").value
    )


# Panel: pictures of pages: places are rounded, text is not.


def test_ticks_keep_all_their_decimals():
    figure, axes = panel("time, s", "what is left, N m")
    axes.plot([0.0, 1.0], [0.0, 0.004])
    axes.set_yticks([0.001, 0.0025])
    shown = svg(figure, "a small figure")
    assert ">0.0010<" in shown
    assert ">0.0025<" in shown
    assert 'aria-label="a small figure"' in shown
