"""Efforts, payloads and wrenches of a simulation, in every form."""

import numpy as np
import pinocchio as pin
import pytest
from builders import block, chain, plane_friction, sliding_block
from numpy.testing import assert_allclose, assert_array_equal
from simulation_cases import SHORT, G, slope
from tables import arguments, table

import pinfric as pf
from pinfric.dynamics.forward.efforts import make_effort
from pinfric.dynamics.simulation.system import difference
from pinfric.errors import SimulationError, StateError


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
    assert_allclose(motion.effort[:, 0], 12 * motion.t, atol=1e-9)
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
    with_marks = (tmp_path / "table.csv").read_text().replace(",", ";")
    (tmp_path / "marks.csv").write_text(with_marks)
    for entry in (
        "{table: table.csv}",
        "{table: marks.csv}",
        "{sine: {amplitude: 8.0, angular_frequency: 3.0}}",
    ):
        (tmp_path / "scene.yaml").write_text(text % entry)
        scene = pf.load_scene(tmp_path / "scene.yaml")
        motion = pf.simulate(scene, [0.0], [0.0], None, 1.0)
        expected = 12 * motion.t if "table" in entry else 8 * np.sin(3 * motion.t)
        assert_allclose(motion.effort[:, 0], expected, atol=1e-12)
        assert motion.events[0].kind == "slip"
    for name, message in (("no.csv", "cannot be read"), ("scene.yaml", "no column 't'")):
        (tmp_path / "scene.yaml").write_text(text % f"{{table: {name}}}")
        with pytest.raises(SimulationError, match=message):
            pf.simulate(pf.load_scene(tmp_path / "scene.yaml"), [0.0], [0.0], None, 1.0)


def test_a_table_is_constant_beyond_its_ends_and_bends_where_it_bends():
    table = (np.array([0.2, 0.4]), np.array([[2.0], [10.0]]))
    motion = pf.simulate(slope(), [0.0], [0.0], table, 1.0)
    expected = np.interp(motion.t, *(table[0], table[1][:, 0]))
    assert_allclose(motion.effort[:, 0], expected, atol=1e-9)
    slip = 0.2 + 0.2 * (0.3 * 2 * G - 2) / 8
    (event,) = motion.events
    assert event.time == pytest.approx(slip, rel=1e-12)


def test_steps_end_where_a_table_bends_but_not_at_rows_on_a_line():
    times, values = np.array([0.0, 1.0, 3.0, 4.0]), np.array([[0.0], [1.0], [3.0], [0.0]])
    assert make_effort(slope(), (times, values)).breakpoints.tolist() == [0.0, 3.0, 4.0]


def test_an_effort_function_may_ask_for_forward_dynamics_itself():
    scene = slope(0.5)

    def effort(t, q, v):
        pf.forward_dynamics(scene, [0.3], [-1.0], [4.0])
        return [0.0]

    asked = pf.simulate(scene, [0.0], [1.0], effort, 0.3)
    plain = pf.simulate(scene, [0.0], [1.0], lambda t, q, v: [0.0], 0.3)
    assert_array_equal(asked.q, plain.q)


WRONG = r"""
q0=[np.nan]                  q0: column 0 is nan
q0=[0.0, 1.0]                q0: shape \(2,\); should be \(1,\)
v0=[np.inf]                  v0: column 0 is inf
v0=[]                        v0: shape
effort=[np.nan]              effort: holds NaN
effort=[0.0, 1.0]            effort: shape \(2,\); should be \(1,\), one for each of slide
effort="full"                effort: is not an array
effort=[1j]                  effort: is not an array
effort=lambda t, q, v: [1j]  returned no numbers at t = 0 s: .*complex
q0=[1j]                      q0: .*complex
v0=[True]                    v0: .*true and false
max_events=2.5               max_events = 2.5: should be a whole number
effort={"slid": 1.0}         no drive 'slid'
effort={"slide": [1, 2]}     should be a number
effort=([0.0, 0.0], [[0.0], [1.0]])  times do not increase at row 1
effort=([0.0, 1.0], [0.0, 1.0])      values of shape \(2,\)
effort=None                  has no `simulation` section
effort=lambda t, q, v: [1.0, 2.0]    returned shape \(2,\) at t = 0 s
effort=lambda t, q, v: "x"           returned no numbers at t = 0 s
effort=lambda t, q, v: [np.nan]      t = 0 s: effort: column 0 is nan
t_end=0.0                    t_end = 0.0: should be a positive number
t_end=-1.0                   t_end
t_end=np.nan                 t_end
t_end=1e-300                 t_end = 1e-300 s: should be at least 1e-12 s
t_end=1e155                  t_end = 1e.155 s: should be at most 1e.10 s
method="timestepping", dt=1e-11      steps; at most 1e.09 are possible
rtol=1e-300                  rtol = 1e-300
rtol=1.1                     rtol = 1\.1.*at most 1
atol=1.1                     atol = 1\.1.*at most 1
t_end="1"                    t_end = '1'
t_end=0                      t_end = 0: should be a positive number
dt=0.0                       dt = 0.0: should be a positive number
dt=-1e-3                     dt
rtol=0.0                     rtol
sample_step=0.0              sample_step
method="euler"               method 'euler': there are: event, timestepping, regularized
breakpoints=[np.nan]         breakpoints
"""


