"""Worst stops of a cycle: against every sample, by speed and load, and refusals."""

import json
import re

import numpy as np
import pytest
from cli_cases import ROOT, results_in, told
from envelopes import result_of
from printed import assert_printed
from stop_cases import ARM, arm, turntable

import pinfric as pf
from pinfric.drives.criterion import Status
from pinfric.errors import StopError, TrajectoryError
from pinfric.stops.machines import MachineKind, Machines, stop_settings
from pinfric.stops.peaks import braking
from pinfric.stops.screen import screened_stops
from pinfric.stops.search import StopCase, StopCycle, estimates
from pinfric.stops.study import SHARES, stops_of

NAMES = ("lift", "elbow")


def braked(load=True, **stops):
    """The arm of two axes with brakes, a payload and a section on stops."""
    scene = arm()
    drives = [
        {
            "joint": name,
            "transmission": {
                "ratio": r,
                "rotor_inertia": J,
                "brake": {"torque": T, "torque_max": 2 * T, "engage_time": d, "stop_energy": 2.0},
            },
        }
        for name, r, J, T, d in zip(
            *(NAMES, ARM["ratios"], ARM["rotors"], ARM["brakes"], ARM["delays"]), strict=True
        )
    ]
    box = {"link": "tip", "mass": 1.5, "com": [0.0, 0.0, 0.0]}
    settings = {"category": 0, "reaction_time": 0.01, "friction": [0.5, 1.5], **stops}
    return scene.with_(actuators=drives, payloads={"box": box} if load else {}, stops=settings)


def swing(scene, samples=25, time=1.0):
    """Both axes from rest to rest and back, one period of a sine."""
    t = np.linspace(0.0, time, samples)
    w = 2 * np.pi / time
    size = np.array([0.5, -0.7])
    q = size * (1 - np.cos(w * t))[:, None] - np.array([0.9, 0.0])
    v, a = size * w * np.sin(w * t)[:, None], size * w**2 * np.cos(w * t)[:, None]
    return pf.Trajectory.from_arrays(scene, t, q, v, a)


@pytest.fixture(scope="module")
def found():
    scene = braked()
    model = scene.model.copy()
    model.lowerPositionLimit, model.upperPositionLimit = np.array([[-1.2, -1.6], [0.15, 0.2]])
    scene = scene.with_(model=model)
    return pf.stop(scene, swing(scene))


def test_the_worst_is_that_of_every_sample(found):
    every = [
        found.search.stop(StopCase(kind, sample))
        for kind in found.search.kinds
        for sample in range(len(found.trajectory.t))
    ]
    for d, axis in enumerate(found.axes):
        for figure, name in (("travel", "travel"), ("peak", "peak"), ("energy", "energy")):
            most = max(getattr(stop, name)[d] for stop in every)
            assert getattr(axis, figure) == pytest.approx(most, rel=0.01)
        assert axis.time == pytest.approx(max(stop.rest[d] for stop in every), rel=0.01)
        nearest = found.search.nearest(d).beyond[d].max()
        most = max(stop.beyond[d].max() for stop in every)
        assert nearest == pytest.approx(most, abs=0.01 * axis.travel)
    assert found.longest.time == pytest.approx(max(stop.time for stop in every), rel=0.01)
    assert found.farthest.path == pytest.approx(max(stop.path for stop in every), rel=0.01)


@pytest.mark.parametrize("room", [4.0, 0.05])
def test_a_joint_that_stands_is_dragged_along_by_the_stop_of_another(room):
    """The elbow stands all the time, near its limit; the stop of the lift throws it past it."""
    scene = braked()
    model = scene.model.copy()
    model.upperPositionLimit = np.array([10.0, room])
    model.lowerPositionLimit = -np.array([10.0, room])
    motion, scene = swing(scene, 13), scene.with_(model=model)
    still = np.array([1.0, 0.0])
    motion = pf.Trajectory.from_arrays(
        scene, motion.t, motion.q * still, motion.v * still, motion.a * still
    )
    machines = Machines(scene, stop_settings(scene, None), ("box",))
    screened = screened_stops(machines, motion, None, lambda *_: None)
    whole = stops_of(machines, motion)
    elbow, seen = whole.axes[1], {c.name: c for c in screened.criteria[1]}
    assert 0.05 < elbow.travel < 0.3
    place = {c.name: c for c in elbow.criteria}["position limit"]
    assert (place.fails, seen["position limit"].fails) == (room == 0.05, room == 0.05)
    assert seen["position limit"].source.startswith("simulated") == (room == 0.05)
    bounds = [estimates(machines, whole.search.cycle, kind).most for kind in whole.search.kinds]
    assert elbow.travel < max(float(most[:, 1].max()) for most in bounds)


