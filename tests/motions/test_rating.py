"""A rating's postures against a search that shares no code, and its moves by hand."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import chain, lump, row
from rating_cases import ROBOTS, rated_robot, write_arm
from scipy.optimize import minimize
from tables import table

import pinfric as pf
from pinfric.errors import PinfricError, TrajectoryError
from pinfric.model.robot import read_robot
from pinfric.model.schema import Payload
from pinfric.motions.rating import Arm, Rated, holding_efforts, rate

QUICK = [n if n in ("ur10", "arm") else pytest.param(n, marks=pytest.mark.slow) for n in ROBOTS]


def rated_of(name, folder, **more) -> tuple[pf.Scene, Rated]:
    scene, keys = rated_robot(name, folder)
    return scene, rate(scene, keys | more)


def judge(scene, keys, com=(0.0, 0.0, 0.1)):
    """The largest |gravity| of each joint: 2,000 random postures, and an optimizer from the best.

    Plain Pinocchio with the payload as a body; its derivatives know no mimic joints (Panda's hand).
    """
    model = scene.model.copy()
    frame = model.frames[model.getFrameId(keys["link"])]
    load = pin.Inertia(keys["payload"], np.array(com), np.zeros((3, 3)))
    model.appendBodyToJoint(frame.parentJoint, load, frame.placement)
    data, found = model.createData(), []
    turns = [joint.nq == 2 for joint in list(model.joints)[1:]]
    low, high = [], []
    for joint, endless in zip(list(model.joints)[1:], turns, strict=True):
        if joint.nv:
            low.append(-np.pi if endless else model.lowerPositionLimit[joint.idx_q])
            high.append(np.pi if endless else model.upperPositionLimit[joint.idx_q])
    own = [joint for joint in list(model.joints)[1:] if joint.nv]

    def placed(x):
        q = np.empty(model.nq)
        for value, joint in zip(x, own, strict=True):
            q[joint.idx_q] = value if joint.nq == 1 else np.cos(value)
            if joint.nq == 2:
                q[joint.idx_q + 1] = np.sin(value)
        return q

    rng = np.random.default_rng(7)
    tried = rng.uniform(low, high, (2_000, len(low)))
    efforts = np.abs([pin.computeGeneralizedGravity(model, data, placed(x)) for x in tried])
    ends = list(zip(low, high, strict=True))
    for k in range(len(low)):

        def least(x, k=k):
            q = placed(x)
            g = pin.computeGeneralizedGravity(model, data, q)[k]
            slope = pin.computeGeneralizedGravityDerivatives(model, data, q)[k]
            return -abs(g), -np.sign(g) * slope

        starts = tried[np.argsort(-efforts[:, k])[:5]]
        found.append(max(-minimize(least, x, jac=True, bounds=ends, tol=1e-9).fun for x in starts))
    return dict(zip([model.names[j.id] for j in own], found, strict=True))


def energy(model, q):
    """The bodies' potential energy, J."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    bodies = zip(list(model.inertias), data.oMi, strict=True)
    return 9.81 * sum(body.mass * at.act(body.lever)[2] for body, at in bodies)


@pytest.mark.parametrize("name", [name for name in QUICK if "panda" not in str(name)])
def test_the_worst_postures_are_those_of_another_search(name, tmp_path):
    scene, rated = rated_of(name, tmp_path)
    keys = rated_robot(name, tmp_path)[1]
    worst, last = judge(scene, keys), rated.columns[rated.lifts[-1].column].name
    if rated.across:
        worst[last] = judge(scene, keys, rated.scene.payloads[rated.across].com)[last]
    most = max(worst.values())
    for lift in rated.lifts:
        joint = rated.columns[lift.column].name
        # no posture of the judge is worse; the judge's own search ends a little early
        assert worst[joint] * (1 - 1e-5) - 1e-6 * most <= lift.held
        assert lift.held <= worst[joint] * (1 + 1e-3) + 1e-6 * most


@pytest.mark.parametrize("name", QUICK)
def test_each_joint_is_held_in_a_posture_that_comes_near_its_worst(name, tmp_path):
    scene, rated = rated_of(name, tmp_path)
    frame = scene.model.frames[scene.model.getFrameId(rated.link)]
    most = max(lift.held for lift in rated.lifts)
    moves = {lift.drive: motion for _, lift, motion in rated.motions() if lift is not None}
    for lift in rated.lifts:
        com = rated.scene.payloads[rated.carried(lift.posture)].com
        model = scene.model.copy()
        load = pin.Inertia(rated.rating.payload, np.array(com), np.zeros((3, 3)))
        model.appendBodyToJoint(frame.parentJoint, load, frame.placement)
        data = model.createData()
        motion, column = moves[lift.drive], rated.columns[lift.column]
        g = pin.computeGeneralizedGravity(model, data, motion.q[0])[column.index_v]
        if lift.held >= 0.02 * most:
            assert abs(g) >= 0.97 * lift.held * (1 - 1e-4)
        # one joint moves, against gravity, by 90 degrees or up to its limit; then it rests
        others = np.delete(np.abs(motion.v), column.index_v, axis=1)
        assert not others.any()
        position = motion.joint_positions()[:, lift.column]
        far = int(np.abs(position - position[0]).argmax())
        way, up = abs(position[far] - position[0]), np.sign(position[far] - position[0])
        room = (column.upper if up > 0 else column.lower) - position[0]
        if lift.held >= 0.02 * most:
            assert up == np.sign(g)
            low, high = (energy(model, q) for q in motion.q[[0, far]])
            assert high > low
        if column.unit == "rad":
            assert way == pytest.approx(min(np.pi / 2, abs(room)), abs=1e-4)
            acceleration = np.abs(motion.a).max()
            assert acceleration == pytest.approx(lift.speed / 1.5, rel=0.02)
            assert np.abs(motion.v).max() == pytest.approx(lift.reached, rel=2e-3)
        assert np.abs(motion.v).max() <= lift.speed * (1 + 1e-9)
        assert motion.duration == pytest.approx(4 * lift.duration)
        assert position[-1] == position[0]
        half = motion.t > 2 * lift.duration + 1e-9
        assert not motion.v[half].any()


def test_a_slide_goes_as_far_as_its_top_speed_needs(tmp_path):
    _, rated = rated_of("arm", tmp_path)
    slide = rated.lifts[2]
    assert slide.reached == pytest.approx(slide.speed, rel=0.01)


def test_where_a_limit_is_in_the_way_the_joint_moves_down(tmp_path):
    robot = read_robot(
        write_arm(tmp_path, 'lower="0.3" upper="1.9"', 'lower="-1.9" upper="-0.3"'), {}
    )
    rated = rate(pf.Scene(robot.model, robot=robot), {"payload": 2.0, "link": "tool"})
    boom = rated.lifts[1]  # its effort is largest next to the level, above which it cannot go
    assert rated.postures[boom.posture, 1] == pytest.approx(-0.3)
    assert boom.to[1] == pytest.approx(-0.3 - np.pi / 2, abs=1e-4)


def test_a_move_to_a_limit_ends_before_it(tmp_path):
    robot = read_robot(
        write_arm(tmp_path, 'lower="0.3" upper="1.9"', 'lower="0.3" upper="1.00006"'), {}
    )
    rated = rate(pf.Scene(robot.model, robot=robot), {"payload": 2.0, "link": "tool"})
    assert rated.lifts[1].to[1] == 1.0
    assert len(list(rated.motions())) > len(rated.lifts)  # each within the limits


def test_few_postures_serve_all_joints(tmp_path):
    """One more with the payload across the last axis."""
    assert [len(rated_of(name, tmp_path)[1].postures) for name in ("ur10", "ur5", "ur3")] == [3] * 3


def test_the_payload_lies_off_the_last_joints_axis_for_it_alone(tmp_path):
    """By hand: the last joint of a UR10 holds 10 kg at 0.1 m, and lifts it by 90 degrees."""
    rated = rated_of("ur10", tmp_path)[1]
    last = rated.lifts[-1]
    assert [rated.carried(k) for k in range(3)] == [rated.payload] * 2 + [rated.across]
    assert {lift.drive: lift.posture == 2 for lift in rated.lifts} == {
        lift.drive: lift is last for lift in rated.lifts
    }
    # as far along tool0's z as rated, and as far off the wrist's axis, which is that z
    along, off = (rated.scene.payloads[name].com for name in (rated.payload, rated.across))
    assert along == (0.0, 0.0, 0.1)
    assert off[2] == pytest.approx(0.1)
    assert np.hypot(*off[:2]) == pytest.approx(0.1)
    assert last.held == pytest.approx(10.0 * 9.81 * 0.1, rel=2e-3)
    # the motion carries it there, and only there
    for payload, lift, motion in rated.motions():
        names = [n for n, on in zip(motion.payload_names, motion.attached[0], strict=True) if on]
        assert names == [payload]
        assert (payload == rated.across) == (
            lift is last or (lift is None and bool((motion.q[0] == rated.postures[2]).all()))
        )


@pytest.mark.parametrize("keys", [{"payload_offset": 0.0}, {"link": "stick"}])
def test_a_payload_that_is_off_the_last_axis_anyway_lies_nowhere_else(keys, tmp_path):
    """At its origin; and behind a joint that slides. The arm's own wrist has it off its axis."""
    assert rated_of("arm", tmp_path, **keys)[1].across == ""
    assert rated_of("arm", tmp_path)[1].across == ""


@pytest.mark.parametrize("name", ["ur5", "arm"])
def test_the_motion_as_a_file_is_the_same(name, tmp_path):
    _, rated = rated_of(name, tmp_path)
    (tmp_path / "rating.waypoints.yaml").write_text(rated.waypoints())
    scene = rated.scene
    motion = pf.load_trajectory(tmp_path / "rating.waypoints.yaml", scene)
    assert (motion.attached.sum(axis=1) == 1).all()
    whole = pf.inverse_dynamics(scene, motion).effort_frictionless
    parts = [pf.inverse_dynamics(scene, part).effort_frictionless for *_, part in rated.motions()]
    peaks = np.abs(np.concatenate(parts)).max(axis=0)
    np.testing.assert_allclose(np.abs(whole).max(axis=0), peaks, rtol=1e-3)


def test_the_rating_has_a_longer_lever_or_less_time_by_its_keys(tmp_path):
    _, near = rated_of("ur5", tmp_path)
    _, far = rated_of("ur5", tmp_path, payload_offset=0.3)
    assert far.lifts[1].held == pytest.approx(near.lifts[1].held + 5.0 * 9.81 * 0.2, rel=0.01)
    _, slow = rated_of("ur5", tmp_path, acceleration_time=6.0)
    assert slow.lifts[1].duration == pytest.approx(2 * near.lifts[1].duration, rel=0.01)


BAD = r"""
{payload: 0}    greater than 0
{payload: -1}   greater than 0
{payload: 20}   20 kg is more than 2 times the 9.5 kg of
{payload: ten}  should be a number
{}              `payload` is missing
{payload: 1, reach: 2}            unknown key `reach`
{payload: 1, speed: {elbow: 1}}   rating.speed: unknown joint 'elbow'
{payload: 1, link: hand}          there is no link 'hand'
{payload: 1, link: base}          no drive moves base
{payload: 1, inertia: [1, 0, 0, 1, 0, 3]}        rating.inertia: .* triangle inequality
{payload: 1, inertia: [1, 0, 0, 1, 0, -1]}       rating.inertia: .* one is negative
{payload: 1, inertia: [90, 0, 0, 90, 0, 90]}     rating.inertia: .* radius of gyration of 9.49 m
{payload: 1, inertia: [1, 1, 1]}                 `inertia\[3\]` is missing
"""


@pytest.mark.parametrize(("keys", "said"), table(BAD, yaml.safe_load, str))
def test_a_rating_that_cannot_be_is_refused_in_a_line(keys, said, tmp_path):
    scene, _ = rated_robot("arm", tmp_path)
    with pytest.raises(PinfricError, match=said) as refused:
        rate(scene, keys)
    assert "\n" not in str(refused.value)


def test_bare_links_carry_many_times_their_mass(tmp_path):
    """Links whose masses leave out drives are light: 9.5 kg that carry 20 kg, not 200."""
    scene, _ = rated_robot("arm", tmp_path)
    bare = dataclasses.replace(scene, masses="without_drives")
    rated = rate(bare, {"payload": 20.0})
    assert rated.scene.payloads[rated.payload].mass == 20.0
    with pytest.raises(TrajectoryError, match=r"200 kg is more than 20 times the 9\.5 kg"):
        rate(bare, {"payload": 200.0})


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('velocity="1.5"', 'velocity="0"', "joint lift has no velocity limit; .*rating.speed.lift"),
        ('velocity="1.5"', 'velocity="1e6"', "that a joint can have"),
        ('lower="0" upper="0.5"', 'lower="0" upper="0"', "joint slide slides without limits"),
        (
            '<parent link="stick"/><child link="tool"/>',
            '<parent link="column"/><child link="tool"/>',
            "It ends in stick, tool; name it as `link`",
        ),
    ],
)
def test_a_robot_that_cannot_be_rated_is_refused(old, new, said, tmp_path):
    file = write_arm(tmp_path, old, new)
    robot = read_robot(file, {})
    scene = pf.Scene(robot.model, robot=robot, source=str(file))
    with pytest.raises(TrajectoryError, match=said):
        rate(scene, {"payload": 1})


