"""How simulate is used: efforts of every kind, bad input, interruption, limits, files, sampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import block, plane_friction, random_states, random_tree

import pinfric as pf
from pinfric.dynamics.simulation.crossing import first_crossing
from pinfric.dynamics.simulation.motion import Dense, mechanical_energy
from pinfric.errors import SimulationError, StateError

G = 9.81


def slope(angle: float = 0.0, **model_changes) -> pf.Scene:
    model = block(angle)
    for name, value in model_changes.items():
        setattr(model, name, np.array(value))
    return pf.Scene(model=model, friction={"slide": plane_friction(0.3, 0.25)})


# ---------------------------------------------------------------- efforts


def push(t: float) -> float:
    return 12.0 * t


@pytest.mark.parametrize(
    "effort",
    [
        lambda t, q, v: [push(t)],
        lambda t, q, v: np.array([push(t)]),
        ([0.0, 1.0], [[0.0], [12.0]]),
        (np.array([0.0, 0.5, 1.0]), np.array([[0.0], [6.0], [12.0]])),
        {"slide": push},
    ],
)
@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_one_effort_in_every_form(effort, method):
    motion = pf.simulate(slope(), [0.0], [0.0], effort, 1.0, method)
    np.testing.assert_allclose(motion.effort[:, 0], 12 * motion.t, atol=1e-9)
    breaks_away = 0.3 * 2 * G / 12
    if method == "event":
        assert motion.events[0].time == pytest.approx(breaks_away, rel=1e-12)
    elif method == "timestepping":
        assert motion.events[0].time == pytest.approx(breaks_away, abs=2e-3)
    else:
        assert motion.stick_intervals()[0].end < breaks_away  # knows only kinetic friction


def test_constants_and_mappings():
    rest = pf.simulate(slope(), [0.0], [0.0], {}, 0.5)
    assert (rest.effort == 0).all()
    moved = pf.simulate(slope(), [0.0], [0.0], {"slide": 10.0}, 0.5)
    same = pf.simulate(slope(), [0.0], [0.0], [10.0], 0.5)
    assert moved.q[-1] == same.q[-1] > 0


def test_the_scene_file_s_own_effort(tmp_path):
    (tmp_path / "table.csv").write_text("t, lift, slide\n0, 1, 0\n# comment\n2, 1, 24\n")
    (tmp_path / "block.urdf").write_text(
        '<robot name="b"><link name="base"/><link name="body"><inertial><mass value="2"/>'
        '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="slide" type="prismatic"><parent link="base"/><child link="body"/>'
        '<axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint></robot>'
    )
    text = """
