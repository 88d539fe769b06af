"""Pictures of elastic gears."""

from __future__ import annotations

import pytest

import pinfric as pf
from pinfric.errors import StateError
from pinfric.show.figure.elastic import tool_figure


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