def test_closed_loops_are_refused():
    with pytest.raises(TrajectoryError, match="has loops"):
        rate(pf.load_scene("delta"), {"payload": 1})


def test_what_holds_a_payload_is_that_of_the_rating(tmp_path):
    _, rated = rated_of("xarm7", tmp_path)
    for lift in rated.lifts:
        held = holding_efforts(rated.scene, rated.carried(lift.posture))
        # steps that gain less than 1e-8 of the largest end the search, of all joints or of one
        assert held[rated.columns[lift.column].name] == pytest.approx(lift.held, rel=1e-8)


def carrying(model: pin.Model, link_of: int, kg: float = 1.0) -> pf.Scene:
    """A robot whose joint `link_of` carries a payload at its origin."""
    model.addBodyFrame("tip", link_of, pin.SE3.Identity(), 0)
    return pf.Scene(model, payloads={"load": Payload(link="tip", mass=kg, com=(0.0, 0.0, 0.0))})


def test_a_bound_of_holding_efforts_is_reached_by_a_level_arm_stretched_out():
    """Two links of 1 m that turn about y, 3 kg at the end of each, and 1 kg at the elbow."""
    arm = Arm(carrying(row("ab", lump(3.0, [1.0, 0, 0]), 1.0), 2), "load")
    shoulder, elbow = (3 * 1 + 3 * 2 + 1 * 1) * 9.81, 3 * 1 * 9.81
    assert arm.effort_bounds() == pytest.approx([shoulder, elbow], rel=1e-12)
    assert arm.farthest(arm.efforts, [0, 1])[1] == pytest.approx([shoulder, elbow], rel=1e-6)
    # about a vertical axis nothing weighs
    pan = chain(("pan", pin.JointModelRZ(), lump(3.0, [1.0, 0, 0])), ("b", pin.JointModelRZ()))
    assert Arm(carrying(pan, 2), "load").effort_bounds()[0] == 0.0


