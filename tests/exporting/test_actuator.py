"""Actuator models of a scene's friction: their errors, their law, and what they are worth."""

import json
import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump
from cli_cases import refused, run, told
from envelopes import result_of
from export_cases import moved, planar, rich
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.samples.random_states import random_states
from pinfric.errors import PinfricError
from pinfric.exporting.actuator_law import MODELS, bias, friction_budget
from pinfric.exporting.cpp import body_rows
from pinfric.exporting.export import FORMATS

BUNDLED = [
    pytest.param(name, marks=pytest.mark.slow)
    for name in ("ur10_machine_tending", "ur5_pick_and_place", "panda_pick_and_place")
]


ROOT = Path(__file__).parents[2]


def geared(efficiency=0.8, **friction):
    """A heavy pendulum behind a gear that loses a share of what it transmits."""
    gear = {"ratio": 50.0, "rotor_inertia": 1e-4}
    if efficiency < 1.0:
        gear |= {"efficiency": efficiency, "back_efficiency": 2.0 - 1.0 / efficiency}
    model = chain(("hinge", pin.JointModelRY(), lump(3.0, (0.4, 0.0, 0.0), 0.05)))
    return pf.Scene(
        model,
        friction={"hinge": dry(2.0, 1.5, **friction)},
        actuators=[{"joint": "hinge", "transmission": gear}],
        source="geared.yaml",
    )


def forms(scene, trajectory=None):
    made = pf.export(scene, trajectory, "actuator")
    return made, {(form.joint, form.model): form for form in made.forms}


def test_m1_of_constant_friction_is_that_friction():
    made, found = forms(geared(1.0, viscous={"coefficient": 0.7}))
    plain = found["hinge", "m1"].parameters
    two = found["hinge", "m2"]
    assert two.taken  # break-away is a quarter of the friction above that in motion
    assert two.rest_rms < 0.01
    assert plain["friction_base"] == pytest.approx(1.75, abs=0.26)  # between motion and rest
    for key, value in {"friction_base": 1.5, "friction_stribeck": 0.5}.items():
        assert two.parameters[key] == pytest.approx(value, abs=0.02)
    assert two.parameters["friction_viscous"] == pytest.approx(0.7, abs=0.02)
    (row,) = json.loads(made.text)["joints"]
    assert row["armature"] == pytest.approx(0.25)  # 50^2 1e-4
    assert row["break_away"] == pytest.approx(2.0, abs=0.02)
    assert row["frictionloss"] == plain["friction_base"]


def test_the_loss_of_a_gear_is_the_motors_load_friction():
    """A driving motor loses .2 of its torque; at a load that it holds M5's factors act together."""
    made, found = forms(geared(0.8))
    five = found["hinge", "m5"]
    assert five.taken
    assert five.pushed_rms < 0.3 * found["hinge", "m4"].pushed_rms
    lost = five.parameters["load_friction_motor"] + five.parameters["load_friction_external"]
    assert lost == pytest.approx(0.2, abs=0.03)
    assert "m5" in made.text


@pytest.mark.parametrize("name", ["so101", *BUNDLED])
def test_each_form_says_its_error_and_the_simplest_that_is_near_is_taken(name):
    scene = pf.load_scene(name)
    made, found = forms(scene)
    q, v, a = random_states(scene)
    result, gears = pf.inverse_dynamics(scene, q, v, a), scene.gears()
    motor = result.joint_effort_lower
    rotors = gears.ratio**2 * gears.rotor_inertia * a
    lost = np.sign(v) * (motor - rotors - result.effort_frictionless)
    moving = motor == result.joint_effort_upper
    bodies = [fields for _, fields in body_rows(scene)]
    gravity = scene.model.gravity.linear
    pull = -np.array([bias(bodies, gravity, *x) for x in zip(q, v, strict=True)])
    law = pf.actuator_law(scene, made)
    for x in range(5):
        for j, joint in enumerate(scene.actuator_names):
            (form,) = (form for form in made.forms if form.joint == joint and form.taken)
            known = friction_budget(form.parameters, v[x, j], motor[x, j], pull[x, j])
            assert [y[j] for y in law(q[x], v[x], motor[x])] == [*known]
    for j, joint in enumerate(scene.actuator_names):
        own = [found[joint, model] for model in MODELS]
        for form in own:
            of = (x[moving[:, j], j] for x in (v, motor, pull))
            budget, damping = friction_budget(form.parameters, *of)
            missed = budget + damping * np.abs(v[moving[:, j], j]) - lost[moving[:, j], j]
            assert form.error_rms == pytest.approx(np.sqrt(np.mean(missed**2)), rel=1e-6)
            assert form.error_peak == pytest.approx(np.abs(missed).max(), rel=1e-6)
        (taken,) = (k for k, form in enumerate(own) if form.taken)
        whole = [np.hypot(np.hypot(x.error_rms, x.pushed_rms), x.rest_rms) for x in own]
        assert all(whole[taken] < x for x in whole[:taken])
        assert whole[taken] <= max(0.1 * own[0].friction_rms, 1.1001 * min(whole))


