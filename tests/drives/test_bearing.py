"""Loads and life of bearings and screws, by hand and by the check values of makers' rules."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump, row
from mechanisms import pin_friction, shifted
from sizing_cases import COULOMB, GEAR, one_drive, trapezoid, turntable, write_catalog

import pinfric as pf
from pinfric.drives.bearing import (
    BALL,
    ROLLER,
    BearingRatings,
    GuideLoad,
    bearing_life,
    bearing_load,
    equivalent_load,
    guide_safety,
    joint_loads,
    static_load,
)
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status
from pinfric.errors import CatalogError

CROSSED = {
    "kind": "crossed roller",
    "pitch_diameter": 0.077,
    "offset": 0.017,
    "dynamic_rating": 10800.0,
    "static_rating": 18700.0,
    "max_radial": 2940.0,
    "max_axial": 9800.0,
    "max_moment": 188.0,
}


def judged(scene, motion, catalog, **conditions):
    (joint,) = pf.size(scene, motion, catalog, conditions=conditions, on_miss="ignore").joints
    return joint, {c.name: c for c in joint.assessments[0].criteria}


def test_output_bearing_of_an_actuator_against_the_makers_rules():
    """FHA-17C, 500 N at 0.1 m from the flange, 200 N along the axis at 0.05 m, 15 rpm, fw 1.2."""
    ratings = pf.load_catalog().bearings["Harmonic Drive FHA-17C output bearing"].ratings
    assert ratings == BearingRatings(**CROSSED)
    same = np.ones(5)
    speed = 15 * 2 * np.pi / 60
    moment = 500 * 0.1 + 200 * 0.05  # about the flange: R comes with the rating
    load = bearing_load(np.arange(5.0), speed * same, 500 * same, 200 * same, moment * same)
    assert load.moment + ratings.offset * load.radial == pytest.approx(68.5)
    across = ratings.radial_load(500.0, 68.5)
    assert 200 / across == pytest.approx(0.0877, abs=5e-5)
    assert equivalent_load(ratings, load) == pytest.approx(2369.2, abs=0.05)
    assert bearing_life(10800.0, 1.2 * 2369.2208, speed, ROLLER) == pytest.approx(95034, abs=2)
    assert static_load(ratings, load) == pytest.approx(2367.2, abs=0.05)
    assert 18700 / static_load(ratings, load) == pytest.approx(7.90, abs=5e-3)


def test_mostly_axial_loads_take_the_other_factors():
    ratings, one = BearingRatings(**CROSSED), np.ones(2)
    load = bearing_load(np.arange(2.0), one, 10 * one, 1000 * one, 0 * one)
    across = 10 * (1 + 2 * 0.017 / 0.077)
    assert equivalent_load(ratings, load) == pytest.approx(0.67 * (across + 1000))


def test_means_weight_by_speed_and_by_the_exponent_of_the_rolling_elements():
    """1 s at 3 rad/s under 100 N, 2 s at 1 rad/s under 200 N, then loaded at rest."""
    t = np.array([0, 1, 1 + 1e-9, 3, 3 + 1e-9, 5])
    speed, force = np.array([3, -3, 1, 1, 0, 0.0]), np.array([100, 100, 200, 200, 900, 900.0])
    speed[1] = 3
    load = bearing_load(t, -speed, force, -force, 2 * force)
    assert (load.radial, load.axial, load.moment) == (900, 900, 1800)
    assert load.speed == pytest.approx((3 + 2) / 5)
    for p in (BALL, ROLLER):
        mean = ((3 * 100**p + 2 * 200**p) / 5) ** (1 / p)
        assert load.means[p] == pytest.approx((mean, mean, 2 * mean), rel=1e-6)
    huge = bearing_load(t, speed, 1e200 * force, force, force)
    assert huge.means[BALL][0] == pytest.approx(1e200 * huge.means[BALL][1])
    idle = bearing_load(t, 0 * speed, force, force, force)
    assert idle.means[ROLLER] == (0, 0, 0)
    assert bearing_life(1.0, 1.0, idle.speed, BALL) == np.inf


def boom(mass=3.0, arm=0.4, height=0.1):
    """A load out on an arm about a vertical axis: it hangs on the bearing, and swings out."""
    body = lump(mass, [arm, 0.0, height])
    model = chain(("table", pin.JointModelRZ(), body))
    friction = {"table": dry(COULOMB)}
    return pf.Scene(model=model, friction=friction, stick_velocity=0.0)


def test_wrench_of_a_swung_load_is_held_against_the_ratings(tmp_path):
    mass, arm, height = 3.0, 0.4, 0.1
    scene = boom(mass, arm, height)
    motion = trapezoid(scene)
    joint, found = judged(scene, motion, one_drive(tmp_path, gear={"bearing": CROSSED}))
    v, a = joint.cycle.velocity, joint.cycle.acceleration
    radial = mass * arm * np.hypot(a, v**2)
    # about the origin: weight x arm out of the plane, forces in the plane x height
    moment = mass * np.hypot(9.81 * arm + v**2 * arm * height, a * arm * height)
    weight = mass * 9.81
    assert found["bearing axial force"].required == pytest.approx(weight)
    assert found["bearing radial force"].required == pytest.approx(radial.max())
    tilting = found["bearing tilting moment"]
    assert tilting.required == pytest.approx(moment.max() + 0.017 * radial.max())
    assert tilting.margin == pytest.approx(1 - tilting.required / 188)
    largest = radial.max() + 2 * tilting.required / 0.077 + 0.44 * weight
    safety = found["bearing static safety"]
    assert (safety.required, safety.available) == pytest.approx((1.5, 18700 / largest))
    turned = np.trapezoid(v, joint.cycle.t)

    def mean(x):
        return (np.trapezoid(v * x ** (10 / 3), joint.cycle.t) / turned) ** 0.3

    across = mean(radial) + 2 * (mean(moment) + 0.017 * mean(radial)) / 0.077
    assert weight / across < 1.5
    life = (10800 / 1.2 / (across + 0.45 * weight)) ** (10 / 3) * 1e6
    life *= 2 * np.pi * joint.cycle.t[-1] / turned / 3600
    assert found["bearing life L10"].available == pytest.approx(life, rel=1e-9)


def test_friction_and_payload_phases(tmp_path):
    """Friction about the axis loads no bearing; a payload does while it is carried."""
    payload = {"box": {"link": "hand", "mass": 2.0, "com": [0.0, 0.0, 0.0]}}
    model = boom().model.copy()
    model.addFrame(pin.Frame("hand", 1, shifted(0.4), pin.FrameType.BODY))
    scene = pf.Scene(model=model, payloads=payload)
    plain = trapezoid(scene)
    carried = {"box": plain.t > 1.0}
    motion = pf.Trajectory.from_arrays(scene, plain.t, plain.q, plain.v, plain.a, attached=carried)
    for other in (
        scene,
        pf.Scene(
            model=model,
            payloads=payload,
            friction={"table": pin_friction(0.1, 0.02)},
        ),
    ):
        joint, found = judged(other, motion, one_drive(tmp_path, gear={"bearing": CROSSED}))
        assert found["bearing axial force"].required == pytest.approx(5 * 9.81)
        assert joint.demand.bearing.moment == pytest.approx(5 * 9.81 * 0.4, rel=0.02)


def test_friction_further_out_is_not_taken_for_the_joints_own():
    """Wrenches are known at joints with friction: here at the second of two only."""
    model = boom().model.copy()
    outer = model.addJoint(1, pin.JointModelRX(), pin.SE3(np.eye(3), np.ones(3)), "outer")
    model.appendBodyToJoint(outer, lump(2.0, [0.1, 0.2, 0.3], 1.0), pin.SE3.Identity())
    pinned = pin_friction(0.1, 0.02)
    q, v, a = np.array([[0.3, 0.5], [0.1, 2.0], [1.0, -3.0]])
    loads = [
        joint_loads(pf.inverse_dynamics(pf.Scene(model=model, friction=rubs), q, v, a), 0)
        for rubs in ({}, {"outer": pinned})
    ]
    np.testing.assert_allclose(*loads, rtol=1e-12)


def test_a_joints_own_bearing_carries_instead_of_the_gears(tmp_path):
    pair = {
        "kind": "ball",
        "spacing": 0.05,
        "dynamic_rating": 9000.0,
        "static_rating": 4000.0,
        "factors": {"limit": 0.3, "below": [1, 0], "above": [0.56, 1.4], "static": [0.6, 0.5]},
    }
    bearings = {
        "pair": {"source": "invented", "grade": "R", "ratings": pair},
        "bush": {"source": "invented", "grade": "R", "mu": 0.1},
    }
    catalog = one_drive(tmp_path, gear={"bearing": CROSSED}, bearings=bearings)
    scene = boom()
    joint, found = judged(scene, trapezoid(scene), catalog, bearings={"table": "pair"})
    load = joint.demand.bearing
    assert found["bearing tilting moment"].status == Status.NOT_CHECKED
    worst = 0.6 * (load.radial / 2 + load.moment / 0.05) + 0.5 * load.axial
    assert found["bearing static safety"].available == pytest.approx(4000 / worst)
    radial, axial, moment = load.means[BALL]
    across = radial / 2 + moment / 0.05
    x, y = (1, 0) if axial <= 0.3 * across else (0.56, 1.4)
    life = bearing_life(9000.0, 1.2 * (x * across + y * axial), load.speed, BALL)
    assert found["bearing life L10"].available == pytest.approx(life)
    assert found["bearing life L10"].source == "ISO 281 (life), ISO 76 (static); ratings: invented"
    for name, text in (("bush", "has no `ratings`"), ("pear", "did you mean 'pair'")):
        with pytest.raises(CatalogError, match=f"conditions.bearings.table.*{text}"):
            judged(scene, trapezoid(scene), catalog, bearings={"table": name})
    with pytest.raises(CatalogError, match=r"conditions\.bearings: there is no drive 'tabel'"):
        judged(scene, trapezoid(scene), catalog, bearings={"tabel": "pair"})


def test_sliding_joints_have_no_bearing_to_check(tmp_path):
    bearings = {"B": {"source": "invented", "grade": "R", "ratings": CROSSED}}
    path = write_catalog(tmp_path / "c.yaml", gears={"S": SCREW}, bearings=bearings)
    with pytest.raises(CatalogError, match="'B' is a crossed roller; a sliding joint takes a `lin"):
        judged(lift(), up_and_down(lift()), load_catalog(path), bearings={"lift": "B"})
    with pytest.raises(CatalogError, match="crossed roller at a linear output"):
        load_catalog(write_catalog(path, gears={"S": {**SCREW, "bearing": CROSSED}}))


def sledge(mass, place):
    """A body on a level rail along x; its centre of mass at `place` of the carriage."""
    model = chain(("x", pin.JointModelPX(), lump(mass, place)))
    return pf.Scene(model=model)


def test_static_safety_of_a_guide_is_that_of_its_worst_carriage(tmp_path):
    """Four carriages at the corners of l x w, each with a quarter of the force and of the moments.

    By hand: P = F/4 + M/(2 l) + M_a/(2 w), f_s = C_0/P; sqrt(2) F: the rail may lie any way round.
    """
    mass, (side, height), length, width, rating = 40.0, (0.15, 0.3), 0.4, 0.25, 28.6e3
    scene = sledge(mass, [0.0, side, height])
    motion = up_and_down(scene)
    ratings = {
        "kind": "linear guide",
        "static_rating": 4 * rating,
        "static_moment": 2 * rating * length,
        "static_roll": 2 * rating * width,
        "static_safety": 3.0,
    }
    bearings = {"four": {"source": "invented", "grade": "R", "ratings": ratings}}
    catalog = load_catalog(
        write_catalog(tmp_path / "c.yaml", gears={"S": SCREW}, bearings=bearings)
    )
    _, without = judged(scene, motion, catalog)
    missing = without["guide loads"]
    assert (missing.status, missing.note) == (
        Status.NOT_CHECKED,
        "no figure (ratings of the guide; conditions.bearings)",
    )
    joint, found = judged(scene, motion, catalog, bearings={"x": "four"})
    force, top = mass * 9.81, np.abs(motion.a).max()
    pitch, yaw, roll = mass * top * height, mass * top * side, force * side
    assert joint.demand.guide.across == pytest.approx(force)
    assert joint.demand.guide.roll == pytest.approx(roll)
    assert joint.demand.guide.pitch == pytest.approx(np.hypot(pitch, yaw), rel=1e-6)
    worst = 2**0.5 * force / 4 + np.hypot(pitch, yaw) / (2 * length) + roll / (2 * width)
    safety = found["guide static safety"]
    assert safety.available == pytest.approx(rating / worst, rel=1e-6)
    assert (safety.required, safety.status) == (3.0, Status.PASSES)
    # a maker's example: C_0 28.6 kN under 8 kN with a load factor of 1.5 is 2.38
    one = BearingRatings(kind="linear guide", static_rating=28.6e3)
    assert guide_safety(one, GuideLoad(8e3 * 1.5 / 2**0.5, 0.0, 0.0)) == pytest.approx(
        2.38, abs=5e-3
    )
    assert np.isnan(guide_safety(one, GuideLoad(8e3, 0.0, 100.0)))
    assert guide_safety(BearingRatings(kind="linear guide"), GuideLoad(0.0, 0.0, 0.0)) == np.inf
    # THK: at least 2 without vibrations and impacts
    assert (one.least_safety, BearingRatings(**CROSSED).least_safety) == (2.0, 1.5)
    assert BearingRatings(kind="linear guide", static_safety=5.0).least_safety == 5.0


def test_what_is_not_known_is_not_checked(tmp_path):
    scene = turntable()
    bare = one_drive(tmp_path, gear={"bearing": None})
    joint, criteria = judged(scene, trapezoid(scene), bare)
    found = criteria["bearing loads"]
    assert (joint.choice, joint.assessments[0].lacks) == (None, ("output bearing",))
    assert (found.status, found.note) == (Status.NOT_CHECKED, "no figure (ratings of the bearing)")
    some = {"kind": "roller", "max_moment": 100.0}
    found = judged(scene, trapezoid(scene), one_drive(tmp_path, gear={"bearing": some}))[1]
    assert found["bearing tilting moment"].status == Status.PASSES
    for name in ("radial force", "axial force", "static safety", "life L10"):
        asked = name != "life L10"
        status = Status.NOT_CHECKED if asked else Status.NOT_REQUIRED
        assert found[f"bearing {name}"].status == status


@pytest.mark.parametrize(
    ("ratings", "text"),
    [
        ({**CROSSED, "spacing": 0.1}, "give one"),
        ({"kind": "ball", "dynamic_rating": 1e3}, "needs `factors`"),
        ({"kind": "tapered"}, "crossed roller"),
        ({**CROSSED, "factros": {}}, "did you mean 'factors'"),
    ],
)
def test_ratings_that_cannot_be_reckoned_with_are_refused(tmp_path, ratings, text):
    with pytest.raises(CatalogError, match=text):
        one_drive(tmp_path, gear={"bearing": ratings})


# ---------------------------------------------------------------- sliding joints


def lift(mass=4.0):
    model = chain(("lift", pin.JointModelPZ(), lump(mass)))
    return pf.Scene(model=model)


def up_and_down(scene, way=0.2, period=4.0):
    t = np.linspace(0, period, 801)
    w = 2 * np.pi / period
    q = way / 2 * (1 - np.cos(w * t))
    v, a = way / 2 * w * np.sin(w * t), way / 2 * w**2 * np.cos(w * t)
    return pf.Trajectory.from_arrays(scene, t, q[:, None], v[:, None], a[:, None])


SCREW = {
    "source": "invented",
    "grade": "R",
    "ratio": 2 * np.pi / 0.01,
    "output": "linear",
    "kind": "ball screw",
    "mass": 0.5,
    "input_inertia": 1e-6,
    "efficiency": 0.9,
    "stroke": 0.3,
    "bearing": {
        "kind": "ball screw",
        "dynamic_rating": 4000.0,
        "static_rating": 7000.0,
        "max_axial": 2000.0,
    },
}


@pytest.mark.parametrize("stroke", [0.3, 0.1])
def test_a_screw_bears_its_force_over_its_stroke(tmp_path, stroke):
    scene = lift()
    motion = up_and_down(scene)
    path = write_catalog(tmp_path / "c.yaml", gears={"S": {**SCREW, "stroke": stroke}})
    joint, found = judged(scene, motion, load_catalog(path))
    force = 4 * (9.81 + motion.a[:, 0].max())
    assert found["screw axial force"].required == pytest.approx(force)
    way = found["stroke"]
    assert (way.required, way.available) == pytest.approx((0.2, stroke))
    assert (way.status == Status.FAILS) == ("stroke" in joint.no_fit) == (stroke < 0.2)


@pytest.mark.filterwarnings(
    "ignore:.*(is outside the usual range|is a radius of gyration|continuous torque)"
)
def test_linear_motor_moves_a_joint_without_a_gear(tmp_path):
    motor = {
        "source": "invented",
        "grade": "R",
        "output": "linear",
        "ratio": 1.0,
        "continuous_torque": 60.0,
        "peak_torque": 240.0,
        "rotor_inertia": 1.1,
        "mass": 1.1,
    }
    catalog = load_catalog(
        write_catalog(
            tmp_path / "c.yaml",
            {},
            {"G": GEAR},
            gearmotors={"L": motor, "A": {**motor, "output": "rotary"}},
        )
    )
    scene = lift()
    motion = up_and_down(scene)
    joint, found = judged(scene, motion, catalog)
    assert [a.candidate.name for a in joint.assessments] == ["L"]
    force = 4 * 9.81 + (4 + 1.1) * motion.a[:, 0]  # the forcer moves with the load
    peak = found["peak torque"]
    assert (peak.required, peak.unit) == (pytest.approx(1.2 * force.max()), "N")
    assert not [name for name in found if name.startswith(("screw", "stroke"))]


def test_bundled_linear_drives_lift_a_torso_and_close_a_gripper():
    catalog = pf.load_catalog()
    linear = [
        e for s in (catalog.gears, catalog.gearmotors) for e in s.values() if e.output == "linear"
    ]
    assert len(linear) >= 10
    for scene, way in ((lift(25.0), 0.15), (lift(0.05), 0.04)):
        joint, _ = judged(scene, up_and_down(scene, way, 8.0), catalog)
        assert "maxon GP" in joint.choice.candidate.name
        motor = "maxon EC 45 flat 70 W 397172"
        screws = {name: gear for name, gear in catalog.gears.items() if name.startswith("PBC")}
        few = replace(catalog, motors={motor: catalog.motors[motor]}, gears=screws, gearmotors={})
        unread = pf.size(scene, up_and_down(scene, way, 8.0), few, on_miss="ignore").joints[0]
        assert unread.choice is None  # neither forces nor speeds of them were read
        figures = {figure for ask in unread.ask for figure in ask.figures}
        assert figures == {"permissible force", "maximum input speed"}
    screw = catalog.gears["PBC lead screw 12 mm, lead 5 mm"]
    rise = 0.005 / (np.pi * 0.012)  # eta = tan a/tan(a + phi), backwards tan(a - phi)/tan a
    phi = np.arctan(rise / screw.efficiency) - np.arctan(rise)
    back = np.tan(np.arctan(rise) - phi) / rise
    assert screw.back_efficiency == pytest.approx(back, abs=1e-3)
    steel = 7850 * np.pi * 0.012**2 / 4 * 0.5
    assert (screw.mass, screw.input_inertia) == pytest.approx(
        (steel, steel * 0.012**2 / 8), rel=2e-3
    )


def test_bundled_drives_move_a_large_arms_shoulder():
    """A UR10's, stretched out: 14 kg at 1 m, 0.4 rad up and down in 4 s."""
    body = lump(14.0, [1.0, 0.0, 0.0])
    model = chain(("shoulder", pin.JointModelRY(), body))
    scene = pf.Scene(model=model)
    joint, _ = judged(scene, up_and_down(scene, 0.4), pf.load_catalog())
    assert joint.demand.rms > 130
    assert joint.choice is not None


def test_each_joints_bearing_carries_what_hangs_on_it():
    """Three links of 1 kg held out on axes along y, 0.1 m beside them: shear and tilting moment."""
    scene = pf.Scene(row(("j0", "j1", "j2"), lump(1.0, [0.25, 0.1, 0.0]), 0.5))
    zero = np.zeros((2, 3))
    motion = pf.Trajectory.from_arrays(scene, np.array([0.0, 1.0]), zero, zero, zero)
    for j, joint in enumerate(pf.size(scene, motion).joints):
        load, weight = joint.demand.bearing, (3 - j) * 9.81
        assert (load.radial, load.moment) == pytest.approx((weight, 0.1 * weight))
