"""A gear as a bearing that its torque loads, against efficiencies of a transmission and by hand.

They share no code: one is a load of the friction problem, the other lines of the drive's torque.
"""

from __future__ import annotations

import json
import re

import numpy as np
import pinocchio as pin
import pytest
from helpers.builders import chain, lump, random_states, random_tree
from helpers.cli_cases import URDF, told
from helpers.sizing_cases import write_catalog

import pinfric as pf
from pinfric.errors import SceneError
from pinfric.exporting.export import FORMATS

MU, COULOMB, RATIO, ROTOR = 0.12, 0.4, 50.0, 1e-4
RIGHT = {"kind": "gear"}


def both(model: pin.Model) -> tuple[pf.Scene, pf.Scene]:
    """The same robot with loads of bearings, and with efficiencies and no-load torques."""
    names, drive = model.names[1:], {"ratio": RATIO, "rotor_inertia": ROTOR}
    loss = {"efficiency": 1.0 / (1.0 + MU), "back_efficiency": 1.0 - MU}
    loss["no_load_torque"] = COULOMB / RATIO
    entry = {"bearing": RIGHT, "mu": {"static": MU, "kinetic": MU}, "coulomb": COULOMB}
    return (
        pf.Scene(
            model,
            friction=dict.fromkeys(names, entry),
            actuators=[{"joint": name, "transmission": drive} for name in names],
        ),
        pf.Scene(
            model,
            actuators=[{"joint": name, "transmission": drive | loss} for name in names],
        ),
    )


@pytest.mark.parametrize("seed", range(4))
def test_it_loses_what_a_transmission_with_these_efficiencies_does(seed):
    model = random_tree(seed, joints=5, sliding=0.0)
    ours, theirs = both(model)
    q, v, a = random_states(model, seed, 40)
    v[::4, seed % model.nv] = 0.0
    a[::4, seed % model.nv] = 0.0
    one, other = (pf.inverse_dynamics(scene, q, v, a) for scene in (ours, theirs))
    for end in ("motor_torque_lower", "motor_torque_upper"):
        np.testing.assert_allclose(getattr(one, end), getattr(other, end), rtol=1e-9, atol=1e-12)
    moving = np.flatnonzero((v != 0.0).all(axis=1))[:12]
    torque = other.motor_torque_lower[moving]
    for scene in (ours, theirs):
        found = pf.forward_dynamics(scene, q[moving], v[moving], motor_torque=torque)
        np.testing.assert_allclose(found.a, a[moving], rtol=1e-7, atol=1e-9)


M, R = 2.0, 0.5
FALLING = {
    "bearing": RIGHT,
    "mu": {"static": 0.3, "kinetic": 0.05},
    "coulomb": 0.65,
    "stribeck": {"velocity": 0.1, "exponent": 1.0},
}


def arm(**more: object) -> pf.Scene:
    """A mass of 2 kg, 0.5 m out on an axis along y."""
    model = chain(("arm", pin.JointModelRY(), lump(M, (R, 0.0, 0.0))))
    return pf.Scene(model, friction={"arm": FALLING}, **more)


def test_friction_falls_with_speed_under_load_and_not_without():
    """Unloaded 0.65 N m at any speed; under 9.81 N m 3.59 at rest, 1.26 at 0.3 rad/s."""
    v = np.array([0.0, 0.02, 0.3, -0.3, 0.3])
    q = np.array([0.0, 0.0, 0.0, 0.0, np.pi / 2])  # hanging it carries nothing
    found = pf.inverse_dynamics(arm(), q[:, None], v[:, None], np.zeros((5, 1)))
    load = M * 9.81 * R * np.abs(np.cos(q))
    friction = (0.05 + 0.25 * np.exp(-np.abs(v) / 0.1)) * load + 0.65
    rigid = -M * 9.81 * R * np.cos(q)
    np.testing.assert_allclose(found.effort_frictionless[:, 0], rigid, atol=1e-12)
    least, most = rigid + np.sign(v) * friction, rigid + np.sign(v) * friction
    least[0], most[0] = rigid[0] - friction[0], rigid[0] + friction[0]
    np.testing.assert_allclose(found.effort_lower[:, 0], least, rtol=1e-12)
    np.testing.assert_allclose(found.effort_upper[:, 0], most, rtol=1e-12)


@pytest.mark.parametrize("method", ["event", "timestepping"])
def test_it_breaks_away_where_its_friction_at_rest_ends(method):
    load = M * 9.81 * R
    for share, moves in ((0.99, False), (1.01, True)):
        effort = -load + share * (0.3 * load + 0.65)
        motion = pf.simulate(arm(), [0.0], [0.0], [effort], 0.2, method)
        assert (np.abs(motion.v[-1, 0]) > 0.01) == moves
        if moves:  # what it feels in motion is what the closed form asks for
            a = pf.forward_dynamics(arm(), [0.0], [0.3], [effort]).a[0]
            # I a + rigid + friction = effort, with the load |I a + rigid|
            net = (M * R**2 + 0.01) * a - load
            mu = 0.05 + 0.25 * np.exp(-3.0)
            assert net + mu * abs(net) + 0.65 == pytest.approx(effort, rel=1e-9)


