"""Prints and figures of elastic gears, none of rigid ones."""

import json
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from cli_cases import results_in, told
from envelopes import result_of
from matplotlib import image
from printed import assert_printed

import pinfric as pf
from pinfric.elastic.summary import elastic_summary
from pinfric.model.described import in_json
from pinfric.show.inverse_summary import inverse_summary
from pinfric.show.report.inverse import inverse_report


@pytest.mark.slow
def test_the_command_writes_tables_json_and_a_picture(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    command = ("inverse", "ur10_machine_tending", "ur10_machine_tending")
    assert_printed(__file__, "inverse", told(capsys, *command).out)
    assert_printed(__file__, "inverse_verbose", told(capsys, *command, "-v", "--out", tmp_path).out)
    found = result_of((tmp_path / "summary.json").read_text())["elasticity"]
    assert found["tool"] == "tool0"
    assert found["lowest_frequency"]["least"] == pytest.approx(8.1726, abs=1e-3)
    assert [rest["tool"] is not None for rest in found["rests"]] == [True] * 5
    assert found["rests"][0]["tool"]["reversal_error"] is None  # nothing has moved before
    picture = image.imread(tmp_path / "tool.png")
    assert picture.shape[:2] == (660, 1500)
    assert len(np.unique(picture.reshape(-1, picture.shape[2]), axis=0)) > 50


BODY = '<origin xyz="1 0 0"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
ARM = """<robot name="arm"><link name="base"/><link name="upper">{}</link><link name="tip"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="5"/></joint>
  <joint name="wrist" type="revolute"><origin xyz="1 0 0"/><parent link="upper"/>
    <child link="tip"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="50" velocity="5"/>
  </joint></robot>"""
ELASTIC = """
pinfric: 1
robot: {urdf: arm.urdf, masses: {others: without_drives}}
tool: tip
actuators:
  - {joint: shoulder, transmission: {ratio: 100, stiffness: 2.0e+4}}
  - {joint: wrist, transmission: {ratio: 100, stiffness: 5.0e+3}}
"""


def test_rigid_scenes_print_and_write_what_they_did(tmp_path, capsys, monkeypatch):
    def never(*_):
        raise AssertionError("nothing here is elastic")

    for module in ("pinfric.show.views", "pinfric.sweeps.cycle"):  # they keep the real one
        import_module(module)
    monkeypatch.setattr("pinfric.elastic.motion.elasticity", never)  # no time, too
    said = told(capsys, "inverse", "pendulum", "pendulum", "--out", tmp_path, "--json")
    content = result_of(said.out)
    assert content["elasticity"] is None
    assert results_in(tmp_path) == [
        "efforts.csv",
        "efforts.pdf",
        "efforts.png",
        "summary.json",
    ]


def test_stiffness_changes_no_effort(door):
    """Bit by bit, and no table but its own."""
    scene = door.result.scene
    bare = [
        a.model_copy(
            update={
                "transmission": a.transmission.model_copy(
                    update={"stiffness": None, "hysteresis": None}
                )
            }
        )
        for a in scene.actuators
    ]
    motion = pf.load_trajectory("ur10_machine_tending", scene)
    rigid = pf.inverse_dynamics(scene.with_(actuators=bare, tool=None), motion)
    for name in ("effort_lower", "effort_upper", "motor_torque_lower", "motor_torque_upper"):
        np.testing.assert_array_equal(getattr(rigid, name), getattr(door.result, name))
    one, other = (in_json(inverse_summary(r, "cycle")) for r in (rigid, door.result))
    assert one == other
    both = (inverse_summary(rigid, "cycle", None, found) for found in (None, door))
    without, with_them = (inverse_report(rigid, found) for found in both)
    assert len(without) < len(with_them)


def test_json_is_json(door):
    json.dumps(in_json(elastic_summary(door)), allow_nan=False)


@pytest.mark.parametrize("moved", ["", f'<inertial><mass value="2"/>{BODY}</inertial>'])
def test_a_massless_link_behind_a_spring(tmp_path, monkeypatch, capsys, moved):
    """Efforts, no NaN, and what is missing; also where nothing has a mass."""
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(ARM.format(moved))
    Path("arm.yaml").write_text(ELASTIC)
    Path("way.yaml").write_text("pinfric_trajectory: 1\npoints: [{q: [0, 0], hold: 1}]\n")
    given = "arm.yaml", "way.yaml"
    frequency = result_of(told(capsys, "inverse", *given, "--json").out)["elasticity"]
    least = frequency["lowest_frequency"]["least"]
    assert least == (pytest.approx((2e4 / 2.1) ** 0.5 / (2 * np.pi)) if moved else None)
    for command in (("inverse", "-v"), ("size", "-v"), ("explain",)):
        code = 2 if command[0] == "size" and not moved else 0  # there is nothing to size
        out, err = told(capsys, command[0], *given, *command[1:], code=code)
        assert "nan" not in out + err
        if command[0] == "inverse":
            assert (
                f"a joint moves no mass ({'wrist' if moved else 'shoulder'}): its gear adds no"
                in out
            )
            assert "warning: joint wrist: moves no mass" in err or not moved
    said = told(capsys, "check", "arm.yaml", code=0 if moved else 2).out
    assert ("moves no mass" if moved else "nothing in this robot has mass") in said
