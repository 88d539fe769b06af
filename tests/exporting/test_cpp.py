"""The C++ compensator, compiled: it is inverse dynamics, passive, and refuses by name."""

import subprocess

import compensator_time
import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import chain, dry, lump, random_tree
from cases import drawer_scene
from export_cases import (
    BUNDLED,
    COMPILER,
    RICH,
    STRICT,
    WHOLE,
    Headers,
    assert_columns,
    configurations,
    header,
    loadable,
    needs_compiler,
    planar,
    rich,
    sampled,
    worm,
)
from mechanisms import four_bar
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.forward.compensation import CompensationOptions
from pinfric.errors import PinfricError
from pinfric.exporting.cpp import Bounds, cpp_files, default_frames, header_name
from pinfric.model.couples import rate_rows

COMPARED = [
    "effort_frictionless",
    "effort_lower",
    "effort_upper",
    "joint_effort_lower",
    "joint_effort_upper",
    "motor_torque_lower",
    "motor_torque_upper",
    "normal_load",
    "friction_lower",
    "friction_upper",
]


def assert_is_inverse(found, result):
    assert (found["good"] == 1.0).all()
    for name in COMPARED:
        assert_columns(found[name], getattr(result, name), name)
    assert_array_equal(found["sticking"] == 1.0, result.sticking)
    if result.wrench is not None:
        assert_columns(found["wrench"], result.wrench.reshape(len(found["wrench"]), -1), "wrench")


@pytest.mark.parametrize("scene", RICH, ids=lambda scene: scene.source)
def test_it_is_inverse_dynamics(headers, scene):
    q, v, a = sampled(scene, 1)
    result = pf.inverse_dynamics(scene, configurations(scene, q), v, a)
    assert_is_inverse(headers.ask(scene, q, v, a), result)


@pytest.mark.parametrize("name", BUNDLED)
def test_it_is_inverse_dynamics_along_trajectories(headers, name):
    scene = pf.load_scene(name)
    motion = pf.load_trajectory(f"{name}.csv" if "pick" in name else name, scene)
    q = motion.joint_positions()
    result = pf.inverse_dynamics(scene, motion.q, motion.v, motion.a)
    found = headers.ask(scene, q, motion.v, motion.a)
    assert_is_inverse(found, result)
    lower, upper = result.motor_torque_lower, result.motor_torque_upper
    still, scale = lower < upper, 1e-12 * np.abs(upper).max()
    assert still.any()
    assert (found["feed_forward"] >= lower - scale)[still].all()  # at rest inside the interval
    assert (found["feed_forward"] <= upper + scale)[still].all()


@pytest.mark.parametrize(
    "scene", [*RICH, pf.load_scene(BUNDLED[0])], ids=lambda scene: scene.source
)
def test_feed_forward_outside_the_band_is_the_torque_that_the_motion_takes(headers, scene):
    q, _, a = sampled(scene, 3)
    rng = np.random.default_rng(3)
    v = rng.choice([-1.0, 1.0], a.shape) * rng.uniform(0.3, 2.0, a.shape)
    options = CompensationOptions(switch_velocity=1e-3)
    found = headers.ask(scene, q, v, a, options=options)
    result = pf.inverse_dynamics(scene, configurations(scene, q), v, a)
    assert_columns(found["feed_forward"], result.motor_torque_lower, "feed-forward")