LOSING = {"ratio": 50, "efficiency": 0.9, "back_efficiency": "same_loss"}
TWICE = "friction.arm.bearing: the losses of this gear are also in its transmission's `eff"


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: arm(actuators=[{"joint": "arm", "transmission": LOSING}]), TWICE),
        (lambda: arm(actuators=[{"joint": "arm", "name": "M1", "transmission": LOSING}]), TWICE),
        (
            lambda: pf.Solver(
                pf.Scene(
                    chain(("arm", pin.JointModelPX(), lump(M, (R, 0.0, 0.0)))),
                    friction={"arm": FALLING},
                )
            ),
            "a gear does not fit a prismatic joint; take guide or linear",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(build, says):
    with pytest.raises(SceneError, match=says):
        build()


#: In motion as in `THEIRS`, 0.3 at rest: it has fallen at once.
DROPS = "{static: 0.3, kinetic: 0.1}, stribeck: {velocity: 1.0e-3, exponent: 2.0}"
OURS = "friction: {shoulder: {bearing: {kind: gear}, mu: %s}}"
THEIRS = f", efficiency: {1 / 1.1}, back_efficiency: 0.9"
SCENES = {
    "ours.yaml": (OURS % "{static: 0.1, kinetic: 0.1}", ""),
    "theirs.yaml": ("", THEIRS),
    "drops.yaml": (OURS % DROPS, ""),
}
WHOLE = """pinfric: 1
robot: {urdf: arm.urdf, masses: without_drives}
%s
actuators: [{joint: shoulder, transmission: {ratio: 100, rotor_inertia: 5.0e-5%s}}]
simulation:
  start: {q: {shoulder: 0.3}}
  motor_torque: {shoulder: {sine: {amplitude: 0.16, angular_frequency: 3.0}}}
  t_end: 1.0
"""
BESIDE = {
    "arm.urdf": URDF,
    "way.yaml": """pinfric_trajectory: 1
sample_rate: 200
points: [{q: [0.0], hold: 0.3}, {q: [1.0], duration: 0.8, hold: 0.4}, {q: [-0.5], duration: 1.0}]
""",
    "motors.yaml": "pinfric_motors: 1\ndrives: {shoulder: {peak_torque: 0.3}}\n",
    "sweep.yaml": """pinfric_sweep: 1
samples: 8
parameters:
  speed: {uniform: {low: 0.8, high: 1.1}}
""",
}
#: What is said of the joint in front of its friction: behind the gear there is less.
AT_JOINT = re.compile(
    r"/(friction_share|max_interval|peak|rms|rms_least|stick\w*|\w+_loss|residual|frames)\b"
    r"|/sites|/stick_intervals|/evaluations"
)
HELD = 0.3 * M * 9.81 * R
RESTS = {"joints/0/rest_lower": -HELD, "joints/0/rest_upper": HELD}


def figures(said, path=""):
    """Yield path and value of all numbers in JSON."""
    if isinstance(said, dict | list):
        for key, value in said.items() if isinstance(said, dict) else enumerate(said):
            yield from figures(value, f"{path}/{key}")
    elif isinstance(said, float):
        yield path, said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "drops"),
    [
        ("inverse {} way.yaml", {"joints/0/motor_peak": None, "joints/0/max_interval": 2 * HELD}),
        ("simulate {}", {"end/q/0": None}),
        ("simulate {} --method timestepping", {"end/q/0": None}),
        ("size {} way.yaml --catalog catalog.yaml", {"joints/0/installed/motor/rms": None}),
        ("retime {} way.yaml --motors motors.yaml", {"duration": None}),
        ("sweep {} way.yaml sweep.yaml", {"joints/0/motor_peak/percentiles/50": None}),
        ("replay {} way.yaml", {"duration": None}),
        *((f"export {{}} --to {to} --trajectory way.yaml", RESTS) for to in FORMATS),
    ],
)
def test_every_command_says_of_it_what_it_says_of_these_efficiencies(
    command, drops, tmp_path, monkeypatch, capsys
):
    """All figures at the motors; where friction drops, one each, and those at rest by hand."""
    monkeypatch.chdir(tmp_path)
    for name, text in (BESIDE | {x: WHOLE % parts for x, parts in SCENES.items()}).items():
        (tmp_path / name).write_text(text)
    write_catalog(tmp_path / "catalog.yaml")
    said = {}
    for scene in SCENES:
        out = ["--html" if "replay" in command else "--out", f"{scene}_out"]
        code = 2 * command.startswith("size")  # no brake is sold
        text = told(capsys, *command.format(scene).split(), *out, "--json", code=code)[0]
        said[scene] = {path[1:]: x for path, x in figures(json.loads(text)["result"])}
    ours, theirs, fallen = said.values()
    same = [path for path in theirs if not AT_JOINT.search(f"/{path}")]
    assert len(same) >= 1
    assert {x: ours[x] for x in same} == pytest.approx({x: theirs[x] for x in same}, rel=1e-6)
    for path, value in drops.items():
        expected = theirs[path] if value is None else value
        assert fallen[path] == pytest.approx(expected, rel=1e-3), path
