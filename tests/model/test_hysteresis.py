"""Friction behind a gear's spring against the hysteresis that its maker states."""

import dataclasses

import numpy as np
import pytest
import yaml

import pinfric as pf
from pinfric.model.friction_terms import CoulombFriction, DirectedCoulombFriction
from pinfric.model.hysteresis import excessive_friction, joint_hysteresis
from pinfric.model.schema import Actuator, Friction
from pinfric.model.springs import spring_of

ARCMIN = np.pi / 180 / 60
LINES = {"k1": 3.1e4, "k2": 5.0e4, "k3": 5.7e4, "t1": 14, "t2": 48}


def actuator(hysteresis: float = ARCMIN, **more: object) -> Actuator:
    gear = {"ratio": 101, "stiffness": LINES, "hysteresis": hysteresis}
    return Actuator(joint="pan", transmission=gear, **more)


def rubs(static: float) -> dict[str, Friction]:
    return {"pan": Friction(coulomb=CoulombFriction(static=static, kinetic=static))}


def test_fifteen_newton_metres_imply_three_arcmin_where_one_is_stated():
    (found,) = excessive_friction(rubs(15.0), [actuator()])
    assert found.implied / ARCMIN == pytest.approx(3.24, abs=0.005)
    assert found.most == pytest.approx(4.51, abs=0.005)
    assert "0.000291 rad (1 arcmin) stated, 0.000943 rad (3.2 arcmin) implied" in found.text
    assert not list(excessive_friction(rubs(4.5), [actuator()]))
    assert not list(excessive_friction({}, [actuator()]))
    assert not list(excessive_friction(rubs(15.0), [actuator(4 * ARCMIN)]))


def test_both_directions_count_and_load_does_not():
    spring = spring_of(1e4)
    directed = DirectedCoulombFriction.model_validate(
        {"positive": {"static": 3.0, "kinetic": 3.0}, "negative": {"static": 1.0, "kinetic": 1.0}}
    )
    entry = Friction.model_validate(
        {"bearing": {"kind": "pin", "radius": 0.05}, "mu": {"static": 0.2, "kinetic": 0.1}}
    )
    loaded = entry.model_copy(update={"coulomb": directed})
    assert joint_hysteresis(spring, loaded) == pytest.approx(4e-4)
    assert joint_hysteresis(spring, entry) == joint_hysteresis(spring, None) == 0.0


def test_coupled_drives_are_left_out():
    other = Actuator(joint="tilt", couples={"pan": 1.0})
    assert not list(excessive_friction(rubs(15.0), [actuator(), other]))


def test_a_scene_file_warns_with_both_figures(tmp_path):
    bundled = pf.load_scene("ur10_machine_tending")
    with open(bundled.source) as file:
        content = yaml.safe_load(file)
    content["friction"]["elbow_joint"]["coulomb"] = {"static": 6.0, "kinetic": 5.0}
    file = tmp_path / "arm.yaml"
    file.write_text(yaml.safe_dump(content))
    with pytest.warns(pf.PinfricWarning) as warned:
        pf.load_scene(file)
    (text,) = (str(w.message) for w in warned)
    assert "arm.yaml: actuators[2].transmission.hysteresis: 0.000291 rad" in text
    assert "0.000387 rad (1.3 arcmin) implied by 6 N m" in text
    report = pf.check(file)
    (finding,) = (f for f in report.findings if f.kind == "hysteresis")
    assert finding.place == "actuators[2].transmission.hysteresis"
    assert finding.excess == pytest.approx(1.33, abs=0.01)


def test_the_bundled_arm_is_split_and_keeps_what_was_identified():
    scene = pf.load_scene("ur10_machine_tending")
    assert not list(excessive_friction(scene.friction, scene.actuators))
    identified = [13.93, 17.17, 9.37, 2.64, 2.80, 3.52]  # means of the scene `ur10`
    for drive, kinetic in zip(scene.actuators, identified, strict=True):
        gear, coulomb = drive.transmission, scene.friction[drive.joint].coulomb
        both = coulomb.kinetic + gear.ratio * gear.no_load_torque.kinetic
        assert both == pytest.approx(kinetic, rel=3e-3)
        static = coulomb.static + gear.ratio * gear.no_load_torque.static
        assert static == pytest.approx(1.2 * kinetic, rel=3e-3)


@pytest.mark.parametrize(("factor", "hertz"), [(1e-3, 0.2), (1.0, None), (3438.0, 500)])
def test_check_asks_about_frequencies_that_no_robot_has(factor, hertz, tmp_path):
    """N m/arcmin entered as N m/rad is 3438 times too soft; the other mistake as much too stiff."""
    bundled = pf.load_scene("ur10_machine_tending")
    with open(bundled.source) as file:
        content = yaml.safe_load(file)
    for entry in content["actuators"]:
        gear = entry["transmission"]
        gear["stiffness"] = factor * float(gear["stiffness"]["k1"])
        del gear["hysteresis"]
    file = tmp_path / "arm.yaml"
    file.write_text(yaml.safe_dump(content))
    found = [f for f in pf.check(file).findings if f.kind == "frequency"]
    assert bool(found) == (hertz is not None)
    if hertz:
        assert "lowest natural frequency" in found[0].found
        assert (float(found[0].found.split()[3]) < 3.0) == (hertz < 3.0)
        said = " ".join(map(str, dataclasses.astuple(found[0])))
        assert ("too small" if hertz < 3.0 else "too large: stiffness in N mm/rad") in said


def test_without_stiffness_check_finds_nothing_new():
    scene = pf.load_scene("ur5_pick_and_place")
    assert not scene.elastic
    assert not [f for f in pf.check(scene.source).findings if f.kind in ("hysteresis", "frequency")]
    assert dataclasses.replace(scene).tool is None


@pytest.mark.parametrize(("arcmin", "unlikely"), [(3.0, False), (5.0, True), (11.0, True)])
def test_more_hysteresis_than_makers_state_is_asked_about(arcmin, unlikely):
    """Ratio 30: below 3 arcmin. 11 passed: the warning began at 34."""
    gear = actuator(arcmin * ARCMIN).transmission
    said = [line for line in gear.questions() if "hysteresis" in line]
    assert bool(said) == unlikely
