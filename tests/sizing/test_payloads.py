"""Payloads whose inertia is not given: cubes of water by hand, which never make a drive lighter."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from sizing_cases import COOL, one_drive

import pinfric as pf
from pinfric.errors import SceneError
from pinfric.show.report.sizing import body_lines
from pinfric.sizing.files import sized_files
from pinfric.sizing.summary import sizing_summary

#: A lever of 2 kg at 0.3 m that carries 8 kg at 0.5 m; about a level axis.
LINK, AT, LOAD, FAR = 2.0, 0.3, 8.0, 0.5
#: The cube: (8/1000)^(1/3) = 0.2 m wide, 8 x 0.04/6 kg m^2.
CUBE = 8.0 * 0.2**2 / 6.0


def lever(inertia=None, **more):
    load = {"link": "tool", "mass": LOAD, "com": [FAR, 0, 0]}
    if inertia is not None:
        load["inertia"] = [inertia, 0, 0, inertia, 0, inertia]
    model = chain(("j", pin.JointModelRY(), lump(LINK, [AT, 0.0, 0.0], moment=0.0)))
    model.addFrame(pin.Frame("tool", 1, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    return pf.Scene(model=model, payloads={"box": load}, stick_velocity=0.0, **more)


def swing(scene, start=0.0, way=0.5, time=0.6):
    """One quintic move from a level lever; about +y it falls where the angle grows."""
    s = np.linspace(0.0, 1.0, 401)
    q = start + way * (10 * s**3 - 15 * s**4 + 6 * s**5)
    v = way * (30 * s**2 - 60 * s**3 + 30 * s**4) / time
    a = way * (60 * s - 180 * s**2 + 120 * s**3) / time**2
    return pf.Trajectory.from_arrays(scene, time * s, q[:, None], v[:, None], a[:, None])


def torque(motion, inertia):
    """(T,) by hand: J a less the weight, which turns the lever down."""
    J = LINK * AT**2 + LOAD * FAR**2 + inertia
    weight = 9.81 * (LINK * AT + LOAD * FAR) * np.cos(motion.q[:, 0])
    return J * motion.a[:, 0] - weight


def strong(tmp_path, **motor):
    torques = "average_torque", "repeated_peak_torque", "momentary_peak_torque", "rated_torque"
    motor = {"continuous_torque": 2.0, "peak_torque": 20.0, "resistance": 0.05} | motor
    return one_drive(tmp_path, motor, dict.fromkeys(torques, 1e3))


#: A slow winding feels the mean torque alone.
WANTED = COOL | {"holding_brake": "any", "inertia_ratio": 1e3, "thermal_time": 5e3}


def rows(report):
    return {c.name: c for c in report.joints[0].installed.criteria}


def test_a_payload_without_inertia_is_a_cube_of_water(tmp_path):
    """Lifted: its peak by hand, and all rows, are those of the body of that inertia."""
    parts = strong(tmp_path)
    guess, body, point = (
        pf.size(s := lever(x), swing(s, 0.5, -0.5), parts, conditions=WANTED, on_miss="ignore")
        for x in (None, CUBE, 0.0)
    )
    motion = swing(lever(), 0.5, -0.5)
    assert guess.joints[0].demand.peak == pytest.approx(np.abs(torque(motion, CUBE)).max())
    assert point.joints[0].demand.peak == pytest.approx(np.abs(torque(motion, 0.0)).max())
    assert guess.joints[0].load_inertia == pytest.approx(LINK * AT**2 + LOAD * FAR**2 + CUBE)
    for name, row in rows(guess).items():
        assert row.required == rows(body)[name].required, name
    assert rows(guess)["peak torque"].required > rows(point)["peak torque"].required
    # said as a guess, and what it adds
    place = "robot.payloads.box.inertia"
    assert guess.bodies == {place: "a cube of water 0.2 m wide, 0.0533 kg m^2"}
    (line,) = body_lines(guess)
    assert line.startswith("guess: payload box: a cube of water 0.2 m wide, 0.0533 kg m^2")
    assert sizing_summary(guess).point_mass == point.drive_mass
    assert not body.bodies
    assert not body_lines(body)
    assert not body_lines(point)


def test_a_guess_makes_no_drive_lighter(tmp_path):
    """A load that falls by itself needs less torque as a body: the point's rows count."""
    fall = 0.0, 1.4, 1.5
    body, point = (np.sqrt(np.mean(torque(swing(lever(), *fall), x) ** 2)) for x in (CUBE, 0.0))
    assert body < 0.9995 * point
    parts = strong(tmp_path)
    guess, as_body, as_point = (
        pf.size(s := lever(x), swing(s, *fall), parts, conditions=WANTED, on_miss="ignore")
        for x in (None, CUBE, 0.0)
    )
    assert (
        guess.joints[0].demand.rms == as_point.joints[0].demand.rms > as_body.joints[0].demand.rms
    )
    for name, row in rows(guess).items():
        if row.scaled:
            apart = [rows(r)[name].margin for r in (as_body, as_point)]
            assert row.margin == pytest.approx(min(apart), rel=1e-9), name
    assert rows(guess)["continuous torque"].margin < rows(as_body)["continuous torque"].margin
    # a motor that just bears the body does not bear the point
    need = rows(as_body)["continuous torque"].required
    tight = strong(tmp_path, continuous_torque=need * 1.0002, thermal=None)
    fits = [
        pf.size(s := lever(x), swing(s, *fall), tight, conditions=WANTED, on_miss="ignore")
        for x in (CUBE, 0.0, None)
    ]
    assert [r.joints[0].choice is None for r in fits] == [False, True, True]


