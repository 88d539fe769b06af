"""Samples as sums of stored cycles: the figures of inverse dynamics, or inverse dynamics itself."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from builders import dry
from numpy.testing import assert_array_equal
from sweep_cases import pushed_block, steady, sweep_of, uniform

import pinfric as pf
from pinfric.errors import PinfricError
from pinfric.model.entry import NonNegative
from pinfric.model.friction_terms import (
    TERMS,
    FrictionTerm,
    Row,
    Shape,
    Strength,
    Stribeck,
    friction_term,
)
from pinfric.sweeps.cycle import FIGURES, Study, compute, cycle_figures
from pinfric.sweeps.file import load_sweep
from pinfric.sweeps.motors import NOT_CHECKED, motors_on_trial
from pinfric.sweeps.parameters import draw, resolve
from pinfric.sweeps.superposition import Superposition

PIN = {"kind": "pin", "radius": 0.03, "length": 0.1, "thrust_radius": 0.02}
DIRECTED = {
    "positive": {"static": 0.4, "kinetic": 0.3},
    "negative": {"static": 0.2, "kinetic": 0.1},
}
GEAR = {
    "ratio": -80.0,
    "efficiency": 0.8,
    "back_efficiency": -0.2,
    "no_load_torque": DIRECTED,
    "motor_viscous": {"coefficient": 1e-4, "exponent": 0.7},
    "rotor_inertia": 1e-5,
}


def arm():
    """A Panda with kind of term and gear, two payloads."""
    whole = pf.load_scene("panda_pick_and_place")
    box = whole.payloads["box"].model_dump()
    names = [*whole.joint_names[:3], *whole.joint_names[4:6]]
    rubbing = {
        "bearing": PIN,
        "mu": {"static": 0.02, "kinetic": 0.01},
        "coulomb": DIRECTED,
        "stribeck": {"velocity": 0.3},
        "viscous": {"coefficient": 0.4, "exponent": 0.6},
    }
    friction = {**dict.fromkeys(names, rubbing), names[1]: {"viscous": 2.0}}
    drives = [
        {"joint": n, "transmission": GEAR if k in (1, 4) else None}
        for k, n in enumerate(whole.joint_names)
    ]
    return whole.with_(
        friction=friction, actuators=drives, payloads={"box": box, "tool": {**box, "mass": 0.7}}
    )


def swing(scene, samples=40):
    """Every joint swings, rests and turns; one payload is let go on the way."""
    t = np.linspace(0.2, 1.7, samples)
    phase = np.linspace(0.0, 2.0, scene.model.nv)
    v = np.sin(4.0 * t[:, None] + phase)
    v[5:9, 1] = 0.0
    q = 0.4 * np.cos(3.0 * t[:, None] + phase) + [0.1, 0.1, 0.1, -1.0, 0.1, 1.0, 0.1]
    return pf.Trajectory.from_arrays(
        scene, t, q, v, np.cos(t[:, None] * phase), {"box": t < 1.0, "tool": True}
    )


def study_of(scene, motion, samples=4, **parameters):
    entries, source = load_sweep(sweep_of(samples, **parameters))
    targets = resolve(scene, entries, source)
    return Study(scene, motion, targets), draw(targets, entries)


def figures(study, rows, values):
    """(k, na, number of `FIGURES`)."""
    return compute(study, values[rows]).figures


def assert_equal_to_inverse_dynamics(study, values):
    rows = np.arange(len(values))
    general = np.array([cycle_figures(study, sample)[0] for sample in values])
    scale = np.abs(general).max(axis=(0, 1))
    assert (np.abs(figures(study, rows, values) - general) <= 1e-12 * scale).all()
    assert list(compute(study, values).problems) == [""] * len(values)


ALL = {
    "friction.*.mu": uniform(0.0, 3.0),
    "friction.*joint1.mu": uniform(0.5, 2.0),
    "friction.*.coulomb": uniform(0.0, 2.0, each=True),
    "friction.*.coulomb.negative": uniform(0.5, 2.0),
    "friction.*.viscous": uniform(0.0, 2.0),
    "transmission.*.no_load_torque": uniform(0.5, 2.0),
    "transmission.*joint2.no_load_torque.positive": uniform(0.0, 2.0),
    "transmission.*.motor_viscous": uniform(0.5, 2.0),
    "transmission.*joint5.rotor_inertia": uniform(0.5, 2.0),
    "payload.box.mass": uniform(0.5, 4.0),
    "payload.box.com.x": uniform(-0.3, 0.3),
    "payload.box.com.y": uniform(-0.3, 0.3),
    "payload.box.com.z": uniform(-0.3, 0.3),
    "payload.tool.com.y": uniform(-0.3, 0.3),
    "speed": uniform(0.5, 2.0),
    "mounting.roll": uniform(-1.0, 1.0),
    "mounting.pitch": uniform(-1.0, 1.0),
}


@pytest.mark.parametrize(
    "names",
    [
        list(ALL),
        ["speed"],
        ["mounting.pitch"],
        ["payload.box.mass"],
        ["payload.tool.com.y"],
        ["friction.*.coulomb.negative"],
        ["transmission.*.motor_viscous"],
    ],
    ids=lambda names: names[0] if len(names) == 1 else "all",
)
def test_figures_are_those_of_inverse_dynamics(names):
    scene = arm()
    study, values = study_of(scene, swing(scene), **{name: ALL[name] for name in names})
    assert study.superposition is not None
    assert_equal_to_inverse_dynamics(study, values)


def test_figures_do_not_depend_on_the_batch():
    scene = arm()
    study, values = study_of(scene, swing(scene), **ALL)
    whole = figures(study, np.arange(4), values)
    parts = [figures(study, rows, values) for rows in ([2], [0, 3, 1])]
    assert_array_equal(np.concatenate(parts), whole[[2, 0, 3, 1]])
    with ThreadPoolExecutor(2) as threads:  # a worker of a cluster may have several
        found = list(threads.map(lambda _: figures(study, np.arange(4), values), range(8)))
    assert_array_equal(found, [whole] * 8)


def test_scenes_without_bearings_or_friction_are_sums_too():
    for friction in ({}, {"panda_joint2": dry(2.0, 1.0)}):
        scene = arm().with_(friction=friction)
        study, values = study_of(
            scene, swing(scene), speed=ALL["speed"], payload__box__mass=ALL["payload.box.mass"]
        )
        assert study.superposition is not None
        assert_equal_to_inverse_dynamics(study, values)


def test_what_is_no_sum_is_left_to_inverse_dynamics():
    scene, drawer = arm(), pf.load_scene("drawer")
    motion, speed = swing(scene), {"speed": uniform(0.5, 2.0)}
    guide = {"bearing": {"kind": "guide", "length": 0.2}, "mu": {"static": 0.1, "kinetic": 0.1}}
    two = [*scene.actuators, {"joint": scene.joint_names[0], "name": "second", "share": 1.0}]
    for given, moved, parameters in (
        (scene, motion, {"transmission.*.efficiency": uniform(0.5, 0.9)}),
        (pushed_block(friction={"slide": guide}), steady(pushed_block()), speed),
        (drawer, pf.load_trajectory("drawer", drawer), speed),
        (scene.with_(actuators=two), motion, speed),
    ):
        study, _ = study_of(given, moved, **parameters)
        assert study.superposition is None
    makers = {**GEAR, "no_load_torque": 0.01, "efficiency": {"rated": 0.7, "load": 90.0}}
    drives = [{"joint": name, "transmission": makers} for name in scene.joint_names]
    geared = scene.with_(actuators=drives)
    for parameters, linear in (
        (speed, True),
        ({"transmission.*.no_load_torque": uniform(0.5, 1.0)}, False),
    ):
        study, _ = study_of(scene, motion, **parameters)
        assert (Superposition.of(geared, motion, study.targets) is not None) == linear


def test_a_term_whose_class_scales_it_otherwise_is_no_sum():
    @friction_term("grease")
    class Grease(FrictionTerm):
        coefficient: NonNegative

        def rows(self, stribeck: Stribeck | None) -> tuple[Row, ...]:
            return ((Shape(power=0.5), Strength(0.0, self.coefficient, self.coefficient)),)

    @friction_term("warmed")
    class Warmed(Grease):
        def scaled(self, factor: float) -> "Warmed":
            return self.model_copy(update={"coefficient": factor**0.5 * self.coefficient})

    try:
        for key, linear in (("grease", True), ("warmed", False)):
            scene = arm().with_(friction={"panda_joint2": {key: {"coefficient": 3.0}}})
            study, values = study_of(
                scene, swing(scene), **{f"friction.*.{key}": uniform(0.5, 2.0)}
            )
            assert (study.superposition is not None) == linear
            assert_equal_to_inverse_dynamics(study, values)
            assert len(np.unique(figures(study, np.arange(4), values)[:, 1, 0])) == 4
    finally:
        del TERMS["grease"], TERMS["warmed"]


def test_a_cycle_that_cannot_be_is_refused_as_by_inverse_dynamics():
    scene = arm()
    study, values = study_of(
        scene, swing(scene), speed=uniform(1.0, 2.0), payload__box__mass=uniform(1.0, 2.0)
    )
    values[:] = [[1e-19, 1.0], [1e12, 1.0], [1.0, 1e151], [1.0, 1.0]]
    block = compute(study, values)
    said = []
    for sample in values:
        try:
            cycle_figures(study, sample)
            said.append("")
        except PinfricError as problem:
            said.append(str(problem))
    assert list(block.problems) == said
    assert [bool(text) for text in said] == [True, True, False, False]
    assert np.isfinite(figures(study, [2, 3], values)).all()


def test_one_sample_of_a_motion_is_too_few_to_judge_a_drive_and_that_is_said():
    scene = arm()
    whole = swing(scene)
    one = pf.Trajectory.from_arrays(scene, whole.t[:1], whole.q[:1], whole.v[:1], whole.a[:1])
    study, values = judged_study(scene, one)
    assert "two samples" in compute(study, values).problems[0]


VARIED = "friction.*.mu", "payload.box.mass", "payload.tool.com.y", "speed", "mounting.roll"
TBM, TABLE = "Kollmorgen TBM-6025-A + Harmonic Drive CSG-20-100", "panda_joint2"


def judged_study(scene, motion, drive=TBM, joint=TABLE, varied=VARIED, **more):
    sweep = sweep_of(3, motors={joint: {"drive": drive}}, **{name: ALL[name] for name in varied})
    entries, source = load_sweep(sweep | more)
    equipped, trials = motors_on_trial(scene, entries, source)
    targets = resolve(scene, entries, source)
    return Study(equipped, motion, targets, trials), draw(targets, entries)


def assert_judged_as_on_inverse_dynamics(study, values):
    """Of each criterion and sample the verdict, of each sample the least margin."""
    assert study.superposition is not None
    block = compute(study, values)
    (trial,) = study.trials
    for k, sample in enumerate(values):
        figures, verdicts, *_ = cycle_figures(study, sample)
        named = zip(trial.checks, verdicts, block.verdicts[k], strict=True)
        assert [name for name, alone, summed in named if alone != summed] == []
        margin = trial.actuator, FIGURES.index("margin")
        assert block.figures[k][margin] == pytest.approx(figures[margin], rel=1e-9, abs=1e-11)
    return dict(zip(trial.checks, block.verdicts.T, strict=True))


HEAVY = {"life": 20_000.0, "back_driving": "required", "bus_voltage": 24.0}
FED = {"amplifiers": {TABLE: "maxon EPOS4 50/5"}, "ambient": 60.0}


@pytest.mark.parametrize(
    ("drive", "conditions"),
    [
        (TBM, {}),
        (TBM, HEAVY),
        ("maxon RE 65 353297 + Harmonic Drive CSG-20-100", HEAVY),
        ("maxon EC-i 30 45 W 539482 + Harmonic Drive CSG-20-100", FED),  # thermal runaway
        ("maxon EC 90 flat 244879 + Harmonic Drive CSG-20-100", FED),
        ("maxon EC 90 flat 244879 + Apex AF060 i=50", {"life": 20_000.0}),
        ("CubeMars AK80-64", {"collision_effort": {TABLE: 50.0}}),
        ("RobStride RS00", {"collisions": {"count": 100, "duration": 0.1}}),
    ],
    ids=lambda x: x if isinstance(x, str) else "-".join(x),
)
def test_drives_are_judged_as_on_inverse_dynamics(drive, conditions):
    scene = arm()
    study, values = judged_study(scene, swing(scene), drive, conditions=conditions)
    assert_judged_as_on_inverse_dynamics(study, values)
    assert_equal_to_inverse_dynamics(study, values)


def test_drives_of_joints_without_friction_by_loads_are_judged():
    """Nothing else needs the wrenches of which the bearing's loads are."""
    scene = arm().with_(friction={TABLE: dry(2.0, 1.0)})
    study, values = judged_study(scene, swing(scene), varied=VARIED[1:], conditions=HEAVY)
    verdicts = assert_judged_as_on_inverse_dynamics(study, values)
    assert (verdicts["bearing tilting moment"] != NOT_CHECKED).all()