def test_payload_and_wrench_at_run_time(headers):
    scene, frames = loadable(), default_frames(loadable())
    tool, (q, v, a) = scene.payloads["tool"], sampled(loadable(), 5, 100)
    place, full = frames.index("link_5"), configurations(loadable(), q)
    wrench = np.array([3.0, -20.0, 8.0, 1.0, 0.3, -2.0])
    carried = headers.ask(
        scene,
        q,
        v,
        a,
        payloads=[(place, tool.mass, tool.com, tool.inertia)],
        wrenches=[(place, wrench)],
    )
    attached = np.ones((len(q), 1), dtype=bool)
    result = pf.inverse_dynamics(scene, full, v, a, attached=attached, external={"link_5": wrench})
    assert_is_inverse(carried, result)
    free = pf.inverse_dynamics(scene, full, v, a)
    assert np.abs(result.normal_load - free.normal_load).max() > 1.0
    solver = scene.solver(["tool"])
    for i in range(20):
        found = solver.compensate(
            full[i], v[i], a[i], v[i], options=WHOLE, external={"link_5": wrench}
        )
        assert_allclose(found, carried["friction"][i], rtol=1e-10, atol=1e-10)


def test_a_wrench_is_replaced_and_a_payload_added(headers):
    scene = loadable()
    tool, (q, v, a) = scene.payloads["tool"], sampled(scene, 6, 10)
    push = np.array([3.0, -20.0, 8.0, 1.0, 0.3, -2.0])
    place = default_frames(scene).index("link_5")
    plain = headers.ask(scene, q, v, a)
    again = headers.ask(scene, q, v, a, wrenches=[(place, push), (place, 0.0 * push)])
    assert_array_equal(plain["effort_lower"], again["effort_lower"])
    half = place, 0.5 * tool.mass, tool.com, 0.5 * np.array(tool.inertia)
    whole = place, tool.mass, tool.com, tool.inertia
    twice, once = (headers.ask(scene, q, v, a, payloads=p) for p in ([half, half], [whole]))
    assert_columns(twice["effort_lower"], once["effort_lower"], "payload")


#: Frame, mass, centre, moments.
PAYLOADS = """
[-1, 1, [0, 0, 0], [0, 0, 0, 0, 0, 0]]
[99, 1, [0, 0, 0], [0, 0, 0, 0, 0, 0]]
[0, -1, [0, 0, 0], [0, 0, 0, 0, 0, 0]]
[0, .nan, [0, 0, 0], [0, 0, 0, 0, 0, 0]]
[0, 1, [0, .inf, 0], [0, 0, 0, 0, 0, 0]]
[0, 1, [0, 0, 0], [-1, 0, 0, 1, 0, 1]]
[0, 1, [0, 0, 0], [1, 0, 0, 1, 0, 2.1]] # more than a plate
[0, 1, [0, 0, 0], [1, 1.5, 0, 1, 0, 1]] # one moment negative
[0, 1, [0, 0, 0], [1, 0.3, 0.3, 1, 0.3, 0.2]]
[0, 0, [0, 0, 0], [1, 0, 0, 1, 0, 1]] # no mass
[0, 1.0e+13, [0, 0, 0], [0, 0, 0, 0, 0, 0]]
"""


@pytest.mark.parametrize("payload", [*map(yaml.safe_load, PAYLOADS.strip().splitlines())])
def test_payloads_that_cannot_be_are_refused_and_change_nothing(headers, payload):
    scene = loadable()
    q, v, a = sampled(scene, 6, 5)
    found, plain = headers.ask(scene, q, v, a, payloads=[payload]), headers.ask(scene, q, v, a)
    assert (found["good"][:, 0] == 0.0).all()
    assert_array_equal(found["effort_lower"], plain["effort_lower"])


def judge_passive(headers, scene, options, states=40):
    """The most power (W) beyond what friction takes at each velocity; and the largest compensation.

    Friction's share is the model's own, from inverse dynamics at the same velocity: the motor's
    torque in motion less that without friction, at any speed.
    """
    rng, nv = np.random.default_rng(9), scene.model.nv
    q, v, a = sampled(scene, 8, states)
    speeds = np.concatenate([np.geomspace(1e-5, 3.0, 31), -np.geomspace(1e-5, 3.0, 31)])
    rows = [np.repeat(x, len(speeds), axis=0) for x in (q, v, a)]
    v_ref = np.tile(speeds, states)[:, None] * rng.uniform(0.5, 1.0, (states * len(speeds), nv))
    found = headers.ask(scene, *rows, v_ref, options=options)
    sharp = CompensationOptions(switch_velocity=0.0)
    lost = headers.ask(scene, *rows, v_ref, options=sharp)
    rate = v_ref  # drive d moves freedom d
    excess = found["friction"] * rate - options.scale * lost["friction"] * rate
    return excess.max(), np.abs(found["friction"]).max(), (lost["friction"] * rate).min()