@pytest.mark.slow
def test_the_worst_of_many_hills_is_found():
    """Two sines of each axis: following the nearest hill upwards missed 15 % of a travel."""
    scene, t = braked(load=False), np.linspace(0.0, 4.0, 241)
    sines = [[(0.25, 1.0, 0.3), (0.12, 2.5, 1.1)], [(0.3, 0.75, 1.7), (0.1, 3.25, 0.2)]]
    q, v, a = np.zeros((3, len(t), 2))
    for axis, parts in enumerate(sines):
        for size, frequency, phase in parts:
            w = 2 * np.pi * frequency
            q[:, axis] += size * np.sin(w * t + phase)
            v[:, axis] += size * w * np.cos(w * t + phase)
            a[:, axis] -= size * w**2 * np.sin(w * t + phase)
    found = pf.stop(scene, pf.Trajectory.from_arrays(scene, t, q, v, a))
    simulated = [stop for stop in found.search.found.values() if stop.case.speed == 1.0]
    assert len(simulated) < 200  # of 482
    every = [
        found.search.stop(StopCase(MachineKind(False, 0.0), sample)) for sample in range(len(t))
    ]
    for name in ("travel", "rest"):
        most = np.max([getattr(stop, name) for stop in every], axis=0)
        best = np.max([getattr(stop, name) for stop in simulated], axis=0)
        assert best == pytest.approx(most, rel=2e-3), name


def test_speed_load_and_friction_at_their_worst(found):
    """Least friction goes farther, greatest friction and brakes load the gears more."""
    for case in (StopCase(MachineKind(False, 1.0), sample) for sample in (5, 12, 18)):
        least = found.search.stop(case)
        greatest = found.search.stop(case._replace(kind=MachineKind(True, 1.0)))
        assert (least.travel >= greatest.travel - 1e-9).all()
        assert least.time >= greatest.time
        assert (greatest.peak[least.travel > 0.05] > least.peak[least.travel > 0.05]).all()
    for row in found.grid:
        times, travels = list(row.time.values()), list(row.travel.values())
        assert times == sorted(times)
        assert travels == sorted(travels)
    lift = [row for row in found.grid if row.name == "lift"]
    assert [row.load for row in lift] == ["nothing", "33 %", "66 %", "full load"]
    assert list(lift[0].time) == [f"{100 * share:.0f}" for share in SHARES]
    assert lift[-1].travel["100"] == pytest.approx(found.axes[0].travel)


def test_the_reaction_goes_on_along_the_motion(found):
    """Where the drives react the way since the command is that of the trajectory."""
    trajectory, cycle = found.trajectory, found.search.cycle
    command, way, path = cycle.before(6, 1.0)
    assert command == pytest.approx(trajectory.t[6] - 0.01)
    assert way == pytest.approx(0.01 * trajectory.v[6], rel=0.05)
    assert path > 0.0
    assert cycle.before(6, 0.5)[1] == pytest.approx(0.5 * way, rel=0.05)
    assert cycle.before(0, 1.0)[0] == 0.0  # before the cycle it is at rest


def test_a_motion_that_begins_at_speed_is_taken_to_have_moved_so_before(found):
    scene, whole = found.scene, swing(found.scene)
    part = pf.Trajectory.from_arrays(scene, whole.t[6:], whole.q[6:], whole.v[6:], whole.a[6:])
    cycle = StopCycle.of(found.search.machines, part)
    command, way, path = cycle.before(0, 1.0)
    assert command == part.t[0]
    assert way == pytest.approx(0.01 * part.v[0])
    assert path > 0.0


def test_sag_from_rest_is_down(found):
    at_rest = found.search.stop(StopCase(MachineKind(False, 1.0), 0))
    assert (at_rest.sag > 0.0).all()
    assert found.axes[0].sag >= at_rest.sag[0]
    moving = found.search.stop(StopCase(MachineKind(False, 1.0), 6))
    assert np.isnan(moving.sag).all()