def test_drives_whose_rows_read_samples_are_left_to_inverse_dynamics():
    scene = arm()
    for drive, by_figures in (
        (TBM, True),
        ("maxon EC 90 flat 244879 + Beckhoff TP004 MF i=4", False),
    ):
        study, values = judged_study(scene, swing(scene), drive)
        assert study.trials[0].by_figures == by_figures
        assert (study.superposition is not None) == by_figures
        assert list(compute(study, values).problems) == [""] * 3


def test_a_section_that_superposition_does_not_know_is_left_to_inverse_dynamics():
    scene = arm()
    motion = swing(scene)
    study, _ = study_of(scene, motion, speed=ALL["speed"])
    unknown = tuple(replace(target, section="bearings") for target in study.targets)
    assert Superposition.of(scene, motion, study.targets) is not None
    assert Superposition.of(scene, motion, unknown) is None


def test_screws_of_sliding_joints_are_judged_as_on_inverse_dynamics():
    scene = pf.load_scene("gantry")
    motion = pf.load_trajectory("gantry", scene)
    for joint, screw in (("z", "16 mm, lead 16 mm"), ("x", "25 mm, lead 25 mm")):
        sweep = sweep_of(
            2,
            motors={joint: {"drive": f"maxon EC 90 flat 244879 + PBSA ball screw {screw}"}},
            speed=uniform(0.5, 1.0),
            payload__tool__mass=uniform(0.5, 4.0),
        )
        entries, source = load_sweep(sweep | {"conditions": {"life": 10_000.0}})
        equipped, trials = motors_on_trial(scene, entries, source)
        targets = resolve(scene, entries, source)
        study = Study(equipped, motion, targets, trials)
        assert_judged_as_on_inverse_dynamics(study, draw(targets, entries))