PASSIVE = [
    worm(),
    *RICH[:6],
    pf.load_scene("ur10_machine_tending"),
    pf.load_scene("panda_pick_and_place"),
]


@pytest.mark.parametrize("scene", [*RICH, worm()], ids=lambda scene: scene.source)
def test_a_measured_velocity_has_a_call_and_a_scale_of_its_own(headers, scene):
    """By default 0.8 of the value at the same desired velocity, whatever `scale` is.

    The joints move on by more than twice the way in the direction of the measured velocity.
    """
    q, v, a = sampled(scene, 16, 20)
    v += 0.1 * np.where(v < 0.0, -1.0, 1.0)
    q = q[0] - np.cumsum(0.1 * np.sign(v), axis=0)
    sharp = CompensationOptions(switch_velocity=0.0)
    found = headers.ask(scene, q, v, a, v_now=-v, options=CompensationOptions(scale=0.3))
    desired = headers.ask(scene, q, v, a, -v, options=sharp)
    ahead = 0.8 * desired["friction"]
    drives = rate_rows(scene.drives, scene.model.nv)
    same = (np.sign(-v @ drives.T) == np.sign(np.diff(q, axis=0, prepend=q[:1]) @ drives.T)).all(1)
    assert same[1:].sum() > 5
    assert_columns(found["friction_measured"][same], ahead[same], "measured")
    rows, solver = configurations(scene, q), scene.solver()
    python = [solver.compensate_measured(rows[i], -v[i], v=v[i], a=a[i]) for i in range(len(v))]
    assert_columns(np.array(python), found["friction_measured"], "python")


@pytest.mark.parametrize("scene", [*RICH, worm()], ids=lambda scene: scene.source)
def test_a_measured_direction_builds_up_over_the_way(headers, scene):
    """Small steps to and fro, in both languages; at a reversal it is 0 after one way."""
    rng, (q, v, a) = np.random.default_rng(2), sampled(scene, 17, 60)
    q = q[0] + np.cumsum(rng.normal(scale=0.004, size=q.shape), axis=0)
    options = CompensationOptions(measured_way=0.005, measured_scale=1.0)
    found = headers.ask(scene, q, v, a, v_now=v, options=options)["friction_measured"]
    rows, solver = configurations(scene, q), scene.solver()
    for _ in range(2):
        python = [
            solver.compensate_measured(rows[i], v[i], v=v[i], a=a[i], options=options)
            for i in range(len(v))
        ]
        assert_columns(np.array(python), found, "python")
        solver.reset_compensation()


@pytest.mark.parametrize("scene", PASSIVE, ids=lambda scene: scene.source)
@pytest.mark.parametrize("scale", [0.8, 1.0])
def test_it_gives_no_more_power_than_friction_takes(headers, scene, scale):
    options = CompensationOptions(scale=scale, viscous_scale=scale, switch_velocity=0.05)
    excess, size, least = judge_passive(headers, scene, options)
    assert least >= 0.0
    assert excess <= 1e-13 * size


ENDS = """dry[d] = sum - detail::delivered(d, rest);"""


BLENDED_LOAD = (
    """double blend[Robot::freedoms];
      for (int i = 0; i < Robot::freedoms; ++i)
        blend[i] = rest[i] + 0.5 * (1.0 + s) * ahead[i] - 0.5 * (1.0 - s) * back[i];
      const double t = detail::delivered(d, blend);
      sum = 0.5 * (1.0 + s) * detail::gear_value(d, 1.0, speed, leaving, t) +
            0.5 * (1.0 - s) * detail::gear_value(d, -1.0, speed, leaving, t);
      """
    + ENDS
)


