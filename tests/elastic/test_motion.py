"""Elastic gears along motions: closed forms, loops, couples, 200 histories of an elastic arm."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example, gantry, geared_arm, lump
from mechanisms import shifted
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.elastic.motion import (
    elasticity,
    free_frequencies,
    trajectory_frequencies,
    unloaded_frequency,
)
from pinfric.model.transmission import Transmission

G, TAU = 9.81, 2 * np.pi
LINES = {"k1": 3e3, "k2": 5e3, "k3": 6e3, "t1": 5.0, "t2": 20.0}


def gear(stiffness: object, **more: object) -> dict:
    return {"ratio": 100.0, "rotor_inertia": 5e-5, "stiffness": stiffness, **more}


def planar_arm(friction: dict | None = None, **more: object) -> pf.Scene:
    """Two links of 0.5 and 0.4 m that turn about y, point masses at 0.3 and 0.25 m, a tool."""
    links = [
        ("a", pin.JointModelRY(), lump(6.0, [0.3, 0, 0], 0.1)),
        (
            "b",
            pin.JointModelRY(),
            lump(3.0, [0.25, 0, 0], 0.04),
            [0.5, 0.0, 0.0],
        ),
    ]
    model = chain(*links)
    place = shifted(0.4)
    model.addFrame(pin.Frame("tool", 2, 0, place, pin.FrameType.BODY))
    actuators = [
        {"joint": "a", "transmission": gear(LINES)},
        {"joint": "b", "transmission": gear(2e3)},
    ]
    given = {"friction": friction or {}, "actuators": actuators, "tool": "tool"} | more
    return pf.Scene(model=model, **given)


def stand(scene: pf.Scene, q: np.ndarray, way: np.ndarray | None = None) -> pf.InverseResult:
    """A short way that ends at q, and a hold there."""
    way = np.zeros(scene.model.nv) if way is None else way
    t = np.arange(6) * 0.01
    v = np.zeros((6, scene.model.nv))
    v[:3] = way
    q = np.array([pin.integrate(scene.model, q, -way * max(0.03 - s, 0.0)) for s in t])
    return pf.inverse_dynamics(scene, q, v, np.zeros_like(v), t=t)


def gravity_torque(q: np.ndarray) -> np.ndarray:
    """Torques (2,) that hold the arm, about y: a positive angle lowers the links."""
    one, two = np.cos(q[..., 0]), np.cos(q[..., 0] + q[..., 1])
    far = 3.0 * G * 0.25 * two
    return -np.stack([6.0 * G * 0.3 * one + 3.0 * G * 0.5 * one + far, far], axis=-1)


def test_sag_interval_and_reversal_of_one_axis():
    """A horizontal bar with stiction: delta = f(m g l -+ b), at the tool l delta."""
    body = lump(4.0, [0.5, 0, 0], 0.2)
    model = chain(("pin", pin.JointModelRY(), body))
    model.addFrame(pin.Frame("tip", 1, 0, shifted(0.8), pin.FrameType.BODY))
    scene = pf.Scene(
        model,
        friction={"pin": {"coulomb": {"static": 3.0, "kinetic": 2.0}}},
        actuators=[{"joint": "pin", "transmission": gear(1e3)}],
        tool="tip",
    )
    rest = elasticity(stand(scene, np.zeros(1), np.array([0.5]))).rests[0]
    h = -4.0 * G * 0.5
    assert_allclose(rest.wind_up_sag, h / 1e3)
    assert_allclose([rest.wind_up_lower, rest.wind_up_upper], [[(h - 3) / 1e3], [(h + 3) / 1e3]])
    assert_allclose(rest.wind_up_approach, (h + 2) / 1e3)  # came forward
    assert_allclose(rest.wind_up_opposite, (h - 2) / 1e3)
    assert rest.tool is not None
    assert_allclose(rest.tool.sag[:3], [0, 0, 0.8 * h / 1e3], atol=1e-15)
    assert rest.tool.sag[2] < 0  # it hangs
    assert rest.tool.farthest == pytest.approx(0.8 * 3 / 1e3)
    assert rest.tool.farthest_angle == pytest.approx(3 / 1e3)
    assert rest.tool.reversal == pytest.approx(0.8 * 4 / 1e3)
    assert_allclose(rest.tool.extents, [0, 0, 0.0024, 0, 0.003, 0], atol=1e-15)
    J = 0.2 + 4 * 0.25
    assert rest.frequency == pytest.approx((np.sqrt(1e3 / J) / TAU,) * 2)


def test_a_broken_line_softens_where_friction_carries_the_load():
    scene = planar_arm({"a": dry(30.0)})
    found = elasticity(stand(scene, np.array([0.2, 0.4])))
    h = gravity_torque(np.array([0.2, 0.4]))[0]
    assert -20.0 < h + 30.0 < 5.0  # the interval of a reaches its softer lines
    low, high = found.rests[0].frequency
    assert low < high
    assert found.frequency[-1] == pytest.approx(low, rel=1e-8)


def test_places_of_two_axes_by_finite_rotation():
    scene = planar_arm({"a": dry(1.0), "b": dry(0.5)})
    q = np.array([0.3, -0.8])
    rest = elasticity(stand(scene, q)).rests[0]
    model, data = scene.model, scene.model.createData()

    def tip(angles: np.ndarray) -> np.ndarray:
        pin.framesForwardKinematics(model, data, angles)
        return data.oMf[model.getFrameId("tool")].translation.copy()

    exact = tip(q - rest.wind_up_sag) - tip(q)
    assert_allclose(rest.tool.sag[:3], exact, atol=2e-2 * np.abs(exact).max())
    corner = [
        tip(q - np.array([a, b])) - tip(q) - rest.tool.middle[:3]
        for a in (rest.wind_up_lower[0], rest.wind_up_upper[0])
        for b in (rest.wind_up_lower[1], rest.wind_up_upper[1])
    ]
    largest = np.linalg.norm(corner, axis=1).max()
    assert rest.tool.farthest == pytest.approx(largest, rel=2e-2)


def test_an_encoder_at_the_joint_takes_the_figures_of_its_gear_out():
    scene = planar_arm({"a": dry(1.0)})
    given = [a.model_copy(update={"encoder": "joint"}) for a in scene.actuators]
    q = np.array([0.3, -0.8])
    one = elasticity(stand(scene.with_(actuators=[scene.actuators[0], given[1]]), q))
    both = elasticity(stand(scene.with_(actuators=given), q))
    assert both.rests[0].tool.sag_distance == both.rests[0].tool.farthest == 0.0
    assert "encoder at the joint: a, b: the controller corrects the wind-up" in both.notes[0]
    plain = elasticity(stand(scene, q))
    assert one.rests[0].tool.sag_distance != plain.rests[0].tool.sag_distance
    assert one.frequency[-1] == plain.frequency[-1]  # it swings all the same


def test_without_a_tool_or_stiffness_or_times():
    scene = planar_arm(tool=None)
    found = elasticity(stand(scene, np.zeros(2)))
    assert found.rests[0].tool is None
    assert found.worst is None
    assert "no `tool`" in found.notes[0]
    rigid = pf.inverse_dynamics(pf.load_scene("pendulum"), [[0.5]], [[0.0]], [[0.0]])
    with pytest.raises(pf.PinfricError, match="no gear has a stiffness"):
        elasticity(rigid)
    with pytest.raises(pf.PinfricError, match="needs times"):
        elasticity(pf.inverse_dynamics(scene, [[0.5, 0.1]], [[0.0] * 2], [[0.0] * 2]))


def test_a_rigid_drive_beside_an_elastic_one_is_locked():
    scene = planar_arm(
        actuators=[
            {"joint": "a", "transmission": {"ratio": 100.0}},
            {"joint": "b", "transmission": gear(2e3)},
        ]
    )
    result = stand(scene, np.array([0.3, 0.5]))
    far = 0.04 + 3 * 0.25**2
    assert_allclose(trajectory_frequencies(result), np.sqrt(2e3 / far) / TAU)
    free = free_frequencies(result, 5)
    rotor = 100.0**2 * 5e-5
    assert free[0] > np.sqrt(2e3 * (1 / far + 1 / rotor)) / TAU  # link a gives way, too
    bare = {"ratio": 100.0, "stiffness": 1e3}
    rotorless = scene.with_(actuators=[{"joint": j, "transmission": bare} for j in "ab"])
    assert free_frequencies(stand(rotorless, np.zeros(2)), 0) is None


def test_a_rotor_given_as_armature_is_on_the_motors_side():
    scene = planar_arm()
    model = scene.model.copy()
    model.armature = np.array([3.0, 2.0])
    result, heavy = (stand(s, np.array([0.3, 0.5])) for s in (scene, scene.with_(model=model)))
    assert_allclose(trajectory_frequencies(result), trajectory_frequencies(heavy))
    assert (free_frequencies(heavy, 0) < free_frequencies(result, 0)).all()


def test_a_four_bar_with_an_elastic_crank():
    """One spring: f = sqrt(K/(Z^T M Z))/(2 pi), Z by closing the loop at neighbouring angles."""
    scene = pf.load_scene("four_bar")
    drive = {"joint": "crank_pin", "transmission": gear(500.0)}
    scene = scene.with_(actuators=[drive], tool="coupler")
    guess = scene.start_configuration

    def at(angle: float) -> np.ndarray:
        turned = guess.copy()
        turned[:2] = np.cos(angle), np.sin(angle)
        return scene.close(turned, independent=["crank_pin"])

    step = 1e-5
    q = at(0.5)
    Z = pin.difference(scene.model, at(0.5 - step), at(0.5 + step)) / (2 * step)
    data = scene.model.createData()
    inertia = 2 * pin.computeKineticEnergy(scene.model, data, q, Z)
    found = elasticity(stand(scene, q))
    assert found.frequency[-1] == pytest.approx(np.sqrt(500.0 / inertia) / TAU, rel=1e-8)
    assert "a bound" in found.notes[-1]
    rest = found.rests[0]
    id_ = scene.model.getFrameId("coupler")
    places = []
    for angle in (0.5, 0.5 - rest.wind_up_sag[0]):
        pin.framesForwardKinematics(scene.model, data, at(angle))
        places.append(data.oMf[id_].translation.copy())
    moved = places[1] - places[0]
    assert_allclose(rest.tool.sag[:3], moved, atol=0.03 * np.linalg.norm(moved))
    assert rest.tool.farthest > 0


def test_loops_keep_the_place_that_their_approach_left():
    """A four-bar and a delta robot: inside the interval, on its own side of the middle."""
    for name, tool in (("four_bar", "coupler"), ("delta", "platform")):
        scene, motion = example(name)
        drives = [
            a.model_copy(update={"transmission": Transmission(ratio=100.0, stiffness=1e4)})
            for a in scene.actuators
        ]
        elastic = scene.with_(actuators=drives, tool=tool)
        found = elasticity(pf.inverse_dynamics(elastic, motion))
        assert found.free is None  # rotors are not known
        for rest in found.rests[1:]:
            assert rest.tool.reversal > 0
            for way in (rest.wind_up_approach, rest.wind_up_opposite):
                slack = 1e-9 + 1e-3 * (rest.wind_up_upper - rest.wind_up_lower)
                assert (way >= rest.wind_up_lower - slack).all()
                assert (way <= rest.wind_up_upper + slack).all()


def test_what_has_no_inertia_has_no_frequency():
    model = chain(("pin", pin.JointModelRY(), pin.Inertia.Zero()))
    scene = pf.Scene(model, actuators=[{"joint": "pin", "transmission": gear(1e3)}])
    found = elasticity(stand(scene, np.zeros(1)))
    assert np.isnan([*found.frequency, found.mode.frequency, unloaded_frequency(scene)]).all()
    assert found.notes[-1] == "a joint moves no mass (pin): its gear adds no natural frequency"


def test_couples_and_drives_along_the_belts_swing_alike():
    """A carriage on two belts: with couples, or with joints along the belts, it is one machine."""
    found = []
    for turned in (True, False):
        model, actuators = gantry(turned, {"ratio": 50.0, "rotor_inertia": 1e-4})
        for actuator in actuators:  # along turned axes a belt's rate is sqrt(2) times as large
            actuator["transmission"]["stiffness"] = 8e4 * (2.0 if turned else 1.0)
        scene = pf.Scene(model, actuators=actuators)
        result = stand(scene, np.zeros(2))
        found.append((trajectory_frequencies(result)[0], elasticity(result).bracket))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-8)
    assert found[0][0] == pytest.approx(np.sqrt(2 * 8e4 / 4.0) / TAU, rel=1e-8)
    for frequency, (low, high) in found:
        assert low <= frequency * (1 + 1e-8) <= high * (1 + 2e-8)


def test_random_arms_by_pinocchios_own_matrices():
    for seed in range(4):
        scene, rng = geared_arm(seed)
        actuators = [
            a.model_copy(
                update={
                    "transmission": a.transmission.model_copy(
                        update={"stiffness": float(rng.uniform(1e3, 1e5))}
                    )
                }
            )
            for a in scene.actuators
        ]
        scene = scene.with_(actuators=actuators)
        result = stand(scene, pin.neutral(scene.model))
        model, nv = scene.model, scene.model.nv
        data, zero = model.createData(), np.zeros(nv)
        M = np.array([pin.rnea(model, data, result.states.q[0], zero, x) for x in np.eye(nv)])
        M -= np.array([pin.rnea(model, data, result.states.q[0], zero, zero)] * nv)
        K = [
            a.transmission.stiffness
            for a in sorted(actuators, key=lambda a: model.getJointId(a.joint))
        ]
        squares = np.linalg.eigvals(np.linalg.solve(M, np.diag(K))).real
        expected = np.sqrt(squares.min()) / TAU
        assert trajectory_frequencies(result)[0] == pytest.approx(expected, rel=1e-7)


#: Of the integrator below: friction, static over kinetic, damping of the springs (N m s/rad).
LIMIT, RATIO, DAMPING = np.array([4.0, 1.5]), 1.4, np.array([4.0, 1.0])


def twist(delta: np.ndarray) -> np.ndarray:
    """Torques of the two springs, written out: the lines of `LINES`, and 2e3 N m/rad."""
    size = np.abs(delta[:, 0])
    first, second = 5 / 3e3, 5 / 3e3 + 15 / 5e3
    one = np.where(
        size < first,
        3e3 * size,
        np.where(size < second, 5 + 5e3 * (size - first), 20 + 6e3 * (size - second)),
    )
    return np.stack([np.sign(delta[:, 0]) * one, 2e3 * delta[:, 1]], axis=1)


def histories(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motors on n random ways, then at rest: their last angles, and where the links come to rest.

    Semi-implicit steps of q; friction of both joints by Gauss and Seidel, up to its static limit at
    rest.
    """
    rng = np.random.default_rng(seed)
    dt, moving, whole = 4e-4, 1.0, 2.2
    end = np.array([0.3, -0.7])
    knots = end + rng.normal(scale=0.05, size=(8, n, 2)) * rng.uniform(0, 1, (1, n, 1))
    knots[-1] = end
    q = knots[0] - 0.004
    v, rub = np.zeros((n, 2)), np.zeros((n, 2))
    for step in range(round(whole / dt)):
        place = min(step * dt / moving, 1.0) * 7
        k = min(int(place), 6)
        s = min(place - k, 1.0)
        ramp, rate = s * s * (3 - 2 * s), 6 * s * (1 - s) * 7 / moving * (place < 7)
        theta = knots[k] + ramp * (knots[k + 1] - knots[k])
        speed = rate * (knots[k + 1] - knots[k])
        one = 0.1 + 6 * 0.3**2 + 3 * 0.5**2
        c, s2 = np.cos(q[:, 1]), np.sin(q[:, 1])
        far, cross = 0.04 + 3 * 0.25**2, 3 * 0.5 * 0.25
        a, b = one + far + 2 * cross * c, far + cross * c
        bias = (
            cross
            * s2[:, None]
            * np.stack([-v[:, 1] * (2 * v[:, 0] + v[:, 1]), v[:, 0] ** 2], axis=1)
        )
        push = twist(theta - q) + DAMPING * (speed - v) - bias - gravity_torque(q)
        det = a * far - b * b
        W = np.stack([far / det, -b / det, a / det], axis=1)  # M^-1: 11, 12, 22
        bound = LIMIT * np.where(v == 0.0, RATIO, 1.0) * dt
        free = (
            np.stack(
                [
                    W[:, 0] * push[:, 0] + W[:, 1] * push[:, 1],
                    W[:, 1] * push[:, 0] + W[:, 2] * push[:, 1],
                ],
                axis=1,
            )
            * dt
            + v
        )
        for _ in range(6):
            rub[:, 0] = np.clip(
                -(free[:, 0] + W[:, 1] * rub[:, 1]) / W[:, 0], -bound[:, 0], bound[:, 0]
            )
            rub[:, 1] = np.clip(
                -(free[:, 1] + W[:, 1] * rub[:, 0]) / W[:, 2], -bound[:, 1], bound[:, 1]
            )
        v = free + np.stack(
            [W[:, 0] * rub[:, 0] + W[:, 1] * rub[:, 1], W[:, 1] * rub[:, 0] + W[:, 2] * rub[:, 1]],
            axis=1,
        )
        v[np.abs(rub) < bound * (1 - 1e-9)] = 0.0  # it holds: what is left is the iteration's
        q = q + dt * v
    return end, q, v


def test_two_hundred_histories_rest_inside_the_interval():
    static = {
        n: {"coulomb": {"static": RATIO * b, "kinetic": b}}
        for n, b in zip("ab", LIMIT, strict=True)
    }
    scene = planar_arm(static)
    end, q, v = histories(200, 0)
    assert not v.any()  # all have come to rest
    rest = elasticity(stand(scene, end)).rests[0]
    middle = 0.5 * (rest.wind_up_lower + rest.wind_up_upper)
    half = 0.5 * (rest.wind_up_upper - rest.wind_up_lower)
    place = (end - q - middle) / half
    assert (np.abs(place) <= 1.0).all()
    assert (place.min(axis=0) < -0.5).all()  # and they reach far into it
    assert (place.max(axis=0) > 0.5).all()
    tools = -rest.tool.generators[:3] @ place.T
    assert np.linalg.norm(tools, axis=0).max() <= rest.tool.farthest
