"""The compiled friction that MuJoCo calls is that of `step`, in rollouts and threads, too."""

import shutil
from contextlib import ExitStack, nullcontext

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from export_cases import geared, needs_compiler
from mechanisms import pin_friction, shifted
from mujoco.rollout import rollout
from mujoco_bridge import loaded, made, random_motion, slider
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.errors import PinfricError

PHYSICS = mujoco.mjtState.mjSTATE_FULLPHYSICS


def arm():
    return loaded(pf.load_scene("ur10_machine_tending").with_(payloads={}), "tool0", 5.0)


def bar():
    """A bar with a pin that a motor lowers on a floor, and with a stop."""
    body = lump(3.0, [0.5, 0.0, 0.0], 0.1)
    model = chain(("hinge", pin.JointModelRY(), body))
    model.jointPlacements[1] = shifted(0.0, 0.15)
    model.armature[:] = 0.1
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -0.4, 1.0
    model.addBodyFrame("bar", 1, pin.SE3.Identity(), 0)
    friction = {
        "hinge": pin_friction(0.2, 0.02, static=0.3)
        | {"stribeck": {"velocity": 0.1}, "viscous": {"coefficient": 0.2, "exponent": 0.7}}
    }
    gear = {
        "ratio": 50.0,
        "efficiency": {"over_load": [[5, 0.5], [20, 0.7]]},
        "back_efficiency": "same_loss",
        "rotor_inertia": 1e-4,
        "motor_viscous": {"coefficient": 0.003, "exponent": 0.7},
    }
    actuators = [{"joint": "hinge", "transmission": gear}]
    return pf.Scene(model, friction=friction, actuators=actuators, source="bar.yaml")


def bar_on_a_floor(dt=1e-3):
    spec = mujoco.MjSpec.from_string(pf.export(bar()).text)
    spec.option.timestep = dt
    plane, sphere = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_SPHERE
    spec.worldbody.add_geom(type=plane, size=[1, 1, 0.1])
    spec.bodies[1].add_geom(type=sphere, size=[0.05, 0, 0], pos=[1, 0, 0], mass=0)
    return spec


def to_the_floor_and_the_stop(t):
    return np.array([-1.5 * np.sin(8.0 * t) if t < 0.5 else -0.3])


def without_islands(spec):
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    return spec


def a_motion_of(scene, spec, seed=0):
    """The friction, its first state, and the torques of 1 s."""
    friction = pf.mujoco_friction(scene, spec)
    q, torque = random_motion(scene, seed)
    if scene.source == "bar.yaml":
        q, torque = np.zeros(1), to_the_floor_and_the_stop
    data = mujoco.MjData(friction.model)
    data.qpos[friction.dofs] = q
    state = np.empty(mujoco.mj_stateSize(friction.model, PHYSICS))
    mujoco.mj_getState(friction.model, data, state, PHYSICS)
    dt = friction.model.opt.timestep
    return friction, state, np.array([torque((k + 0.5) * dt) for k in range(1000)])


def begun(friction, state, control):
    data = mujoco.MjData(friction.model)
    mujoco.mj_setState(friction.model, data, state, PHYSICS)
    data.ctrl[:] = control
    return data


CASES = {
    "arm": lambda: (arm(), made(arm(), 1e-3)),
    "arm without islands": lambda: (arm(), without_islands(made(arm(), 1e-3))),
    "slider": lambda: (slider(), made(slider(), 1e-3)),
    "bar, floor and stop": lambda: (bar(), bar_on_a_floor()),
}


@needs_compiler
@pytest.mark.parametrize(
    "case", [pytest.param(x, marks=[pytest.mark.slow] * (x != "slider")) for x in CASES]
)
def test_the_callback_is_the_step(case):
    """The same positions and stick states, step by step, and each limit is that of Python's law."""
    friction, state, controls = a_motion_of(*CASES[case]())
    data = begun(friction, state, controls[0])
    friction.start(data)
    places, stuck, hits = [], [], np.zeros(2, dtype=bool)
    for control in controls:
        data.ctrl[:] = control
        friction.step(data)
        places.append(data.qpos.copy())
        stuck.append(friction.sticking(data))
        hits |= data.ncon > 0, data.nl > 0
    assert hits.all() == ("floor" in case)
    assert 0.01 < np.mean(stuck) < 0.95 or case == "slider"
    data = begun(friction, state, controls[0])
    expected = None
    with friction.installed():
        for k, control in enumerate(controls):
            data.ctrl[:] = control
            mujoco.mj_step(friction.model, data)
            assert_allclose(data.qpos, places[k], rtol=0, atol=1e-12)
            assert_array_equal(friction.sticking(data), stuck[k])
            if expected is not None:
                used = data.efc_frictionloss[np.isin(data.efc_id, friction.dofs)][: len(expected)]
                assert_allclose(used, expected, rtol=1e-12)
            expected = friction.limit(data)