@needs_compiler
def test_blending_the_load_in_place_of_the_ends_would_not_be_passive(tmp_path):
    """The mutant that the test above is for: F(t(s)) gives more than friction takes."""
    mutant = Headers(tmp_path, [worm()], edit=lambda text: text.replace(ENDS, BLENDED_LOAD))
    options = CompensationOptions(switch_velocity=0.05)
    excess, size, _ = judge_passive(mutant, worm(), options)
    assert excess > 1e-4 * size


@pytest.mark.parametrize("scene", RICH, ids=lambda scene: scene.source)
def test_it_is_continuous_in_the_velocity(headers, scene):
    """Ten times finer steps of velocity give about ten times smaller steps."""
    options = CompensationOptions(hold_velocity=0.05, hold_error=0.01)
    (q, _, a), nv, steps = sampled(scene, 11, 1), scene.model.nv, []
    for count in (2001, 20001):
        v = np.linspace(-0.1, 0.1, count)[:, None] * np.ones(nv)
        rows = np.repeat(q, count, axis=0), np.zeros((count, nv)), np.repeat(a, count, axis=0)
        found = headers.ask(scene, *rows, v, error=np.full_like(v, 0.004), v_now=v, options=options)
        steps.append(np.abs(np.diff(found["friction"], axis=0)).max())
    assert steps[1] < 0.2 * steps[0]


def test_power_is_watched(headers):
    """A push against the desired direction: no more power than friction takes, and P0."""
    for scene in (RICH[0], RICH[1], RICH[6]):
        q, v, a = sampled(scene, 12, 200)
        v_ref, v_now = np.sign(v + 1e-9), np.random.default_rng(1).normal(size=v.shape)
        free = CompensationOptions(scale=1.5, viscous_scale=1.0)
        watched = CompensationOptions(scale=1.5, viscous_scale=1.0, power=0.5)
        sharp = CompensationOptions(switch_velocity=0.0)
        loose, found, lost = (
            headers.ask(scene, q, v, a, vr, v_now=v_now, options=options)["friction"]
            for vr, options in ((v_ref, free), (v_ref, watched), (v_now, sharp))
        )
        rate = v_now @ rate_rows(scene.drives, scene.model.nv).T
        assert ((found - lost) * rate).max() <= 0.5 + 1e-9
        assert ((loose - lost) * rate).max() > 1.0
        within = (loose - lost) * rate <= 0.5
        assert_array_equal(found[within], loose[within])