@pytest.mark.parametrize(("change", "message"), table(WRONG, arguments, str))
def test_bad_input(change, message):
    good = {"q0": [0.0], "v0": [0.0], "effort": [0.0], "t_end": 1.0}
    with pytest.raises((SimulationError, StateError), match=message):
        pf.simulate(slope(), **{**good, **change})


def test_tolerances_of_1_are_allowed():
    assert pf.simulate(slope(), [0.0], [0.0], [0.0], 0.1, rtol=1, atol=1).q[-1, 0] == 0.0


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


class Controller:
    """A PID of one joint that keeps its integral; it records its calls and results."""

    def __init__(self, period):
        self.period, self.integral, self.times, self.efforts = period, 0.0, [], []

    def __call__(self, t, q, v):
        error = 1.0 - q[0]
        self.integral += error * self.period
        self.times.append(t)
        self.efforts.append(40.0 * error + 25.0 * self.integral - 12.0 * v[0])
        return [self.efforts[-1]]


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
@pytest.mark.parametrize("period", [1e-3, 0.013])
def test_a_controller_is_asked_once_a_period_as_in_the_exact_recursion(method, period):
    """m x'' = u - b x' between the instants: x' tends to u/b by exp(-b T/m), in closed form."""
    m, end, controller = 2.0, 0.4, Controller(period)
    b = 0.0 if method == "timestepping" else 5.0  # whose midpoint is exact without drag
    scene = pf.Scene(model=block(0.0, m), friction={"slide": {"viscous": b}} if b else {})
    motion = pf.simulate(scene, [0.0], [0.3], controller, end, method, control_period=period)
    count = int(np.ceil(end / period))
    assert_array_equal(controller.times, np.arange(count) * period)
    exact, x, v = Controller(period), 0.0, 0.3
    for k in range(count):
        u, T = exact(k * period, [x], [v])[0], min(period, end - k * period)
        if b:
            slows, left = -np.expm1(-b * T / m) * m / b, np.exp(-b * T / m)
            x, v = x + u / b * (T - slows) + v * slows, v * left + u / m * slows
        else:
            x, v = x + v * T + u / m * T**2 / 2, v + u / m * T
    tolerance = {"event": 1e-12, "timestepping": 1e-12, "regularized": 1e-6}[method]
    assert_allclose(controller.efforts, exact.efforts, atol=100 * tolerance)
    assert motion.q[-1, 0] == pytest.approx(x, abs=tolerance)
    assert motion.v[-1, 0] == pytest.approx(v, abs=10 * tolerance)
    if method == "event":  # what was held is known afterwards, too
        assert abs(motion.energy().residual) < 1e-9
        again = motion.sample([0.5 * period, 1.5 * period])
        assert_array_equal(again.effort[:, 0], controller.efforts[:2])
    assert len(controller.times) == count


def test_what_a_controller_breaks_away_slips_from_the_instant_of_its_period():
    """An integral grows until the friction of a joint at rest no longer holds."""
    scene = sliding_block(plane_friction(0.35, 0.3))
    limit, period = 0.35 * 2.0 * 9.81, 0.01
    for method in ("event", "timestepping"):
        calls = []

        def integral(t, q, v, calls=calls):
            calls.append(t)
            return [3.0 * len(calls) * period * 10.0]

        motion = pf.simulate(scene, [0.0], [0.0], integral, 0.5, method, control_period=period)
        first = int(np.floor(limit / (30.0 * period)))  # the call whose effort is beyond it
        assert motion.events[0].time == pytest.approx(first * period, abs=1e-12)
        assert (motion.q[motion.t <= first * period] == 0.0).all()
        assert len(calls) == 50
    with pytest.raises(SimulationError, match=r"breakpoints: with control_period = 0\.01 s"):
        pf.simulate(scene, [0.0], [0.0], integral, 0.5, control_period=period, breakpoints=[0.1])
    with pytest.raises(SimulationError, match="control_period = -1: should be a positive"):
        pf.simulate(scene, [0.0], [0.0], integral, 0.5, control_period=-1)


@pytest.mark.parametrize("angle", [1e-12, 1e-9, -7e-9, 2.0])
def test_the_difference_of_angles_keeps_small_ones(angle):
    """Pinocchio's does not for 1 % of start angles."""
    model = chain(("turn", pin.JointModelRUBZ()), ("lift", pin.JointModelRZ()))
    for first in np.random.default_rng(0).uniform(-np.pi, np.pi, 1000):
        start = np.array([np.cos(first), np.sin(first), 0.0])
        end = np.array([np.cos(first + angle), np.sin(first + angle), angle])
        assert_allclose(difference(model, start, end), angle, atol=1e-15)


def test_a_configuration_off_its_manifold_is_normalized_with_a_warning():
    model = chain(("wheel", pin.JointModelRUBX(), pin.Inertia.Random()))
    with pytest.warns(pf.PinfricWarning, match="manifold"):
        motion = pf.simulate(pf.Scene(model=model), [2.0, 0.0], [1.0], [0.0], 0.1)
    assert_allclose(np.linalg.norm(motion.q, axis=1), 1.0)


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
        assert_allclose(inverse.effort_lower, 1.0, atol=1e-9)