pinfric: 1
robot: {urdf: block.urdf}
friction: {slide: {bearing: {kind: linear, radial: 1.0}, mu: {static: 0.3, kinetic: 0.25}}}
simulation: {effort: {slide: %s}, t_end: 1.0}
"""
    for entry in ("{table: table.csv}", "{sine: {amplitude: 8.0, angular_frequency: 3.0}}"):
        (tmp_path / "scene.yaml").write_text(text % entry)
        scene = pf.load_scene(tmp_path / "scene.yaml")
        motion = pf.simulate(scene, [0.0], [0.0], None, 1.0)
        expected = 12 * motion.t if "table" in entry else 8 * np.sin(3 * motion.t)
        np.testing.assert_allclose(motion.effort[:, 0], expected, atol=1e-12)
        assert motion.events[0].kind == "slip"
    for table, message in (("no.csv", "cannot be read"), ("scene.yaml", "no column 't'")):
        (tmp_path / "scene.yaml").write_text(text % f"{{table: {table}}}")
        with pytest.raises(SimulationError, match=message):
            pf.simulate(pf.load_scene(tmp_path / "scene.yaml"), [0.0], [0.0], None, 1.0)


def test_a_table_is_constant_beyond_its_ends_and_bends_where_it_bends():
    table = (np.array([0.2, 0.4]), np.array([[2.0], [10.0]]))
    motion = pf.simulate(slope(), [0.0], [0.0], table, 1.0)
    expected = np.interp(motion.t, *(table[0], table[1][:, 0]))
    np.testing.assert_allclose(motion.effort[:, 0], expected, atol=1e-9)
    slip = 0.2 + 0.2 * (0.3 * 2 * G - 2) / 8
    (event,) = motion.events
    assert event.time == pytest.approx(slip, rel=1e-12)


def test_an_effort_function_may_ask_for_forward_dynamics_itself():
    scene = slope(0.5)

    def effort(t, q, v):
        pf.forward_dynamics(scene, [0.3], [-1.0], [4.0])
        return [0.0]

    asked = pf.simulate(scene, [0.0], [1.0], effort, 0.3)
    plain = pf.simulate(scene, [0.0], [1.0], lambda t, q, v: [0.0], 0.3)
    np.testing.assert_array_equal(asked.q, plain.q)


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"q0": [np.nan]}, "q0: column 0 is nan"),
        ({"q0": [0.0, 1.0]}, r"q0: shape \(2,\); should be \(1,\)"),
        ({"v0": [np.inf]}, "v0: column 0 is inf"),
        ({"v0": []}, "v0: shape"),
        ({"effort": [np.nan]}, "effort: holds NaN"),
        ({"effort": [0.0, 1.0]}, r"effort: shape \(2,\); should be \(1,\), one for each of slide"),
        (
            {"effort": "full"},
            "effort: is not an array of numbers: it holds text; give real numbers, ",
        ),
        ({"effort": [1j]}, "effort: is not an array of numbers: it holds complex numbers"),
        ({"effort": lambda t, q, v: [1j]}, "returned no numbers at t = 0 s: .*complex"),
        ({"q0": [1j]}, "q0: .*complex"),
        ({"v0": [True]}, "v0: .*true and false"),
        ({"max_events": 2.5}, "max_events = 2.5: should be a whole number"),
        ({"effort": {"slid": 1.0}}, "no drive 'slid'; did you mean 'slide'"),
        ({"effort": {"slide": [1, 2]}}, "should be a number"),
        ({"effort": ([0.0, 0.0], [[0.0], [1.0]])}, "times do not increase at row 1"),
        ({"effort": ([0.0, 1.0], [0.0, 1.0])}, r"values of shape \(2,\)"),
        ({"effort": None}, "has no `simulation` section"),
        ({"effort": lambda t, q, v: [1.0, 2.0]}, r"returned shape \(2,\) at t = 0 s"),
        ({"effort": lambda t, q, v: "x"}, "returned no numbers at t = 0 s"),
        ({"effort": lambda t, q, v: [np.nan]}, "t = 0 s: effort: column 0 is nan"),
        ({"t_end": 0.0}, "t_end = 0.0: should be a positive number"),
        ({"t_end": -1.0}, "t_end"),
        ({"t_end": np.nan}, "t_end"),
        ({"t_end": 1e-300}, r"t_end = 1e-300 s: should be at least 1e-12 s"),
        ({"t_end": 1e155}, r"t_end = 1e.155 s: should be at most 1e.10 s"),
        ({"method": "timestepping", "dt": 1e-11}, "steps; at most 1e.09 are possible"),
        ({"rtol": 1e-300}, "rtol = 1e-300"),
        ({"t_end": "1"}, "t_end = '1'"),
        ({"dt": 0.0}, "dt = 0.0: should be a positive number"),
        ({"dt": -1e-3}, "dt"),
        ({"rtol": 0.0}, "rtol"),
        ({"sample_step": 0.0}, "sample_step"),
        ({"method": "euler"}, "method 'euler': there are: event, timestepping, regularized"),
        ({"breakpoints": [np.nan]}, "breakpoints"),
    ],
)
def test_bad_input(change, message):
    good = {"q0": [0.0], "v0": [0.0], "effort": [0.0], "t_end": 1.0}
    with pytest.raises((SimulationError, StateError), match=message):
        pf.simulate(slope(), **{**good, **change})


#: Each method's steps are short enough to meet what happens at 0.5 s.
SHORT = {"event": {"max_step": 0.01}, "timestepping": {}, "regularized": {"max_step": 0.01}}


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_an_effort_that_raises_says_what_and_when(method):
    def effort(t, q, v):
        if t > 0.5:
            raise ZeroDivisionError("the gripper is empty")
        return [1.0]

    with pytest.raises(SimulationError, match=r"ZeroDivisionError at t = 0\.5.*gripper") as error:
        pf.simulate(slope(), [0.0], [1.0], effort, 1.0, method, **SHORT[method])
    reached = error.value.motion
    assert reached.status == "failed"
    assert 0.45 < reached.t[-1] < 0.52
    assert isinstance(error.value.__cause__, ZeroDivisionError)


def test_a_configuration_off_its_manifold_is_normalized_with_a_warning():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelRUBX(), pin.SE3.Identity(), "wheel")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    with pytest.warns(pf.PinfricWarning, match="manifold"):
        motion = pf.simulate(pf.Scene(model=model), [2.0, 0.0], [1.0], [0.0], 0.1)
    np.testing.assert_allclose(np.linalg.norm(motion.q, axis=1), 1.0)


# ---------------------------------------------------------------- interruption, progress, limits


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_ctrl_c_returns_what_was_computed(method):
    def effort(t, q, v):
        if t > 0.5:
            raise KeyboardInterrupt
        return [1.0]

    motion = pf.simulate(slope(), [0.0], [3.0], effort, 1.0, method, **SHORT[method])
    assert motion.status == "interrupted"
    assert 0.45 < motion.t[-1] < 0.52
    assert motion.energy().change < 0
    assert len(motion.t) == len(motion.q) == len(motion.friction) > 400


def test_ctrl_c_before_the_first_sample_goes_on(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("pinfric.dynamics.simulation.simulate.EventIntegration", interrupted)
    with pytest.raises(KeyboardInterrupt):
        pf.simulate(slope(), [0.0], [3.0], [1.0], 1.0)


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_progress_is_told(method, capsys):
    seen: list[float] = []
    pf.simulate(slope(), [0.0], [1.0], [0.0], 1.0, method, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    pf.simulate(slope(), [0.0], [1.0], [0.0], 1.0, method)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("method", "within"), [("event", 1e-9), ("timestepping", 1e-3), ("regularized", 1e-3)]
)
def test_a_joint_that_leaves_its_range_is_reported_not_stopped(method, within):
    scene = slope(0.5, lowerPositionLimit=[-1.0], upperPositionLimit=[0.25])
    motion = pf.simulate(scene, [0.0], [0.0], [0.0], 1.0, method)
    a = G * (np.sin(0.5) - 0.25 * np.cos(0.5))
    limits = [e for e in motion.events if e.kind == "limit"]
    assert [(e.name, e.direction) for e in limits] == [("slide", 1)]
    assert limits[0].time == pytest.approx(np.sqrt(0.5 / a), abs=within)
    assert motion.q[-1, 0] > 0.5


def test_a_payload_and_a_wrench_from_outside_act_all_the_time():
    model = block(0.5)
    model.addBodyFrame("body", 1, pin.SE3.Identity(), 0)
    box = {"link": "body", "mass": 1.0, "com": [0, 0, 0]}
    scene = pf.Scene(model=model, payloads={"box": box})
    pull = {"body": np.array([-4.0, 0, 0, 0, 0, 0])}
    for method in ("event", "timestepping", "regularized"):
        motion = pf.simulate(scene, [0.0], [0.0], [1.0], 1.0, method, external=pull)
        assert motion.v[-1, 0] == pytest.approx(G * np.sin(0.5) - 1.0, rel=1e-6)
        empty = pf.simulate(scene, [0.0], [0.0], [1.0], 1.0, method, external=pull, attached=[])
        assert empty.v[-1, 0] == pytest.approx(G * np.sin(0.5) - 1.5, rel=1e-6)
        inverse = pf.inverse_dynamics(scene, empty, external=pull)
        np.testing.assert_allclose(inverse.effort_lower, 1.0, atol=1e-9)


# ---------------------------------------------------------------- sampling, energy, files


def swing(method="event", **options) -> pf.Motion:
    return pf.simulate(
        slope(), [0.0], [0.0], lambda t, q, v: [9 * np.sin(4 * t)], 2.0, method, **options
    )


def test_samples_come_at_their_times_and_at_events():
    motion = swing(sample_step=0.1)
    regular = np.arange(21) * 0.1
    events = [e.time for e in motion.events]
    assert len(events) >= 4
    np.testing.assert_allclose(motion.t, np.sort([*regular, *events]), atol=1e-12)
    assert (np.diff(motion.t) > 0).all()
    stepped = swing("timestepping", dt=1e-3, sample_step=0.1)
    np.testing.assert_allclose(stepped.t, regular, atol=1e-12)


def test_dense_sampling_agrees_with_the_samples():
    fine, coarse = swing(), swing(sample_step=2.0)
    times = fine.t[1:-1:7]
    dense = coarse.sample(times)
    np.testing.assert_allclose(dense.q, fine.q[1:-1:7], atol=1e-9)
    np.testing.assert_allclose(dense.a, fine.a[1:-1:7], atol=1e-7)
    np.testing.assert_array_equal(dense.modes, fine.modes[1:-1:7])
    assert (dense.v[dense.modes[:, 0] == 0] == 0).all()
    inverse = pf.inverse_dynamics(coarse.scene, dense)
    assert (inverse.effort_lower <= dense.effort + 1e-9).all()
    assert (inverse.effort_upper >= dense.effort - 1e-9).all()
    part = fine.sample(np.linspace(0.7, 1.1, 5)).energy()
    assert part.work != pytest.approx(fine.energy().work, rel=0.1)
    assert abs(part.residual) < 1e-7
    for bad in ([-0.1], [2.1], [1.0, 1.0]):
        with pytest.raises(StateError):
            coarse.sample(bad)
    with pytest.raises(StateError, match="timestepping"):
        swing("timestepping").sample([1.0])


def test_efforts_between_samples_are_those_of_their_own_piece():
    """A sine with breakpoints that change nothing: sampled anywhere, the sine; and no energy lost.

    At a breakpoint the function is asked beside it, on the side that the samples are on.
    """
    breaks = [0.3, 0.5, 1.0]
    scene = pf.Scene(model=block())
    motion = pf.simulate(
        scene, [0.0], [0.0], lambda t, q, v: [np.sin(10 * t)], 1.0, breakpoints=breaks
    )
    t = np.linspace(0.0, 1.0, 101)
    sampled = motion.sample(t)
    np.testing.assert_allclose(sampled.effort[:, 0], np.sin(10 * t), atol=1e-10)
    mass = scene.model.inertias[1].mass
    velocity = (1 - np.cos(10 * t)) / (10 * mass)
    np.testing.assert_allclose(sampled.v[:, 0], velocity, atol=1e-9)
    energy = motion.energy()
    assert energy.work == pytest.approx(0.5 * mass * velocity[-1] ** 2, rel=1e-8)
    assert abs(energy.residual) < 1e-9 * abs(energy.work)
    step = pf.simulate(
        scene, [0.0], [0.0], lambda t, q, v: [float(t > 0.5)], 1.0, breakpoints=[0.5]
    )
    assert step.sample([0.25, 0.5, 0.75]).effort[:, 0].tolist() == [0.0, 1.0, 1.0]


@pytest.mark.parametrize(("efficiency", "parts", "left"), [(1.0, 1, 1e-9), (0.8, 40, 1e-4)])
def test_energy_halves_steps_where_a_lossy_gears_effort_changes_its_sign(
    efficiency, parts, left, monkeypatch
):
    """An ideal gear loses nothing on either side: there is nothing to look for."""
    drive = {
        "joint": "slide",
        "transmission": {
            "ratio": 10.0,
            "efficiency": efficiency,
            "back_efficiency": 2 - 1 / efficiency,
        },
    }
    scene = pf.Scene(model=block(), actuators=[drive])
    motion = pf.simulate(
        scene, [0.0], [1.0], t_end=1.0, motor_torque={"slide": lambda t: 0.01 * np.sin(10 * t)}
    )
    asked = []
    sample = Dense.sample
    monkeypatch.setattr(Dense, "sample", lambda *of: asked.append(of) or sample(*of))
    energy = motion.energy()
    assert abs(energy.residual) < left * abs(energy.work)
    steps = len(motion.dense.t) - 1
    assert steps <= len(asked) <= parts * steps


def test_energy_ends_where_a_gears_effort_is_rounding(monkeypatch):
    """Noise around zero changes its sign in every part of a step."""
    drive = {
        "joint": "slide",
        "transmission": {"ratio": 10.0, "efficiency": 0.8, "back_efficiency": 0.75},
    }
    scene = pf.Scene(model=block(), actuators=[drive])
    motion = pf.simulate(scene, [0.0], [1.0], t_end=0.1, motor_torque=[0.01])
    sample, rng, asked = Dense.sample, np.random.default_rng(0), []

    def noisy(self, motion, times):
        asked.append(times)
        assert len(asked) < 1000
        part = sample(self, motion, times)
        return replace(part, effort=1e-17 * rng.normal(size=part.effort.shape))

    monkeypatch.setattr(Dense, "sample", noisy)
    motion.energy()


def test_energy_of_every_method():
    exact = swing(rtol=1e-10, atol=1e-12)
    energy = exact.energy()
    assert abs(energy.residual) < 1e-9
    assert energy.work == pytest.approx(energy.change + energy.friction_loss.sum(), abs=1e-9)
    for method in ("timestepping", "regularized"):
        other = swing(method).energy()
        assert abs(other.residual) < 5e-3 * energy.work
        assert other.work == pytest.approx(energy.work, rel=0.3)


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_a_motion_goes_to_a_file_and_back(method, tmp_path):
    motion = swing(method)
    path = motion.save(tmp_path / "swing")
    assert path == tmp_path / "swing.npz"
    back = pf.load_motion(path, slope())
    for name in ("t", "q", "v", "a", "effort", "modes", "friction", "normal_load"):
        np.testing.assert_array_equal(getattr(back, name), getattr(motion, name))
    assert back.events == motion.events
    assert back.stick_intervals() == motion.stick_intervals()
    assert (back.method, back.status, back.evaluations) == (method, "finished", motion.evaluations)
    with pytest.raises(StateError, match="read from a file"):
        back.sample([0.5])
    assert back.energy().work == pytest.approx(motion.energy().work, rel=1e-3)
    frame = back.to_dataframe()
    assert list(frame.columns[:4]) == ["t", "slide.q", "slide.v", "slide.a"]
    assert "slide.friction" in frame


def test_a_file_of_another_scene_is_refused_and_the_difference_named(tmp_path):
    path = swing().save(tmp_path / "swing.npz")
    scene = slope()
    heavier = pf.Scene(model=block(0.0, 3.0), friction=scene.friction)
    with pytest.raises(SimulationError, match=r"differs in inertias$"):
        pf.load_motion(path, heavier)
    slippery = pf.Scene(model=block(), friction={"slide": plane_friction(0.2, 0.1)})
    with pytest.raises(SimulationError, match=r"differs in friction$"):
        pf.load_motion(path, slippery)
    light = block()
    light.gravity.linear = np.array([0, 0, -1.62])
    tilted = block(0.1)
    tilted.gravity = light.gravity
    other = replace(scene, model=tilted, stick_velocity=1e-3)
    with pytest.raises(SimulationError, match=r"differs in joints, gravity, stick velocity$"):
        pf.load_motion(path, other)


def test_a_file_that_is_no_motion_is_refused(tmp_path):
    (tmp_path / "a.npz").write_text("nothing")
    np.savez(tmp_path / "b.npz", t=np.zeros(3))
    for name in ("a.npz", "b.npz", "c.npz"):
        with pytest.raises(SimulationError, match="not a motion"):
            pf.load_motion(tmp_path / name, slope())


# ---------------------------------------------------------------- where a guard falls


@pytest.mark.parametrize(
    ("guard", "expected"),
    [
        (lambda t: 0.7 - t, 0.7),
        (lambda t: (t - 0.41) ** 2 + 1e-6, None),
        (lambda t: (t - 0.41) ** 2 - 1e-6, 0.409),
        (lambda t: t * (0.5 - t), 0.5),  # starts on zero
        (lambda t: t - 0.1, 0.0),  # below from the start
        (lambda t: t**3, None),  # starts on zero and leaves upwards
        (lambda t: -t, 0.0),  # fires where it starts
        (lambda t: -1e-12 * np.ones_like(t), None),  # rounding
        (lambda t: max(0.0, 0.3 - t) if t < 0.6 else 0.55 - t, 0.6),  # a jump
        (lambda t: 0.0 if t < 0.5 else 0.5 - t, 0.5),  # on zero for a while, then below
        (
            lambda t: 1.0 + np.cos(20 * t) - 0.02,
            (np.pi - np.arccos(0.98)) / 20,
        ),  # waves between looks
    ],
)
def test_first_crossing(guard, expected):
    times = np.linspace(0.0, 1.0, 6)
    found = first_crossing(guard, times, np.array([guard(t) for t in times]), 1e-11)
    if expected is None:
        assert found is None
    else:
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("seed", [3, 5])
def test_the_energy_with_a_mimic_joint_is_that_of_the_joints_apart(seed):
    """Their joints are not numbered depth first, as Pinocchio's `crba` takes for granted."""
    model = random_tree(seed, 5, sliding=0.0)
    mimic = pin.transformJointIntoMimic(model, 1, 5, -0.7, 0.1)
    (q,), (v,), _ = random_states(mimic, seed, 1)
    apart = np.append(q, -0.7 * q[0] + 0.1), np.append(v, -0.7 * v[0])
    data = model.createData()
    wanted = pin.computeKineticEnergy(model, data, *apart)
    wanted += pin.computePotentialEnergy(model, data, apart[0])
    assert mechanical_energy(mimic, mimic.createData(), q, v) == pytest.approx(wanted, rel=1e-12)