@pytest.mark.slow
@needs_compiler
def test_rollouts_in_threads_are_loops():
    """Whatever data a rollout gets: an earlier one with other torques leaves nothing there."""
    friction, state, controls = a_motion_of(*CASES["arm"]())
    several = np.array([controls[:300] * share for share in np.linspace(0.5, 1.5, 9)])
    wanted = []
    for control in several:
        data = begun(friction, state, control[0])
        friction.start(data)
        for now in control:
            data.ctrl[:] = now
            friction.step(data)
        wanted.append(data.qpos.copy())
    model, nq = friction.model, friction.model.nq
    with friction.installed():
        pool = [mujoco.MjData(model) for _ in range(3)]
        for _ in range(2):  # data that were used before, too
            found, _ = rollout(model, pool, np.tile(state, (9, 1)), several, chunk_size=1)
            assert_allclose(found[:, -1, 1 : 1 + nq], wanted, rtol=0, atol=1e-12)
        short, _ = rollout(model, pool[0], np.tile(state, (9, 1)), several[:, :1])
        assert_array_equal(short[:, 0], found[:, 0])


@needs_compiler
def test_forward_between_steps_changes_nothing():
    friction, state, controls = a_motion_of(*CASES["arm"]())
    ends = []
    for calls in (0, 2):
        data = begun(friction, state, controls[0])
        with friction.installed():
            for control in controls[:400]:
                data.ctrl[:] = control
                mujoco.mj_step(friction.model, data)
                for _ in range(calls):
                    mujoco.mj_forward(friction.model, data)
        ends.append(data.qpos.copy())
    assert_allclose(ends[0], ends[1], rtol=0, atol=1e-9)


@needs_compiler
def test_other_models_are_left_alone():
    """Callbacks are global: a model of another robot keeps its constants."""
    friction, other = pf.mujoco_friction(bar(), bar_on_a_floor()), made(arm(), 1e-3).compile()
    ends = []
    for installed in (False, True):
        data = mujoco.MjData(other)
        with friction.installed() if installed else nullcontext():
            for _ in range(100):
                mujoco.mj_step(other, data)
        ends.append(data.qpos.copy())
    assert_array_equal(*ends)


@needs_compiler
def test_another_callback_is_refused_and_ours_is_taken_away():
    friction = pf.mujoco_friction(slider(), made(slider(), 1e-3))
    for name in ("control", "sensor"):
        place = getattr(mujoco, f"set_mjcb_{name}")
        place(lambda *_: None)
        try:
            with pytest.raises(PinfricError, match=f"another mjcb_{name} is set"):
                friction.installed().__enter__()
        finally:
            place(None)
    with (
        pytest.raises(PinfricError, match="this friction is installed already"),
        friction.installed(),
        friction.installed(),
    ):
        pass
    with pytest.raises(ZeroDivisionError), friction.installed():
        1 / 0  # noqa: B018
    assert mujoco.get_mjcb_control() is None
    assert mujoco.get_mjcb_sensor() is None


@needs_compiler
def test_models_that_do_not_call_it_are_refused():
    plain = mujoco.MjModel.from_xml_string(pf.export(slider()).text)
    with pytest.raises(PinfricError, match=r"no sensor 'pinfric_friction'.* mujoco\.MjSpec"):
        pf.mujoco_friction(slider(), plain).installed().__enter__()
    friction = pf.mujoco_friction(slider(), made(slider(), 1e-3))
    for flag in ("ACTUATION", "SENSOR"):
        bit = getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}")
        friction.model.opt.disableflags |= bit
        with pytest.raises(PinfricError, match=f"flag {flag.lower()} is disabled"):
            friction.installed().__enter__()
        friction.model.opt.disableflags ^= bit


def test_without_a_compiler_it_says_so(monkeypatch):
    friction = pf.mujoco_friction(slider(), made(slider(), 1e-3))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(PinfricError, match=r"needs a C\+\+ compiler \(g\+\+, clang\+\+, c\+\+\)"):
        friction.installed().__enter__()


def run(friction, data, count):
    with friction.installed():
        for _ in range(count):
            mujoco.mj_step(friction.model, data)


def change_the_step(friction):
    with friction.installed():
        friction.model.opt.timestep = 5e-4
        mujoco.mj_step(friction.model, mujoco.MjData(friction.model))


@needs_compiler
def test_what_fails_within_is_said_at_the_end():
    """No exception can leave a thread of MuJoCo."""
    friction = pf.mujoco_friction(worm := geared(0.3, -0.8, 1e-7), made(worm, 1e-3))
    data = mujoco.MjData(friction.model)
    data.qvel[0] = 1.0
    with pytest.raises(PinfricError, match=r"gear of 'hinge' jams .* more rotor_inertia"):
        run(friction, data, 3)
    run(friction, mujoco.MjData(friction.model), 1)  # forgotten
    with pytest.raises(PinfricError, match="the time step was changed"):
        change_the_step(friction)