def test_hold_asks_for_break_away_and_fades_as_the_joint_slips(headers):
    gear = {"ratio": 50.0, "no_load_torque": {"static": 0.04, "kinetic": 0.02}}
    model = chain(("hinge", pin.JointModelRZ(), lump(1.0, moment=1.0)))
    friction = {"hinge": dry(5.0, 3.0)}
    scene = pf.Scene(
        model,
        friction=friction,
        source="hinge.yaml",
        actuators=[{"joint": "hinge", "transmission": gear}],
    )
    solver, at = scene.solver(), [np.zeros(1)]
    options = CompensationOptions(scale=1.0, hold_error=0.01)

    def found(v_ref, error, v_now):
        motion = {"error": [error], "v_now": [v_now], "options": options}
        return solver.compensate(*at, None, None, [v_ref], **motion)[0]

    assert found(0.0, 0.01, 0.0) == pytest.approx(5.0 + 50.0 * 0.04)
    assert found(0.0, -0.02, 0.0) == pytest.approx(-(5.0 + 50.0 * 0.04))
    assert found(0.0, 0.01, 0.02) == pytest.approx(3.0 + 50.0 * 0.02)  # it slips
    assert found(0.0, 0.0, 0.0) == 0.0
    assert found(0.02, -0.05, 0.02) == pytest.approx(3.0 + 50.0 * 0.02)  # as desired


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["q", "v", "a", "v_ref", "error", "v_now"])
def test_what_is_not_finite_gives_false_and_zeros(headers, place, wrong):
    scene = RICH[6]
    q, v, a = sampled(scene, 14, 3)
    given = {"q": q, "v": v, "a": a, "v_ref": v.copy(), "error": 0.0 * v, "v_now": 0.0 * v}
    given[place][1, 2] = wrong
    state = [given.pop(name) for name in ("q", "v", "a", "v_ref")]
    found = headers.ask(scene, *state, **given)
    assert (found["good"][[0, 2]] == 1.0).all()
    whole = place in ("q", "v", "a")
    assert found["good"][1].tolist() == [
        1.0,
        not whole,
        not whole,
        0.0,
        not (whole or place in ("error", "v_now")),
        0.0,
        not (whole or place in ("error", "v_now")),
    ]
    names = ["rigid_body", "feed_forward", "sticking", "wrench", *COMPARED]
    for name in ("friction", "joint_effort", *(names if whole else ())):
        assert_array_equal(found[name][1], 0.0)
    arguments = [configurations(scene, q)[1], *(x[1] for x in state[1:])]
    if place in ("q", "v", "a", "v_ref"):
        with pytest.raises(PinfricError):
            scene.solver().compensate(*arguments)


@pytest.mark.parametrize("watched", [False, True])
@pytest.mark.parametrize("wrong", [np.nan, -1.0])
def test_an_option_that_is_none_gives_false_and_zeros(headers, monkeypatch, wrong, watched):
    scene = RICH[0]
    q, v, a = sampled(scene, 14, 3)
    more = {"error": v, "v_now": v} if watched else {}
    for entry in range(6):
        rows = WHOLE.table(scene)
        rows[entry, 0] = wrong
        monkeypatch.setattr(CompensationOptions, "table", lambda *_, rows=rows: rows)
        found = headers.ask(scene, q, v, a, **more)
        assert (found["good"][:, 3] == 0.0).all()
        assert (found["friction"] == 0.0).all()
        monkeypatch.undo()


@needs_compiler
def test_it_calls_nothing_but_mathematics(tmp_path):
    """No allocation, exception or virtual functions: undefined symbols are libm's."""
    scene = RICH[1]
    name = header_name(scene.source)
    (tmp_path / f"{name}.hpp").write_text(header(scene))
    (tmp_path / "use.cpp").write_text(
        f'#include "{name}.hpp"\n'
        f"using namespace {name};\n"
        "bool use(const double* q, Options& o, double* out, InverseInstant& i) {\n"
        "  Compensator c;\n  o = Options();\n  double x[3] = {*q, *q, *q}, w[6] = {*q};\n"
        "  State s;\n  s.q = s.v = s.a = s.v_ref = s.error = s.v_now = Freedoms::at(q);\n"
        "  c.clear_payloads();\n  const Drives to = Drives::at(out);\n"
        "  return c.set_gravity(x) && c.set_wrench(0, w) && c.add_payload(0, *q, x, w) &&\n"
        "         c.set_payload(0, *q, x, w) && c.rigid_body(s, to) && c.friction(s, o, to) &&\n"
        "         c.joint_effort(s, o, to) && c.motor_torque(s, o, to, i) && c.inverse(s, i) &&\n"
        "         c.friction_measured(s, o, to);\n}\n"
    )
    for flags in (["-O2"], ["-O0"]):
        command = [COMPILER, *STRICT, *flags, "-c", tmp_path / "use.cpp", "-o", tmp_path / "use.o"]
        subprocess.run(command, check=True, capture_output=True, timeout=120)
        listed = subprocess.run(
            ["nm", "-u", tmp_path / "use.o"], check=True, capture_output=True, text=True
        ).stdout.split()
        undefined = {symbol for symbol in listed if symbol != "U"}
        allowed = (
            "sin cos sincos sqrt pow exp fmin fmax fabs memset memcpy _GLOBAL_OFFSET_TABLE_ "
            "__stack_chk_fail"
        )
        assert undefined <= {*allowed.split()}