@pytest.mark.parametrize("seed", range(6))
def test_no_posture_needs_more_than_the_bound_of_holding_efforts(seed):
    rng, model = np.random.default_rng(seed), pin.Model()
    kinds = (pin.JointModelRevoluteUnaligned, pin.JointModelPrismaticUnaligned)
    for j in range(6):
        axis = rng.normal(size=3)
        joint = kinds[int(rng.random() < 0.3)](axis / np.linalg.norm(axis))
        end = rng.uniform(0.1, 2.0, 1)
        place = pin.SE3(pin.rpy.rpyToMatrix(rng.uniform(-3, 3, 3)), rng.normal(size=3))
        parent = max(0, j - int(rng.random() < 0.3))  # some branch off
        rest = np.full(1, 500.0), np.full(1, 5.0), -end, end
        model.addJoint(parent, joint, place, f"j{j}", *rest)
        model.appendBodyToJoint(j + 1, lump(rng.uniform(0, 4), rng.normal(size=3)), place)
    arm = Arm(carrying(model, 6), "load")
    bound, data = arm.effort_bounds(), arm.scene.loaded_model().createData()
    postures = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit, (2000, model.nq))
    loaded = arm.scene.loaded_model()
    found = np.abs([pin.computeGeneralizedGravity(loaded, data, q) for q in postures]).max(axis=0)
    carriers = [model.joints[j].idx_v for j in arm.joints]
    assert (found[carriers] <= bound * (1 + 1e-12)).all()
    assert np.isfinite(bound).all()