def test_a_brake_whose_largest_torque_is_not_known_is_taken_as_twice_as_strong():
    """`braked` states twice the least torque, so leaving it out changes no peak of a gear."""
    stated = braked(load=False)
    drives = [
        {"joint": d.name, "transmission": d.transmission.model_dump(exclude_unset=True)}
        for d in stated.drives
    ]
    for drive in drives:
        del drive["transmission"]["brake"]["torque_max"]
    silent = stated.with_(actuators=drives)
    case = StopCase(MachineKind(True, 0.0), 6)
    known, taken = (pf.stop(scene, swing(scene, 13)) for scene in (stated, silent))
    np.testing.assert_array_equal(taken.search.stop(case).peak, known.search.stop(case).peak)
    assert "lift, elbow: gears' peaks by 2 x `torque`" in " ".join(taken.notes)
    assert not any("gears' peaks" in note for note in known.notes)


def test_criteria_of_the_brake(found):
    torque, energy, often, gear, _ = found.axes[0].criteria
    hold = max(np.abs(hold[:, 0]).max() for hold in found.search.cycle.hold.values())
    assert torque.required == pytest.approx(hold / 80.0)
    assert torque.available == 0.8
    assert energy.required == found.axes[0].energy
    assert energy.available == 2.0
    assert energy.status == Status.FAILS
    assert gear.required == pytest.approx(1.3 * found.axes[0].peak)
    assert "momentary_peak of the transmission" in gear.note
    assert often.status == Status.NOT_CHECKED
    assert "stops.per_hour" in often.note
    assert any("brake energy" in line for line in found.unmet)
    with pytest.raises(StopError, match="lift: brake energy of a stop: needs"):
        found.check()


def test_category_1_brakes_under_power_and_spares_the_brake():
    decelerated = {"category": 1, "deceleration": {"lift": 8.0, "elbow": 10.0}}
    scene = braked(load=False, **decelerated, along_path=False)
    told = []
    found = pf.stop(scene, swing(scene, 9), progress=lambda *counts: told.append(counts))
    assert told[0][0] == 0 < told[0][1]  # of how many, before the first is done
    assert [done for done, _ in told] == list(range(len(found.search.found) + 1))
    assert "each axis brakes by itself, so the tool leaves its path" in found.notes
    assert max(axis.energy for axis in found.axes) < 0.1
    (taken,) = braking(found.search.machines, found.trajectory)
    for sample in range(9):
        begin = found.search.motion(StopCase(MachineKind(True, 0.0), sample)).effort[0]
        worst = np.maximum(np.abs(taken.effort_lower), np.abs(taken.effort_upper))[sample]
        assert np.abs(begin) == pytest.approx(worst)
    for axis, d, v in zip(found.axes, (8.0, 10.0), (np.pi, 1.4 * np.pi), strict=True):
        assert axis.travel == pytest.approx(v**2 / 2 / d + 0.01 * v, rel=0.03)
        (limit,) = (c for c in axis.criteria if c.name == "effort of braking")
        assert limit.required == axis.braking
        assert axis.braking < 0.5 * axis.peak  # the brakes' snap comes after it
        assert limit.status == Status.NOT_CHECKED


@pytest.mark.slow
def test_category_1_stays_on_the_path_unless_each_axis_stops_by_itself():
    """The swing is straight in the joints, lift = -0.9 - elbow/1.4: so is every stop."""
    decelerated = {"category": 1, "deceleration": {"lift": 8.0, "elbow": 10.0}}
    scene = braked(load=False, **decelerated)
    motion = swing(scene, 201)
    found = pf.stop(scene, motion)
    for _, one in found.worst_motions:
        under_power = one.t <= one.power_off
        lift, elbow = one.q[under_power].T
        assert lift == pytest.approx(-0.9 - elbow / 1.4, abs=1e-4)
        assert one.v[one.t < one.power_off].all()  # all axes stop together
        last = one.q[under_power][-1]
        nearest = np.abs(motion.q - last).sum(axis=1).min()
        assert nearest < 0.02  # where the cycle comes through
    alone = pf.stop(scene.with_(stops=scene.stops.model_copy(update={"along_path": False})), motion)
    left = [
        np.abs(one.q[:, 0] + 0.9 + one.q[:, 1] / 1.4)[one.t <= one.power_off].max()
        for _, one in alone.worst_motions
    ]
    assert min(left) > 0.05
    assert any("all axes stop together" in line for line in found.notes)