@needs_compiler
@pytest.mark.parametrize("flag", ["-ffast-math", "-ffinite-math-only", "-D_M_FP_FAST"])
def test_fast_math_is_an_error(tmp_path, flag):
    (tmp_path / "use.cpp").write_text(header(RICH[0]))
    made = subprocess.run(
        [COMPILER, "-std=c++17", flag, "-fsyntax-only", tmp_path / "use.cpp"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert made.returncode != 0
    fast = "/fp:fast" if "FP_FAST" in flag else "-ffast-math"
    assert f"{fast} takes away the checks for NaN" in made.stderr


@needs_compiler
def test_a_robot_without_friction_and_one_without_frames_compile(tmp_path):
    """C++ has no empty arrays."""
    plain = pf.Scene(random_tree(3, 2), source="plain.yaml")
    made = Headers(tmp_path, [plain], flags=("-O1",))  # where g++ looks hardest for empty arrays
    q, v, a = sampled(plain, 1, 5)
    found = made.ask(plain, q, v, a)
    assert (found["friction"] == 0.0).all()
    assert (found["good"] == 1.0).all()


def test_the_text_is_the_same_each_time():
    assert header(rich(2)) == header(rich(2))


def two_joints(**more):
    model = random_tree(1, 2, sliding=0.0)
    return pf.Scene(model, **more)


def narrow():
    guide = {"kind": "guide", "length": 0.2}
    friction = {"slide": {"bearing": guide, "mu": {"static": 0.2, "kinetic": 0.1}}}
    return pf.Scene(chain(("slide", pin.JointModelPX(), pin.Inertia.Random())), friction=friction)


REFUSED = [
    (lambda: four_bar()[0], "the loop '", ()),
    (lambda: pf.load_scene("excavator"), "the drive off the joints 'boom_cylinder'", ()),
    (lambda: drawer_scene(0.3), "the drive off the joints", ()),
    (planar, "'skates' has several degrees of freedom", ()),
    (lambda: two_joints(actuators=[{"joint": "joint_1"}]), "'joint_2' has no drive", ()),
    (
        lambda: two_joints(
            actuators=[
                {"joint": "joint_1"},
                {"joint": "joint_1", "name": "b"},
                {"joint": "joint_2"},
            ]
        ),
        "'joint_1' has several drives",
        (),
    ),
    (narrow, r"friction.slide.bearing.width: missing", ()),
    (lambda: pf.load_scene("ur10_machine_tending"), "no link 'tol0'.*tool0", ("tol0",)),
    (
        lambda: pf.load_scene("ur10_machine_tending"),
        "'base_link' is fixed to the ground",
        ("base_link",),
    ),
    (lambda: pf.Scene(pin.Model()), "has no joint", ()),
]


@pytest.mark.parametrize(("scene", "message", "frames"), REFUSED)
def test_what_cannot_be_compensated_is_named(scene, message, frames):
    made = scene()
    with pytest.raises(PinfricError, match=message) as found:
        cpp_files(made, frames, Bounds.none(len(made.drives)), [], [""])
    assert "\n" not in str(found.value)
    if not frames and "degrees" not in message and "no drive" not in message:  # as floating bases
        with pytest.raises(PinfricError, match=message):
            made.solver().compensate(*np.zeros((4, made.model.nv)))


@pytest.mark.slow
@needs_compiler
@pytest.mark.skipif(not compensator_time.EIGEN.is_dir(), reason="no Eigen (extra bench)")
def test_the_program_that_times_it_compiles(tmp_path):
    scene = pf.load_scene("ur10_machine_tending")
    compensator_time.compiled(scene, tmp_path, ["-fsyntax-only"], compensator_time.EIGEN)
