"""A wrist whose second motor moves with the first joint, identified from a log with known truth."""

from pathlib import Path

import numpy as np
import pytest

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.laws import Law

_URDF = """<robot name="wrist"><link name="base"/>
<link name="first"><inertial><origin xyz="0.3 0 0"/><mass value="4"/>
  <inertia ixx="0.02" iyy="0.05" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="second"><inertial><origin xyz="0.2 0.05 0"/><mass value="2"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="first"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="200" velocity="5"/></joint>
<joint name="j2" type="revolute"><parent link="first"/><child link="second"/><origin xyz="0.4 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="5"/></joint></robot>"""


def _scene(folder: Path, gears: list[dict], friction: dict, factor: float | None) -> pf.Scene:
    (folder / "wrist.urdf").write_text(_URDF)
    actuators = [{"joint": f"j{i + 1}", "transmission": gear} for i, gear in enumerate(gears)]
    if factor is not None:
        actuators[1]["couples"] = {"j1": factor}
    (folder / "scene.yaml").write_text("pinfric: 1\nrobot: {urdf: wrist.urdf}\n")
    return pf.load_scene(folder / "scene.yaml").with_(friction=friction, actuators=actuators)


#: Friction of the second motor by direction, N m.
_DRY = {
    "positive": {"static": 0.03, "kinetic": 0.03},
    "negative": {"static": 0.04, "kinetic": 0.04},
}


def test_friction_on_a_coupled_motors_side_is_found(tmp_path: Path) -> None:
    """Without the coupling the second motor's effort is missed; a scene without it says so."""
    coulomb = {"coulomb": {"static": 3.0, "kinetic": 3.0}, "viscous": 2.0}
    gears = [
        {"ratio": 80.0, "rotor_inertia": 1e-5},
        {"ratio": -50.0, "no_load_torque": _DRY, "motor_viscous": 4e-4},
    ]
    true = _scene(tmp_path, gears, {"j1": coulomb}, -0.8)
    t = np.arange(0.0, 12.0, 0.01)
    w = np.array([[1.3, 2.9], [1.7, 3.7]])
    q, v, a = (
        np.stack([(s * f(np.outer(t, row)) @ row**k) for row in w], axis=1)
        for k, s, f in ((0, 0.4, np.sin), (1, 0.4, np.cos), (2, -0.4, np.sin))
    )
    found = pf.inverse_dynamics(true, q, v, a, t=t)
    effort = 0.5 * (found.motor_torque_lower + found.motor_torque_upper) * np.array([80.0, -50.0])
    effort += 0.01 * effort.std(axis=0) * np.random.default_rng(3).normal(size=effort.shape)
    log, bare = pf.Log(t, q, effort, name="log"), [{"ratio": 80.0}, {"ratio": -50.0}]
    laws = {"j1": Law(), "j2": Law()}
    known = {
        name: pf.identify(_scene(tmp_path, bare, {}, factor), [log], inertia="keep", laws=laws)
        for name, factor in (("coupled", -0.8), ("apart", None))
    }
    values = {p.key: p for p in known["coupled"].parameters}
    for key, value in (
        ("transmission.j2.no_load_torque.positive", 0.03),
        ("transmission.j2.no_load_torque.negative", 0.04),
        ("transmission.j2.motor_viscous", 4e-4),
        ("friction.j1.coulomb.positive", 3.0),
        ("friction.j1.viscous", 2.0),
    ):
        assert values[key].value == pytest.approx(value, rel=0.06), key
    errors = {name: one.errors["j2"].error / one.errors["j2"].rms for name, one in known.items()}
    assert errors["coupled"] < 0.02
    assert errors["apart"] > 5.0 * errors["coupled"]
    scene = known["coupled"].scene
    assert scene.drives[1].couples == ((0, -0.8),)
    assert "j2" not in scene.friction
    known["coupled"].save(tmp_path / "out")
    assert "couples: {j1: -0.8}" in (tmp_path / "out" / "scene.yaml").read_text()
    said = "a law on the joint's side was asked for"
    assert any(line.startswith(said) and line.endswith(": j2") for line in known["coupled"].notes)
    assert not any(line.startswith(said) for line in known["apart"].notes)
    with pytest.raises(IdentificationError, match="coupled, so a sensor"):
        pf.identify(true, [log], effort_at="joint")


@pytest.mark.parametrize("ways", [(2e-3, 3e-3), (0.0, 0.0)], ids=["builds up", "jumps"])
def test_ways_of_coupled_drives_are_those_of_their_motors_angles(
    tmp_path: Path, ways: tuple[float, float]
) -> None:
    """Friction of the second motor builds up as q2 - 0.8 q1 goes on."""
    of_joint = {"coulomb": {"static": 3.0, "kinetic": 3.0}, "viscous": 2.0}
    gears = [
        {"ratio": 80.0, "rotor_inertia": 1e-5},
        {"ratio": -50.0, "no_load_torque": _DRY, "motor_viscous": 4e-4},
    ]
    for entry, way in zip((of_joint, gears[1]), ways, strict=True):
        entry |= {"presliding": {"way": way}} if way else {}
    true = _scene(tmp_path, gears, {"j1": of_joint}, -0.8)
    random, t = np.random.default_rng(1), np.arange(0.0, 20.0, 0.002)
    w, phase = random.uniform(0.6, 3.0, (2, 3)), random.uniform(0.0, 6.0, (2, 3))
    q, v, a = (
        np.stack(
            [size * f(np.outer(t, row) + p) @ row**k for row, p in zip(w, phase, strict=True)], 1
        )
        for k, size, f in ((0, 0.35, np.sin), (1, 0.35, np.cos), (2, -0.35, np.sin))
    )
    found = pf.inverse_dynamics(true, q, v, a, t=t)
    effort = 0.5 * (found.motor_torque_lower + found.motor_torque_upper) * np.array([80.0, -50.0])
    effort = np.stack([np.interp(t - 0.004, t, column) for column in effort.T], axis=1)
    effort += 0.01 * effort.std(axis=0) * random.normal(size=effort.shape)
    count = 2.0 * np.pi / 2**18
    log = pf.Log(t, count * np.rint(q / count), effort, name="log")
    scene = _scene(tmp_path, [{"ratio": 80.0}, {"ratio": -50.0}], {}, -0.8)
    known = pf.identify(scene, [log], inertia="keep", laws={"j1": Law(), "j2": Law()})
    assert known.delay == pytest.approx(0.004, abs=5e-4)
    intervals = {p.key: (p.low, p.high) for p in known.parameters if "presliding" in p.name}
    if not ways[0]:
        assert not intervals
        return
    for key, way in zip(("friction.j1", "transmission.j2"), ways, strict=True):
        low, high = intervals[f"{key}.presliding.way"]
        assert low < way < high < 1.5 * low, key
    assert all(error.moving_share < 0.01 for error in known.errors.values())