def test_category_1_by_the_efforts_limits():
    scene = braked(load=False, category=1)
    model = scene.model.copy()
    model.effortLimit = np.array([120.0, 60.0])
    limited = scene.with_(model=model)
    strong, weak = (pf.stop(limited, swing(scene, 5), category=c) for c in (1, 0))
    assert strong.longest.time < weak.longest.time
    assert (strong.settings.category, weak.settings.category) == (1, 0)
    with pytest.raises(StopError, match=r"\(lift\): the URDF has no effort limit.*deceleration"):
        pf.stop(scene, swing(scene, 5))


#: Of a motion at 1 rad/s for 1 s, stopped in 0.07 rad or, under power at 4 rad/s^2, in 0.135 rad.
LIMITED = {
    "far enough": (1.0, {"category": 0}, (-1.0, 1.08), (0.07, 0.09), ""),
    "upper": (
        1.0,
        {"category": 0},
        (-1.0, 1.02),
        (0.07, 0.03),
        "upper limit of 1.02 rad by 0.04",
    ),
    "lower": (
        -1.0,
        {"category": 0},
        (-1.02, 1.0),
        (0.07, 0.03),
        "lower limit of -1.02 rad by 0.04",
    ),
    "category 1": (
        *(1.0, {"category": 1, "deceleration": {"axis": 4.0}}, (-1.0, 1.1)),
        *((0.135, 0.11), "its upper limit of 1.1 rad by 0.025"),
    ),
}


@pytest.mark.parametrize("name", LIMITED)
def test_a_stop_past_a_joints_limit_by_hand(name):
    """The worst is that of the last sample; the reaction of 0.01 s lies before it."""
    speed, stops, limits, (way, room), said = LIMITED[name]
    table = turntable(brake={"torque": 0.5, "engage_time": 0.04})
    model = table.model.copy()
    model.lowerPositionLimit, model.upperPositionLimit = np.array([[x] for x in limits])
    scene = table.with_(model=model, stops={"reaction_time": 0.01, **stops})
    t = np.linspace(0.0, 1.0, 101)
    rate, still = np.full((101, 1), speed), np.zeros((101, 1))
    found = pf.stop(scene, pf.Trajectory.from_arrays(scene, t, speed * t[:, None], rate, still))
    (limit,) = (c for c in found.criteria if c.name == "position limit")
    assert limit.required == pytest.approx(way, rel=2e-5)
    assert limit.available == pytest.approx(room, rel=1e-9)
    assert [said in line for line in found.unmet] == ([True] if said else [])
    past_the_end = any("the trajectory ends at speed" in line for line in found.notes)
    assert past_the_end == (name == "category 1")
    if said:
        assert "commanded at 0.99 s (sample 100), carrying nothing" in found.unmet[0]


def without(scene, **change):
    """The scene with other keys of its drives' transmissions."""
    drives = [
        {"joint": a.joint, "transmission": {**a.transmission.model_dump(), **change}}
        for a in scene.actuators
    ]
    return scene.with_(actuators=drives)