def random_motion(scene, count, seed=3):
    rng, nv = np.random.default_rng(seed), scene.model.nv
    return (rng.uniform(-1, 1, (count, nv)) * size for size in (1.0, 1.0, 3.0))


@pytest.mark.parametrize("scene", [lambda: rich(3, mimic=True), lambda: pf.load_scene("ur10")])
def test_the_bias_is_pinocchios(scene):
    scene, rng = scene(), np.random.default_rng(1)
    model, bodies = scene.loaded_model(), [fields for _, fields in body_rows(scene)]
    data, zero = model.createData(), np.zeros(model.nv)
    followers = [j for j in list(model.joints)[1:] if j.shortname() != "JointModelMimic"]
    for _ in range(10):
        numbers, v = rng.uniform(-1, 1, (2, model.nv))
        q = np.zeros(model.nq)
        for joint in followers:
            x = numbers[joint.idx_v]
            q[joint.idx_q : joint.idx_q + joint.nq] = x if joint.nq == 1 else (np.cos(x), np.sin(x))
        known = pin.rnea(model, data, q, v, zero)
        found = bias(bodies, model.gravity.linear, numbers, v)
        assert_allclose(found, known, atol=1e-12 * np.abs(known).max())


def test_the_guide_shows_these_errors():
    page = (ROOT / "notebooks/guide/engines.md").read_text(encoding="utf-8")
    made = pf.export(pf.load_scene("ur10_machine_tending"), to="actuator").forms
    for model in MODELS:
        own = [form for form in made if form.model == model][:4]
        cells = [f"**{x.error_rms:.2g}**" if x.taken else f"{x.error_rms:.2g}" for x in own]
        assert re.search(rf"\| {model.upper()} \| [^|]+ \| {re.escape(' | '.join(cells))} \|", page)
    assert f"| friction | | {' | '.join(f'{x.friction_rms:.2g}' for x in own)} |" in page


def test_the_law_is_the_published_one():
    """By hand: F of each model at one state, stribeck coefficient 1/e."""
    whole = {
        "friction_base": 1.0,
        "friction_viscous": 0.5,
        "friction_stribeck": 2.0,
        "dtheta_stribeck": 0.3,
        "alpha": 1.0,
        "load_friction_base": 0.1,
        "load_friction_stribeck": 0.2,
        "load_friction_motor": 0.3,
        "load_friction_external": 0.4,
        "load_friction_motor_stribeck": 0.5,
        "load_friction_external_stribeck": 0.6,
        "load_friction_motor_quad": 0.01,
        "load_friction_external_quad": 0.02,
    }
    motor, external, s = 7.0, -3.0, np.exp(-1.0)
    expected = {
        "m1": 1.0,
        "m2": 1.0 + 2.0 * s,
        "m3": 1.0 + 0.1 * 10.0,
        "m4": 1.0 + 0.1 * 10.0 + s * (2.0 + 0.2 * 10.0),
        "m5": 1.0 + (1.2 + 2.1) + s * (2.0 + 1.8 + 3.5),
        "m6": 1.0 + (1.2 + 2.1) + s * (2.0 + 1.8 + 3.5 + 0.02 * 9.0),
    }
    for model, keys in MODELS.items():
        own = {key: whole[key] for key in keys}
        found, damping = friction_budget(own, np.array(-0.3), motor, external)
        assert found == pytest.approx(expected[model])
        assert damping == 0.5
    own = {key: whole[key] for key in MODELS["m6"]}
    driven = 1.0 + abs(0.4 * 7.0 + 0.3 * 3.0) + s * (2.0 + 0.6 * 7.0 + 0.5 * 3.0 + 0.01 * 9.0)
    assert friction_budget(own, 0.3, -3.0, 7.0)[0] == pytest.approx(driven)
    alike = 1.0 + abs(0.4 * 7.0 - 0.3 * 3.0) + s * (2.0 + 0.6 * 7.0 - 0.5 * 3.0)
    assert friction_budget(own, 0.3, 3.0, 7.0)[0] == pytest.approx(alike)  # no signs that differ


@pytest.mark.slow
def test_jax_computes_the_same_compiled_and_over_environments():
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    try:
        scene = pf.load_scene("ur10_machine_tending")
        made = pf.export(scene, to="actuator")
        q, v, motor = random_motion(scene, 50)
        plain, law = pf.actuator_law(scene, made), pf.actuator_law(scene, made, jax.numpy)
        known = np.array([plain(*x) for x in zip(q, v, 10.0 * motor, strict=True)])
        found = jax.jit(jax.vmap(law))(q, v, 10.0 * motor)
        assert_allclose(np.stack(found, axis=1), known, rtol=1e-6, atol=1e-9)
        slope = jax.jacobian(lambda x: law(q[0], v[0], x)[0].sum())(10.0 * motor[0])
        assert np.isfinite(slope).all()
        assert np.abs(slope).max() > 0.0
    finally:
        jax.config.update("jax_enable_x64", before)