@pytest.mark.parametrize("name", QUICK)
def test_joints_that_a_bound_keeps_below_what_is_asked_are_not_searched(name, tmp_path):
    _, rated = rated_of(name, tmp_path)
    names = {lift.drive: rated.columns[lift.column].name for lift in rated.lifts}
    for payload in filter(None, (rated.payload, rated.across)):
        carried = [lift for lift in rated.lifts if rated.carried_by(lift.drive) == payload]
        held = {names[lift.drive]: lift.held for lift in carried}
        others = dict.fromkeys(names.values(), np.inf)
        asked = others | {joint: effort * 1.3 + 1e-6 for joint, effort in held.items()}
        left = holding_efforts(rated.scene, payload, above=asked)
        if "panda" not in name:  # its fingers follow each other: no bound
            assert set(left) <= set(held)
            assert len(left) < len(held) or payload != rated.payload
        heavy = {joint: effort for joint, effort in held.items() if effort > 1e-9}
        least = others | {joint: effort * (1 - 1e-6) for joint, effort in heavy.items()}
        searched = holding_efforts(rated.scene, payload, above=least)
        assert {joint: searched[joint] for joint in heavy} == pytest.approx(heavy, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in ROBOTS if name != "arm"])
def test_no_arm_hits_itself_or_goes_below_its_base(name, tmp_path):
    """By the collision meshes; neighbours and the Panda's two fingers always touch."""
    scene, rated = rated_of(name, tmp_path)
    folder = scene.source.partition("/example-robot-data/")[0]
    shapes = pin.buildGeomFromUrdf(
        model := pin.buildModelFromUrdf(scene.source),
        scene.source,
        pin.GeometryType.COLLISION,
        package_dirs=[folder, f"{folder}/example-robot-data/robots"],
    )
    shapes.addAllCollisionPairs()
    for pair in list(shapes.collisionPairs):
        one, other = (shapes.geometryObjects[i] for i in (pair.first, pair.second))
        j, k = sorted((one.parentJoint, other.parentJoint))
        if j in (k, model.parents[k]) or ("finger" in one.name and "finger" in other.name):
            shapes.removeCollisionPair(pair)
    assert len(shapes.collisionPairs) >= 20
    data, hit = model.createData(), shapes.createData()
    for *_, motion in rated.motions():
        for position in motion.q[::5]:
            q = pin.neutral(model)
            q[: len(position)] = position
            assert not pin.computeCollisions(model, data, shapes, hit, q, True)
            assert min(place.translation[2] for place in list(data.oMi)[1:]) > -1e-3