def test_inertia_that_is_said_to_be_0_is_a_point(tmp_path):
    report = pf.size(lever(0.0), swing(lever()))
    assert not report.bodies
    assert report.joints[0].demand.peak == pytest.approx(np.abs(torque(swing(lever()), 0.0)).max())


@pytest.mark.parametrize(
    ("inertia", "said"),
    [([1, 0, 0, 1, 0, 3], "triangle inequality"), ([1, 0, 0, 1, 0, -0.1], "one is negative")],
)
def test_an_inertia_that_no_body_has_is_refused_in_a_line(inertia, said):
    box = {"link": "tool", "mass": 8.0, "com": [0, 0, 0], "inertia": inertia}
    with pytest.raises(SceneError, match=f"robot.payloads.box: .*{said}") as refused:
        lever().with_(payloads={"box": box})
    assert "\n" not in str(refused.value)


def test_the_files_of_a_sizing_carry_the_body_and_say_that_it_is_a_guess(tmp_path):
    scene = pf.load_scene("three_link")
    scene = scene.with_(payloads={"part": {"link": "link_3", "mass": 1.0, "com": [0, 0, 0.1]}})
    motion = pf.load_trajectory("three_link", scene)
    report = pf.size(scene, motion, strong(tmp_path), conditions=WANTED, on_miss="ignore")
    for name, text in sized_files(report, tmp_path).items():
        (tmp_path / name).write_text(text)
    with pytest.warns(pf.PinfricWarning, match=r"`pinfric size` \(robot.payloads.part.inertia\)"):
        read = pf.load_scene(tmp_path / "sized.scene.yaml")
    assert read.payloads["part"].inertia == pytest.approx((1 / 600, 0, 0, 1 / 600, 0, 1 / 600))
    found = pf.inverse_dynamics(read, motion)
    np.testing.assert_allclose(found.effort_upper, report.result.effort_upper, rtol=1e-9, atol=1e-9)
    # an inertia that is a guess asks for no stronger brakes: it weighs nothing
    again = pf.size(read, motion, strong(tmp_path), conditions=WANTED, on_miss="ignore")
    for one, other in zip(report.standstills, again.standstills, strict=True):
        assert one.torque.required == pytest.approx(other.torque.required, rel=1e-6, abs=1e-9)


def test_a_guessed_body_takes_the_brake_of_its_point(tmp_path):
    """A table tilted by 5 mrad carries 10 kg, 20 mm off its axis: 0.01 N m hold it.

    That is 4 % of the torque that turns it with a point, 1 % of that with a cube; up to 2 % takes
    no brake.
    """
    body = pin.Inertia(1.0, np.zeros(3), 0.02 * np.eye(3))
    model = chain(("j", pin.JointModelRZ(), body))
    model.addFrame(pin.Frame("tool", 1, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    model.gravity.linear = np.array([0.05, 0.0, -9.81])
    load = {"link": "tool", "mass": 10.0, "com": [0.02, 0.0, 0.0]}
    brake = {"source": "invented", "grade": "R", "torque": 1.0, "mass": 0.1, "rotor_inertia": 1e-6}
    torques = "average_torque", "repeated_peak_torque", "momentary_peak_torque", "rated_torque"
    gear, motor = dict.fromkeys(torques, 1e3), {"continuous_torque": 2.0, "peak_torque": 20.0}
    catalog = one_drive(tmp_path, motor, gear, brakes={"B": brake})
    wanted = COOL | {"holding_brake": "where_needed", "inertia_ratio": 1e3}
    taken = []
    for more in ({"inertia": [0.0] * 6}, {}, {"inertia": [0.2, 0, 0, 0.2, 0, 0.2]}):
        scene = pf.Scene(model=model, payloads={"box": load | more}, stick_velocity=0.0)
        motion = swing(scene, start=np.pi / 2, way=1.0, time=0.75)
        report = pf.size(scene, motion, catalog, conditions=wanted, on_miss="ignore")
        (joint,) = report.joints
        taken.append(joint.installed.candidate.brake)
    assert taken == ["B", "B", ""]