@pytest.mark.slow
def test_random_rollouts_with_the_models_are_nearer_than_with_constants(tmp_path):
    """As a trainer's loop: budgets from the file are set in MuJoCo before every step."""
    mujoco = pytest.importorskip("mujoco")
    scene = pf.load_scene("ur10_machine_tending").with_(payloads={})
    pf.export(scene, to="actuator").write(tmp_path / "ur10.json")
    rows = json.loads((tmp_path / "ur10.json").read_text())["joints"]
    xml, law = pf.export(scene).text, pf.actuator_law(scene, tmp_path / "ur10.json")
    rng, ratio = np.random.default_rng(11), np.array([d.ratio for d in scene.drives])
    starts = rng.uniform(-1.0, 1.0, (6, 6)) + np.array([0.0, -1.2, 1.0, -1.0, -1.0, 0.0])
    pushes = rng.uniform(-1.0, 1.0, (6, 5, 6)) * [60.0, 60.0, 40.0, 8.0, 8.0, 8.0]

    def rollout(step, model, start, push):
        data = mujoco.MjData(model)
        data.qpos[:] = start
        mujoco.mj_forward(model, data)
        step.start(data) if hasattr(step, "start") else None
        for k in range(500):
            data.ctrl[:] = (data.qfrc_bias + push[k // 100]) / ratio
            (step.step if hasattr(step, "step") else step)(data)
        return data.qpos.copy()

    def plain():
        model = mujoco.MjModel.from_xml_string(xml)
        model.opt.timestep = 1e-3
        model.dof_armature[:] = [row["armature"] for row in rows]
        return model

    true, trained, fixed = plain(), plain(), plain()
    friction = pf.mujoco_friction(scene, true)
    fixed.dof_frictionloss[:] = [row["frictionloss"] for row in rows]
    fixed.dof_damping[:] = [row["damping"] for row in rows]

    def with_models(data):
        motor = data.ctrl * ratio
        budget, damping = law(data.qpos, data.qvel, motor)
        trained.dof_frictionloss[:], trained.dof_damping[:] = budget, damping
        mujoco.mj_step(trained, data)

    errors = []
    for start, push in zip(starts, pushes, strict=True):
        known = rollout(friction, friction.model, start, push)
        models = rollout(with_models, trained, start, push)
        constants = rollout(lambda data: mujoco.mj_step(fixed, data), fixed, start, push)
        errors.append([np.abs(x - known).max() for x in (models, constants)])
    models, constants = np.median(errors, axis=0)
    assert models < 0.5 * constants
    page = (ROOT / "notebooks/guide/engines.md").read_text(encoding="utf-8")
    assert f"the models end within {models:.3f} rad of" in page
    assert f"constants within {constants:.3f} (medians" in page


def test_a_joint_that_never_moves_and_a_gear_that_locks_have_models():
    scene = geared(1.0)
    t = np.linspace(0.0, 1.0, 50)
    zero = np.zeros((50, 1))
    still = pf.Trajectory.from_arrays(scene, t, zero, zero, zero)
    assert {form.model for form in pf.export(scene, still, "actuator").forms} == {*MODELS}
    gear = {"ratio": 40.0, "efficiency": 0.4, "back_efficiency": -0.4}
    locking = scene.with_(actuators=[{"joint": "hinge", "transmission": gear}])
    assert any(form.taken for form in pf.export(locking, to="actuator").forms)


def test_the_command_writes_the_file_and_refuses_what_it_does_not_hold(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    out = told(capsys, "export", "pendulum", "--to", "actuator").out
    assert "m1" in out
    assert "*" in out
    found = result_of(told(capsys, "export", "pendulum", "--to", "actuator", "--json").out)
    assert [form["model"] for form in found["forms"]] == [*MODELS]
    file = Path("pendulum.actuator.json")
    content = json.loads(file.read_text())
    assert content["joints"][0]["take"] in MODELS
    assert "is what `pinfric export` found" in refused(capsys, "check", str(file))
    assert run("export", "four_bar", "--to", "actuator", "--out", "none.json") == 2
    with pytest.raises(PinfricError, match="3 degrees of freedom"):
        pf.export(planar(), to="actuator")
    with pytest.raises(PinfricError, match="is coupled with another joint"):
        pf.export(rich(7, couples=True), to="actuator")
    assert not Path("none.json").exists()
    scene = pf.load_scene("pendulum")
    with pytest.raises(PinfricError, match="export this scene"):
        pf.actuator_law(pf.load_scene("three_link"), file)
    file.write_text("{")
    with pytest.raises(PinfricError, match="is no file of `pinfric export --to actuator`"):
        pf.actuator_law(scene, file)
    with pytest.raises(PinfricError, match="cannot be read"):
        pf.actuator_law(scene, "absent.json")


def test_along_a_motion_the_errors_are_those_of_the_motion():
    scene = geared(0.8)
    made, found = forms(scene, moved(scene))
    assert "200 samples" in made.text
    assert found["hinge", "m1"].error_rms != forms(scene)[1]["hinge", "m1"].error_rms
    assert FORMATS["actuator"].suffix == ".actuator.json"
