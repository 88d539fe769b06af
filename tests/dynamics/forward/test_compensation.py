"""The solver's compensation is that of the C++ header."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump, random_inertia, random_states
from export_cases import (
    BUILDING,
    RICH,
    SETTINGS,
    assert_columns,
    configurations,
    sampled,
    with_ways,
)
from mechanisms import pin_friction
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.forward.compensation import CompensationOptions
from pinfric.errors import StateError


@pytest.mark.parametrize("options", SETTINGS, ids=range(len(SETTINGS)))
@pytest.mark.parametrize("scene", RICH[2:], ids=lambda scene: scene.source)
def test_the_solver_compensates_as_the_header(headers, scene, options):
    q, v, a = sampled(scene, 4, 40)
    rng = np.random.default_rng(4)
    v_ref, v_now = v + rng.normal(scale=0.1, size=v.shape), v + rng.normal(scale=0.1, size=v.shape)
    error = rng.normal(scale=0.01, size=v.shape)
    solver, full = scene.solver(), configurations(scene, q)
    for moving in (True, False):
        state = (v, a) if moving else (None, None)
        found = headers.ask(scene, q, *state, v_ref, error=error, v_now=v_now, options=options)
        expected = [
            solver.compensate(
                full[i],
                *(x[i] if moving else None for x in (v, a)),
                v_ref[i],
                error=error[i],
                v_now=v_now[i],
                options=options,
            )
            for i in range(len(q))
        ]
        assert_columns(found["friction"], np.array(expected), "friction")


def test_joint_effort_is_what_the_header_feeds_forward(headers):
    """Rigid body, rotors and friction at another velocity than that of the load."""
    for scene in (RICH[2], RICH[6]):
        q, v, a = sampled(scene, 5, 30)
        v_ref, solver = v + 0.1, scene.solver()
        found = headers.ask(scene, q, v, a, v_ref)
        rows = zip(configurations(scene, q), v, a, v_ref, strict=True)
        expected = np.array([solver.joint_effort(*row) for row in rows])
        assert_columns(found["joint_effort"], expected, "joint_effort")


def legs(seed=3):
    """A floating base with two legs of two joints with friction by load, and lossy gears."""
    rng, model = np.random.default_rng(seed), pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(base, random_inertia(rng), pin.SE3.Identity())
    for side in ("left", "right"):
        above = base
        for k, kind in enumerate((pin.JointModelRX(), pin.JointModelRY())):
            place = pin.SE3(np.eye(3), rng.normal(scale=0.3, size=3))
            above = model.addJoint(above, kind, place, f"{side}_{k}")
            model.appendBodyToJoint(above, random_inertia(rng), pin.SE3.Identity())
        model.addBodyFrame(f"{side}_foot", above, pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.3])), 0)
    names = list(model.names)[2:]
    gear = {"ratio": 9.0, "efficiency": 0.9, "back_efficiency": 0.85, "rotor_inertia": 1e-4}
    return pf.Scene(
        model,
        friction={n: pin_friction(0.1, 0.03, static=0.2) | {"viscous": 0.2} for n in names},
        actuators=[{"joint": n, "transmission": gear} for n in names],
        source="legs.yaml",
    )


def test_measured_states_of_legs_are_compensated_under_the_feets_forces():
    """The base balances nothing: no motion is asked for that its drives could make.

    Judge: the same robot with six drives more, whose base `inverse` balances.
    """
    scene = legs()
    base = [{"joint": f"base.{c}"} for c in ("vx", "vy", "vz", "wx", "wy", "wz")]
    driven = scene.with_(actuators=[*base, *scene.actuators])
    q, v, a = random_states(scene.model, 4, 20)
    v[:, 6:] += np.sign(v[:, 6:]) * 0.1
    feet = {
        f"{side}_foot": np.array([3.0, -5.0, 40.0, 0.5, 0.2, -0.1]) for side in ("left", "right")
    }
    solver = scene.solver()
    options = CompensationOptions(switch_velocity=1e-3)
    for state in zip(q, v, a, strict=True):
        judged = pf.inverse_dynamics(driven, *state, external=feet)
        expected = judged.joint_effort_lower[0, -4:]
        found = solver.joint_effort(*state, options=options, external=feet)
        assert_allclose(found, expected, rtol=1e-10, atol=1e-10)
        rotors = 81.0 * 1e-4 * state[2][6:]
        losses = expected - rotors - judged.effort_frictionless[0, -4:]
        solver.reset_compensation()
        for k in (-1.0, 0.0):
            measured = solver.compensate_measured(
                pin.integrate(scene.model, state[0], k * 0.1 * state[1]),
                state[1],
                v=state[1],
                a=state[2],
                external=feet,
            )
        assert_allclose(measured, 0.8 * losses, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("ratio", [0.7, -0.7])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_mimic_joint_rubs_in_its_own_direction(ratio, way):
    """A leader and a follower, 2 N forward and 0.5 N backward in each."""
    fingers = ((f"finger_{k}", pin.JointModelPX(), lump(1.0, [0.1, 0.0, 0.0], 0.1)) for k in (1, 2))
    model = pin.transformJointIntoMimic(chain(*fingers, beside=True), 1, 2, ratio, 0.0)
    sizes = {1.0: 2.0, -1.0: 0.5}
    names = {1.0: "positive", -1.0: "negative"}
    both = {names[s]: {"static": size, "kinetic": size} for s, size in sizes.items()}
    friction = {name: {"coulomb": both} for name in ("finger_1", "finger_2")}
    scene = pf.Scene(model=model, friction=friction)
    found = scene.solver().compensate([0.0], [way], [0.0], [way])
    expected = way * (sizes[way] + abs(ratio) * sizes[way * np.sign(ratio)])
    assert_allclose(found, [expected], rtol=1e-12)


def joint_that_yields(way=None):
    """A solver of a joint with 10 N m of friction, which builds up over a way if one is given."""
    body = lump(5.0, [0.0, 0.0, -0.4], 0.001)
    friction = {"coulomb": 10.0, "viscous": 8.0} | ({"presliding": {"way": way}} if way else {})
    return pf.Scene(chain(("j", pin.JointModelRY(), body)), friction={"j": friction}).solver()


def swing_after_a_push(way, gains, bits, **options):
    """Half the way (rad) over which a joint still swings 2.5 s after a push of 10 ms.

    Its friction of 10 N m builds up over `way` before it slips. A controller of 1 kHz with 1 ms of
    delay holds it by encoder counts, their velocity behind 80 Hz.
    """
    gravity, solver = 5.0 * 0.4 * 9.81, joint_that_yields()
    options = CompensationOptions(**options)
    (kp, kd), count, step = gains, 2 * np.pi / 2**bits, 5e-5
    q, v, z, low_passed, keep = 0.3, 0.0, 0.0, 0.0, 1.0 - np.exp(-2 * np.pi * 0.08)
    held = sent = gravity * np.sin(q)
    before, inertia, angles = np.round(q / count) * count, 1.0, []
    for cycle in range(3000):
        seen = np.round(q / count) * count
        low_passed += keep * ((seen - before) / 1e-3 - low_passed)
        before, applied = seen, sent
        sent = held + kp * (0.3 - seen) - kd * low_passed + 30.0 * (500 <= cycle < 510)
        sent += solver.compensate_measured([seen], [low_passed], options=options)[0]
        for _ in range(20):
            v += step * (applied - gravity * np.sin(q) - 8.0 * v - 10.0 * z) / inertia
            q += step * v
            z = min(max(z + step * v / way, -1.0), 1.0)
        angles.append(q)
    return np.ptp(angles[-500:]) / 2


@pytest.mark.parametrize("bits", [17, 19])
@pytest.mark.parametrize("gains", [(3600.0, 120.0), (900.0, 30.0)])
@pytest.mark.parametrize("way", [1e-4, 1e-3, 3e-3])
def test_a_joint_that_yields_rests_after_a_push(way, gains, bits):
    assert swing_after_a_push(way, gains, bits) < 1e-5


def test_a_joint_that_yields_farther_than_the_way_given_swings():
    """Where the proof ends; and a band of velocities, before, swung by 0.2 to 3.9 mrad."""
    assert swing_after_a_push(3e-3, (900.0, 30.0), 19, measured_way=1e-3) > 1e-3


def tracking_error(way, amplitude, frequency, compensation):
    """RMS error (mrad) of a sine, in the loop of `swing_after_a_push` with 3600 and 120 N m.

    Args:
        compensation: (q, v) desired -> N m.
    """
    gravity, count, step, keep = 19.62, 2 * np.pi / 2**19, 5e-5, 1.0 - np.exp(-2 * np.pi * 0.08)
    w, time = 2 * np.pi * frequency, np.arange(8000) * 1e-3
    wanted, rate = amplitude * np.sin(w * time), amplitude * w * np.cos(w * time)
    q, v, z, seen_before, slow, sent, errors = 0.0, rate[0], 0.0, 0.0, rate[0], 0.0, []
    for k in range(8000):
        seen = np.round(q / count) * count
        slow += keep * ((seen - seen_before) / 1e-3 - slow)
        seen_before, applied = seen, sent
        sent = -w * w * wanted[k] + 8.0 * rate[k] + gravity * np.sin(wanted[k])
        sent += 3600.0 * (wanted[k] - seen) + 120.0 * (rate[k] - slow)
        sent += compensation(wanted[k], rate[k])
        errors.append(wanted[k] - q)
        for _ in range(20):
            v += step * (applied - gravity * np.sin(q) - 8.0 * v - 10.0 * z)
            q += step * v
            z = min(max(z + step * v / way, -1.0), 1.0)
    return 1e3 * np.sqrt(np.mean(np.square(errors[2000:])))


@pytest.mark.parametrize(
    ("way", "amplitude", "frequency", "none", "at_once", "building"),
    [
        (1e-4, 0.05, 0.16, 2.69, 0.48, 0.002),
        (1e-3, 0.05, 0.16, 2.67, 0.63, 0.003),
        (3e-3, 0.05, 0.16, 2.62, 0.89, 0.003),
        (3e-3, 0.004, 0.5, 1.36, 1.59, 0.005),
    ],
)
def test_a_slow_sine_is_tracked_to_some_micrometres_of_a_radian(
    way, amplitude, frequency, none, at_once, building
):
    """Against a study of the same loop with another program: within a tenth, or its rounding."""
    found = [tracking_error(way, amplitude, frequency, lambda q, v: 0.0)]
    for solver in (joint_that_yields(), joint_that_yields(way)):

        def friction(q, v, solver=solver):
            return solver.compensate([q], None, None, [v], options=WIDE)[0]

        found.append(tracking_error(way, amplitude, frequency, friction))
    assert found == pytest.approx([none, at_once, building], rel=0.1, abs=6e-4)


def test_a_desired_velocity_needs_no_wide_band():
    """0.01 rad/s, friction that yields over 0.01 mrad: the default band, and 0.02 rad/s."""
    errors = []
    for options in (DRY, WIDE):
        solver = joint_that_yields()

        def friction(q, v, solver=solver, options=options):
            return solver.compensate([q], None, None, [v], options=options)[0]

        errors.append(tracking_error(1e-5, 0.01 / (2 * np.pi * 0.25), 0.25, friction))
    narrow, wide = errors
    assert CompensationOptions().switch_velocity <= 0.002
    assert narrow < 0.25 * wide
    assert wide > 0.8


#: Of the loop above, which has viscous friction on its own.
DRY = CompensationOptions(viscous_scale=0.0)
WIDE = replace(DRY, switch_velocity=0.02)


def test_a_way_that_the_scene_states_bounds_that_of_the_measured_call():
    scene = joint_that_yields(4e-3).scene
    assert CompensationOptions().table(scene)[7].tolist() == [8e-3]
    with pytest.raises(StateError, match=r"measured_way: 0.003 is less than the 0.004 of 'j'"):
        CompensationOptions(measured_way=3e-3).table(scene)
    with pytest.raises(StateError, match=r"measured_way: 0 drives a joint that yields"):
        CompensationOptions(measured_way=0.0).table(scene)
    solver, hold = scene.solver(), CompensationOptions(hold_error=0.01)
    with pytest.raises(StateError, match="hold_error: does nothing where friction builds up"):
        solver.compensate([0.0], None, None, [0.0], error=[0.0], v_now=[0.0], options=hold)
    with pytest.raises(StateError, match="hold_error: needs a desired velocity"):
        solver.compensate_measured([0.0], [0.0], options=hold)
    for wrong in (np.nan, 1e9):
        with pytest.raises(StateError, match="q_ref: 'j'"):
            solver.compensate([0.0], None, None, [0.0], q_ref=[wrong])


@pytest.mark.parametrize("scene", BUILDING, ids=lambda scene: scene.source)
def test_both_languages_let_friction_build_up_by_desired_positions(headers, scene):
    rng, (q, v, a) = np.random.default_rng(3), sampled(scene, 18, 80)
    q_ref = q[0] + np.cumsum(rng.normal(scale=0.004, size=q.shape), axis=0)
    found = headers.ask(scene, q, v, a, v, q_ref=q_ref)
    rows, there, solver = configurations(scene, q), configurations(scene, q_ref), scene.solver()
    for name, call in (("friction", solver.compensate), ("joint_effort", solver.joint_effort)):
        solver.reset_compensation()
        python = [call(rows[i], v[i], a[i], v[i], q_ref=there[i]) for i in range(len(q))]
        assert_columns(found[name], np.array(python), name)


def test_feed_forward_along_a_motion_is_inverse_dynamics_with_its_history():
    """Once each joint has moved by twice its way; both split turning points at samples."""
    scene = with_ways(RICH[1], 2e-3)
    t = np.linspace(0.0, 3.0, 3001)
    w = np.linspace(2.0, 5.0, scene.model.nv)
    q, v, a = 0.1 * np.sin(w * t[:, None]), 0.1 * w * np.cos(w * t[:, None]), 0.0
    a = -(w**2) * q
    full = configurations(scene, q)
    result, solver = pf.inverse_dynamics(scene, full, v, a, t=t), scene.solver()
    found = np.array([solver.joint_effort(full[i], v[i], a[i]) for i in range(len(t))])
    judged = ~result.sticking.any(axis=1) & (t > 0.1)
    # a turning point between samples: within the way that a joint moves there and back
    apart = np.abs(found - result.joint_effort_lower)[judged]
    scale = np.abs(result.joint_effort_lower).max(axis=0)
    assert np.median(apart / scale) < 1e-12
    assert (apart / scale).max() < 2e-3
    assert result.presliding.lower[judged].min() < -0.9 < 0.9 < result.presliding.upper.max()


def test_a_second_at_rest_says_how_wide_the_bands_must_be():
    """With them noise moves the compensation by 5 % of friction, or 20 % in a hold; by the law."""
    solver, rng = joint_that_yields(), np.random.default_rng(3)
    noise = 0.3 + 4e-4 * rng.uniform(-1.0, 1.0, (1000, 1))
    speed = 0.03 * rng.normal(size=(1000, 1))
    hold = CompensationOptions(hold_error=1e-4, viscous_scale=0.0)
    found = solver.options_at_rest(noise, speed, hold)
    assert found.measured_way == pytest.approx(20.0 * np.ptp(noise))
    assert found.hold_velocity == pytest.approx(5.0 * speed.std())
    assert found.scale == 1.0

    def swing(options):
        out = [
            solver.compensate(
                [0.3], None, None, [0.0], error=0.3 - q, v_now=[0.0], options=options
            )[0]
            for q in noise
        ]
        return np.ptp(out) / 10.0

    assert swing(found) < 0.21 < 1.5 < swing(hold)
    still, off = np.zeros((1000, 1)), CompensationOptions()
    solver.reset_compensation()
    measured = solver.options_at_rest(noise, still)
    assert measured.hold_error == 0.0
    for options, least, most in ((measured, 0.03, 0.0501), (off, 0.2, 1.0)):
        solver.reset_compensation()
        out = [solver.compensate_measured(q, [0.0], options=options)[0] for q in noise]
        assert least <= np.ptp(out) / (0.8 * 10.0) <= most
    quiet = solver.options_at_rest(0.3 + still, still)
    assert (quiet.measured_way, quiet.hold_velocity) == (off.table(solver.scene)[7], 0.02)


@pytest.mark.parametrize(
    ("q", "v", "message"),
    [
        (np.zeros((50, 1)), np.zeros((50, 1)), "50 samples; give a second at rest"),
        (np.zeros((200, 2)), np.zeros((200, 1)), r"q: shape \(200, 2\); should be \(T, 1\)"),
        (np.zeros((200, 1)), np.zeros((100, 1)), r"v_now: shape \(100, 1\)"),
        (np.zeros((200, 1)), np.full((200, 1), np.nan), "v_now: .* not finite in sample 0"),
        (np.linspace(0.0, 0.1, 200)[:, None], np.zeros((200, 1)), "moved by 0.0905 rad or m"),
    ],
)
def test_a_record_that_is_not_of_rest_is_refused(q, v, message):
    with pytest.raises(StateError, match=message):
        joint_that_yields().options_at_rest(q, v)


@pytest.mark.parametrize("bad", [[np.nan], [1e9], [0.0, 0.0], ["fast"]])
def test_a_measured_velocity_that_is_none_is_called_by_its_name(bad):
    solver = joint_that_yields()
    before = solver.compensate_measured([0.3], [0.1])
    with pytest.raises(StateError, match=r"^v_now: ") as found:
        solver.compensate_measured([0.3], bad)
    assert "\n" not in str(found.value)
    assert solver.compensate_measured([0.3], [0.1]) == before  # no way counted