def test_what_is_missing_is_named_with_what_to_give():
    scene = braked()
    motion = swing(scene, 5)
    for wrong, said in (
        (scene.with_(stops=None), "no `stops` section.*add `stops: {category: 0, reaction_time"),
        (scene.with_(actuators=None), r"\(lift\): has no `transmission`.*`ratio: 1`"),
        (
            without(scene, brake={"torque": 1.0}),
            r"\(lift\)\.transmission\.brake: has no `engage_time`; give the time",
        ),
        (
            without(scene, brake={"torque": 1.0, "engage_time": 30.0}),
            r"brake: engage_time is 30 s; should be at most 5 s \(30 ms is 0.03\)",
        ),
        (
            without(scene, brake=None),
            r"\(lift\): has no brake, and carrying nothing its load of .* N m at .* engage_time: s",
        ),
        (braked(category=1, deceleration={"lift": 1.0}), "no value for elbow"),
        (
            braked(category=1, deceleration={"lift": 1.0, "elbo": 1.0}),
            "no drive 'elbo'.*did you mean 'elbow'",
        ),
    ):
        with pytest.raises(StopError, match=said):
            pf.stop(wrong, motion)
    with pytest.raises(TrajectoryError, match="lasts 1 s, less than the reaction_time 2 s"):
        pf.stop(braked(reaction_time=2.0), motion)
    with pytest.raises(pf.PinfricError, match=r"least factor.*swap them"):
        braked(friction=[1.2, 0.8])
    with pytest.raises(pf.PinfricError, match="`deceleration` is for category 1"):
        braked(deceleration={"lift": 1.0, "elbow": 1.0})
    with pytest.raises(pf.PinfricError, match=r"torque_max 1 N m is less than torque 2 N m"):
        without(scene, brake={"torque": 2.0, "torque_max": 1.0})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"brake": None}, r"lift: M [+] G, chosen for it, has no brake, and carrying nothing its"),
        (  # light and without losses: nothing stops it
            {"brake": None, "efficiency": 1.0, "back_efficiency": 1.0, "no_load_torque": 0.0},
            r"lift: M [+] G, chosen for it, has no brake",
        ),
    ],
)
def test_a_missing_brake_is_that_of_the_chosen_product(change, says):
    """The scene may have one: what lacks it is what `size` chose."""
    scene = without(braked(), **change)
    motion, settings = swing(scene, 5), stop_settings(scene, None)
    machines = Machines(scene, settings, (), dict.fromkeys(scene.actuator_names, "M + G"))
    with pytest.raises(StopError, match=says):
        stops_of(machines, motion)
    with pytest.raises(StopError, match="has no brake") as of_the_scene:
        pf.stop(scene, motion)
    assert "chosen for it" not in str(of_the_scene.value)


def test_losses_scale_exactly():
    """Least and greatest friction: a maker's curve, back driving and no-load torque alike."""
    from pinfric.model.drives import gear_table
    from pinfric.model.transmission import Transmission

    curve = [[8, 0.52], [20, 0.7], [34, 0.78]]
    gear = Transmission(
        ratio=50.0,
        efficiency={"over_load": curve, "speed": 100.0},
        back_efficiency={"starting_torque": 0.02, "back_driving_torque": 2.0},
        no_load_torque={"static": 0.02, "kinetic": 0.015},
        motor_viscous=1e-5,
    )
    one, half = (gear_table([x], [0.0]) for x in (gear, gear.with_losses(0.5)))
    for name in ("no_load", "no_load_static", "viscous", "loss", "slope"):
        assert getattr(half, name) == pytest.approx(0.5 * getattr(one, name), rel=1e-9)


@pytest.fixture
def files(tmp_path):
    """A scene file of a pendulum with a brake, and its motion."""
    scene = pf.load_scene("pendulum")
    text = f"""pinfric: 1
robot: {{urdf: {scene.robot.urdf}}}
actuators:
  - joint: joint_1
    transmission:
      ratio: 20
      rotor_inertia: 1.0e-5
      brake: {{torque: 2.0, engage_time: 0.02, stop_energy: 50.0, stops_per_hour: 20}}
stops: {{category: 0, reaction_time: 0.01, per_hour: 4}}
"""
    (tmp_path / "scene.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def test_the_command_prints_and_writes(files, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    given = ["stop", str(files / "scene.yaml"), "pendulum", "--out", str(files / "out")]
    said = told(capsys, *given).out
    assert_printed(__file__, "stop", said)
    assert set(results_in(files / "out")) == {
        "report.html",
        "stop.pdf",
        "stop.png",
        "summary.json",
    }
    page = (files / "out" / "report.html").read_text(encoding="utf-8")
    assert "farthest stop" in page
    assert page.count("<svg") == 2
    result = result_of((files / "out" / "summary.json").read_text(encoding="utf-8"))
    assert result["axes"][0]["energy"] > 0.0
    assert len(result["axes"][0]["criteria"]) == 5
    json.dumps(result, allow_nan=False)


def test_the_result_shows_itself(found):
    table = found.summary()
    assert list(table.index) == list(NAMES)
    assert table.travel.min() > 0.0
    assert len(found.plot().axes) == 4
    assert "category 0" in repr(found)


@pytest.mark.slow
def test_the_guide_prints_what_the_bundled_scene_gives(capsys):
    """In 80 columns, as for a reader who types the line above."""
    page = (ROOT / "notebooks/guide/stop.md").read_text(encoding="utf-8")
    typed, printed = re.search(
        r"```bash\npinfric (stop [^\n]*)\n```\n\n```text\n(.*?)```", page, re.S
    ).groups()
    assert printed in told(capsys, *typed.split()).out