def rolled(frictions, controls, threads=3):
    """Positions at the end of a rollout of each, from rest, by so many threads."""
    models = frictions.models
    state = np.empty(mujoco.mj_stateSize(models[0], PHYSICS))
    mujoco.mj_getState(models[0], mujoco.MjData(models[0]), state, PHYSICS)
    data = [mujoco.MjData(models[0]) for _ in range(threads)]
    with frictions.installed():
        found, _ = rollout(models, data, np.tile(state, (len(models), 1)), controls, chunk_size=1)
    return found[:, -1, 1 : 1 + models[0].nq]


@needs_compiler
def test_64_randomised_environments_are_64_runs_alone():
    """In threads, bit by bit; the same seed gives the same; another seed, another motion."""
    friction, _, controls = a_motion_of(*CASES["slider"]())
    controls = np.tile(controls[:200], (64, 1, 1))

    def made_of(seed):
        return friction.randomised(np.random.default_rng(seed), scale=(0.5, 1.5), count=64)

    several = made_of(7)
    found = rolled(several, controls)
    assert_array_equal(rolled(made_of(7), controls, threads=2), found)
    assert (rolled(made_of(8), controls) != found).any(axis=1).all()
    for k, one in enumerate(several.each):
        data = mujoco.MjData(one.model)
        with one.installed():
            for control in controls[k]:
                data.ctrl[:] = control
                mujoco.mj_step(one.model, data)
        assert_array_equal(data.qpos, found[k])
    assert len(np.unique(found[:, 0])) > 32
    assert several.factors.min() >= 0.5
    assert several.factors.max() <= 1.5


@needs_compiler
def test_a_factor_is_that_of_the_scenes_friction():
    """Each drawn friction against `step` of a friction made of the scaled scene."""
    scene, spec = bar(), bar_on_a_floor()
    friction = pf.mujoco_friction(scene, spec)
    for one, factor in (
        (x, f[0]) for d in (friction.randomised(np.random.default_rng(1), count=3),)
        for x, f in zip(d.each, d.factors, strict=True)
    ):  # fmt: skip
        scaled = {"hinge": scene.friction["hinge"].scaled(factor)}
        wanted = pf.mujoco_friction(scene.with_(friction=scaled), bar_on_a_floor())
        ends = []
        for which, compiled in ((wanted, False), (one, False), (one, True)):
            data = mujoco.MjData(which.model)
            data.qvel[:] = -0.5
            with which.installed() if compiled else nullcontext():
                if not compiled:
                    which.start(data)
                for _ in range(200):
                    mujoco.mj_step(which.model, data) if compiled else which.step(data)
            ends.append(data.qpos.copy())
        assert_allclose(ends[1], ends[0], rtol=0, atol=1e-12)
        assert_allclose(ends[2], ends[0], rtol=0, atol=1e-12)


@needs_compiler
def test_several_frictions_are_installed_by_model():
    """Of one robot and of others; a model that is not installed is said at the end."""
    strong = slider().with_(friction={"slide": slider().friction["slide"].scaled(2.0)})
    frictions = [
        pf.mujoco_friction(scene, made(scene, 1e-3)) for scene in (slider(), strong, bar())
    ]

    def run_all(installed, ran):
        ends = []
        with ExitStack() as stack:
            for friction in installed:
                stack.enter_context(friction.installed())
            for friction in ran:
                data = mujoco.MjData(friction.model)
                data.qvel[:] = 0.3
                mujoco.mj_step(friction.model, data, 100)
                ends.append(data.qpos.copy())
        assert mujoco.get_mjcb_control() is None
        return ends

    alone = [run_all([friction], [friction])[0] for friction in frictions]
    assert alone[0] != alone[1]
    for order in ((0, 1, 2), (2, 1, 0), (1, 0, 2)):
        picked = [frictions[k] for k in order]
        for k, end in zip(order, run_all(picked, picked), strict=True):
            assert_array_equal(end, alone[k])
    with pytest.raises(PinfricError, match="a model of another friction ran, which was not"):
        run_all(frictions[:1], frictions[:2])
    assert_array_equal(run_all(frictions[:1], frictions[:1])[0], alone[0])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rng": 3}, r"rng is a int, not a numpy\.random\.Generator"),
        ({"scale": (1.2, 0.8)}, r"slide: should be \(low, high\)"),
        ({"scale": 0.3}, r"slide: should be \(low, high\)"),
        ({"scale": (-0.1, 1.0)}, "not below 0"),
        ({"scale": {"slid": (0.9, 1.1)}}, "no joint 'slid' has friction; .*slide"),
        ({"count": 0}, "count: should be a number above 0"),
    ],
)
def test_what_cannot_be_drawn_is_refused(given, message):
    friction = pf.mujoco_friction(
        slider(), mujoco.MjModel.from_xml_string(pf.export(slider()).text)
    )
    with pytest.raises(PinfricError, match=message):
        friction.randomised(**({"rng": np.random.default_rng(0)} | given))
