"""Simulation against closed forms: stick-slip, spin-down, energy, standstill, guards, orders."""

from concurrent.futures import ThreadPoolExecutor
from itertools import count

import numpy as np
import pinocchio as pin
import pytest
import yaml
from builders import (
    block,
    chain,
    dry,
    lump,
    plane_friction,
    random_friction,
    random_states,
    random_tree,
    sliding_block,
)
from judges.verdict import judge
from mechanisms import pin_friction
from numpy.testing import assert_allclose, assert_array_equal
from simulation_cases import Belt, arm
from tables import table

import pinfric as pf
from pinfric.dynamics.simulation.simulate import _READ, METHODS, Numbers
from pinfric.errors import AmbiguousAcceleration, NoConsistentAcceleration, SimulationError
from pinfric.friction import search


def test_the_belt_sticks_and_slips_by_the_closed_form():
    belt = Belt()
    motion = belt.run(belt.first_slip + 4.5 * belt.period, rtol=1e-11, atol=1e-13)
    assert [e.kind for e in motion.events] == ["slip", "stick"] * 4 + ["slip", "stick"][:1]
    slips = np.array([e.time for e in motion.events if e.kind == "slip"])
    sticks = np.array([e.time for e in motion.events if e.kind == "stick"])
    assert slips[0] == pytest.approx(belt.first_slip, rel=1e-12)
    assert_allclose(np.diff(slips), belt.period, rtol=1e-9)
    assert_allclose(sticks - slips[:4], belt.slip_time, rtol=1e-9)
    intervals = motion.stick_intervals()
    assert len(intervals) == 5
    assert_allclose([i.end - i.start for i in intervals[1:]], belt.stick_time, rtol=1e-8)
    expected = [belt.position(t) for t in motion.t]
    assert_allclose(motion.q[:, 0], expected, atol=1e-9)


@pytest.mark.slow
def test_samples_of_a_stick_are_at_rest_exactly_and_inverse_dynamics_sees_them():
    belt = Belt()
    motion = belt.run(3 * belt.period)
    stuck = motion.modes[:, 0] == 0
    assert (motion.v[stuck] == 0).all()
    assert (motion.a[stuck] == 0).all()
    assert 100 < stuck.sum() < 900
    inverse = pf.inverse_dynamics(belt.scene, motion)
    assert inverse.sticking[stuck, 0].all()
    assert (inverse.effort_lower <= motion.effort + 1e-9).all()
    assert (inverse.effort_upper >= motion.effort - 1e-9).all()
    slides = ~inverse.sticking[:, 0] & ~inverse.reversal[:, 0]
    assert_allclose(inverse.effort_lower[slides], motion.effort[slides], atol=1e-10)
    assert judge(inverse).passed()


def pinned_body(b: float) -> pf.Scene:
    body = pin.Inertia(1.0, np.array([1.0, 0, 0]), np.zeros((3, 3)))
    model = chain(("pin", pin.JointModelRZ(), body), gravity=0.0)
    return pf.Scene(
        model=model,
        friction={"pin": pin_friction(b, 1.0)},
    )


@pytest.mark.parametrize("b", [0.2, 0.8, 0.999])
def test_spin_down_by_the_closed_form(b):
    k, v0 = b / np.sqrt(1 - b**2), 3.0
    motion = pf.simulate(pinned_body(b), [0.0], [v0], [0.0], 2.0, rtol=1e-10, atol=1e-12)
    assert_allclose(motion.v[:, 0], v0 / (1 + k * v0 * motion.t), rtol=1e-8)
    assert_allclose(motion.q[:, 0], np.log1p(k * v0 * motion.t) / k, rtol=1e-8)
    assert motion.events == ()  # it never comes to rest
    assert motion.evaluations < 3000


def test_beyond_the_threshold_the_spinning_body_cannot_even_start():
    with pytest.raises(NoConsistentAcceleration, match="t = 0 s") as error:
        pf.simulate(pinned_body(1.0 + 1e-9), [0.0], [3.0], [0.0], 1.0)
    assert error.value.time == 0.0
    assert error.value.motion is None


def test_a_motion_that_runs_into_an_inconsistency_says_when_and_keeps_what_it_had():
    """A driven slider carries the pinned mass inward: b = mu R m l / (J + m l^2) grows to 1.

    Another body rests on its own pin, which the error must not name.
    """
    model = chain(
        ("pin", pin.JointModelRZ(), pin.Inertia(1e-9, np.zeros(3), np.diag([1.0, 1, 1.0]))),
        ("arm", pin.JointModelPX(), pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3)))),
        gravity=0.0,
    )
    rest = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "rest")
    beside = lump(1.0, [0.3, 0, 0])
    model.appendBodyToJoint(rest, beside, pin.SE3.Identity())
    mu_radius = 2.2
    entry = pin_friction(2.0, mu_radius / 2.0)
    friction = {"rest": entry, "pin": entry}
    with pytest.warns(pf.PinfricWarning, match="radius"):
        scene = pf.Scene(model=model, friction=friction)

    def hold(t, q, v):  # the slider moves inward steadily whatever the centrifugal force
        return np.array([0.0, -(v[0] ** 2) * q[1], 0.0])

    with pytest.raises(NoConsistentAcceleration) as error:
        pf.simulate(scene, [0.0, 2.0, 0.0], [1e-3, -0.1, 0.0], hold, 20.0)
    assert error.value.site == "pin"
    reached = error.value.motion
    assert reached.status == "failed"
    assert 4.0 < reached.t[-1] <= error.value.time < 5.0
    l_end = error.value.q[1]
    assert mu_radius * l_end / (1 + l_end**2) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("seed", [1, 2, 5, 6, 8, 9])
def test_energy_is_balanced_on_random_trees(seed):
    model = random_tree(seed, 4)
    friction = random_friction(model, seed)
    for entry in friction.values():
        entry["mu"] = {key: 0.1 * value for key, value in entry["mu"].items()}
    scene = pf.Scene(model=model, friction=friction)
    q, v, u = random_states(model, seed, 1)
    motion = pf.simulate(
        scene, q[0], v[0], lambda t, q, v: u[0] * np.cos(4 * t), 1.0, rtol=1e-9, atol=1e-11
    )
    energy = motion.energy()
    assert (energy.friction_loss >= -1e-12).all()
    assert energy.friction_loss.sum() > 0.05
    assert abs(energy.residual) < 1e-6 * (abs(energy.work) + energy.friction_loss.sum())


def test_a_free_body_keeps_its_momentum_and_energy():
    """A tumbling free-flyer, whose chart moves along many times."""
    body = pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
    model = chain(("base", pin.JointModelFreeFlyer(), body), gravity=0.0)
    scene = pf.Scene(model=model)
    q0, v0 = pin.neutral(model), np.array([0.3, -0.2, 0.1, 1.0, 4.0, 0.5])
    motion = pf.simulate(scene, q0, v0, np.zeros(6), 5.0, rtol=1e-10, atol=1e-12)
    data = model.createData()
    momenta = []
    for q, v in zip(motion.q, motion.v, strict=True):
        pin.computeCentroidalMomentum(model, data, q, v)
        momenta.append(data.oMi[1].act(model.inertias[1] * pin.Motion(v)).vector)
    assert_allclose(momenta, np.tile(momenta[0], (len(momenta), 1)), atol=1e-7)
    assert abs(motion.energy().residual) < 1e-8
    assert_allclose(np.linalg.norm(motion.q[:, 3:], axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("joint", [pin.JointModelPlanar, pin.JointModelSpherical])
def test_joints_of_many_degrees_keep_their_energy(joint):
    body = pin.Inertia(2.0, np.array([0.1, 0.2, 0.0]), np.diag([0.1, 0.2, 0.25]))
    model = chain(("base", joint(), body))
    scene = pf.Scene(model=model)
    motion = pf.simulate(
        scene,
        pin.neutral(model),
        np.array([2.0, -1.0, 3.0]),
        np.zeros(3),
        3.0,
        rtol=1e-10,
        atol=1e-12,
    )
    assert abs(motion.energy().residual) < 1e-8
    stepped = pf.simulate(
        scene,
        pin.neutral(model),
        np.array([2.0, -1.0, 3.0]),
        np.zeros(3),
        1.0,
        "timestepping",
        dt=2e-4,
    )
    at_one = motion.sample([1.0])
    assert_allclose(stepped.q[-1], at_one.q[0], atol=5e-3)


def test_a_continuous_joint_moves_like_a_revolute_one():
    def pendulum(kind):
        body = lump(1.0, [0, 0.3, 0.2])
        model = chain(("pin", kind(), body))
        return pf.Scene(
            model=model,
            friction={"pin": pin_friction(0.25, 0.05, static=0.3)},
        )

    fine = {"rtol": 1e-10, "atol": 1e-12}
    turns = pf.simulate(pendulum(pin.JointModelRX), [0.5], [9.0], [0.0], 4.0, **fine)
    start = [np.cos(0.5), np.sin(0.5)]
    circle = pf.simulate(pendulum(pin.JointModelRUBX), start, [9.0], [0.0], 4.0, **fine)
    assert turns.q[:, 0].max() > 2 * np.pi  # it goes over the top
    assert [e.kind for e in turns.events] == [e.kind for e in circle.events]
    assert_allclose([e.time for e in turns.events], [e.time for e in circle.events])
    common = np.linspace(0, 4, 101)
    a, b = turns.sample(common), circle.sample(common)
    assert_allclose(np.cos(a.q[:, 0]), b.q[:, 0], atol=1e-7)
    assert_allclose(a.v, b.v, atol=1e-7)


@pytest.mark.parametrize(("method", "options"), [("event", {}), ("timestepping", {"dt": 0.05})])
def test_an_arm_held_by_static_friction_stays_exactly_for_100_s(method, options):
    motion = pf.simulate(arm(), [0.0, 0.0], [0.0, 0.0], [0.0, 0.0], 100.0, method, **options)
    assert (motion.q == 0).all()
    assert (motion.v == 0).all()
    assert [(i.start, i.end) for i in motion.stick_intervals()] == [(0.0, 100.0)] * 2
    assert motion.evaluations < 4100


def test_the_paper_s_pendulum_sticks_when_it_should():
    scene = pf.load_scene("pendulum")
    motion = pf.simulate(scene, [0.524], [1.0], None, 2.0)
    (interval,) = motion.stick_intervals()
    assert 1.060 <= interval.start <= 1.072
    assert 1.208 <= interval.end <= 1.216
    assert motion.evaluations < 2500


def test_the_paper_s_robot_sticks_when_it_should_and_its_efforts_are_recovered():
    scene = pf.load_scene("three_link")
    motion = pf.simulate(scene, np.zeros(3), [1.0, -1.0, 1.0], None, 1.0)
    (interval,) = motion.stick_intervals()
    assert 0.515 <= interval.start <= 0.523
    assert 0.555 <= interval.end <= 0.561
    inverse = pf.inverse_dynamics(scene, motion)
    stuck = motion.modes[:, 0] == 0
    assert (inverse.effort_lower <= motion.effort + 1e-9).all()
    assert (inverse.effort_upper >= motion.effort - 1e-9).all()
    slides = ~inverse.sticking[:, 0] & ~inverse.reversal[:, 0]
    assert_allclose(inverse.effort_lower[slides], motion.effort[slides], atol=1e-9)
    width = inverse.effort_upper[stuck, 1] - inverse.effort_lower[stuck, 1]
    assert_allclose(width, 2 * 0.35 * inverse.normal_load[stuck, 0], rtol=1e-12)
    assert motion.evaluations < 2500


def test_all_three_methods_agree_on_the_paper_s_robot():
    scene = pf.load_scene("three_link")
    q0, v0 = np.zeros(3), [1.0, -1.0, 1.0]
    exact = pf.simulate(scene, q0, v0, None, 1.0, rtol=1e-10)
    stepped = pf.simulate(scene, q0, v0, None, 1.0, "timestepping", dt=2.5e-4, sample_step=0.01)
    smooth = pf.simulate(scene, q0, v0, None, 1.0, "regularized", sample_step=0.01)
    assert_allclose(stepped.q[-1], exact.q[-1], atol=0.02)
    assert_allclose(smooth.q[-1], exact.q[-1], atol=0.02)
    assert np.abs(stepped.q[-1] - exact.q[-1]).max() > 1e-6


def test_a_joint_that_comes_to_rest_leaves_what_sticks_alone():
    """Either joint could slip at that instant; the one that has been sticking keeps sticking."""
    scene = pf.load_scene("three_link")
    radii, lengths = (0.05, 0.08, 0.03), (0.12, 0.10, None)
    static, kinetic = (0.3, 0.35, 0.25), (0.25, 0.30, 0.2)
    friction = {}
    for i, name in enumerate(scene.joint_names):
        bearing = {"kind": "pin", "radius": radii[i]}
        if lengths[i]:
            bearing["length"] = lengths[i]
        mu = {"static": static[i], "kinetic": kinetic[i]}
        friction[name] = {"bearing": bearing, "mu": mu}
    scene = pf.Scene(model=scene.model, friction=friction)
    q0 = np.array([0.1, -0.3, 0.2])
    hold = pin.rnea(scene.model, scene.model.createData(), q0, np.zeros(3), np.zeros(3))

    def effort(t, q, v):
        return hold + np.array([5 * np.sin(9 * t), 2 * np.cos(7 * t), 0.12 * np.sin(11 * t)])

    motion = pf.simulate(scene, q0, [0.05, 0.0, -0.1], effort, 0.6)
    event = motion.events[-1]
    assert (event.name, event.kind) == ("joint_1", "reversal")
    i = int(motion.t.searchsorted(event.time))
    assert motion.modes[i - 1 : i + 1, 1].tolist() == [0, 0]
    with pytest.raises(AmbiguousAcceleration, match="several"):  # the instant alone cannot tell
        pf.forward_dynamics(scene, motion.q[i], motion.v[i], motion.effort[i])


def test_what_balances_to_rounding_stays_where_friction_is_next_to_nothing():
    """The effort misses the weight by rounding, and the limit is smaller still."""
    model = block(0.4, 3.7)
    weight = pin.rnea(model, model.createData(), np.zeros(1), np.zeros(1), np.zeros(1))
    friction = {"slide": dry(1e-16)}
    scene = pf.Scene(model=model, friction=friction)
    for effort in (np.nextafter(weight, 0.0), weight, np.nextafter(weight, -100.0)):
        motion = pf.simulate(scene, [0.0], [0.0], effort, 5.0)
        assert motion.events == ()
        assert (motion.q == 0).all()
        assert motion.evaluations < 2300


def test_what_overflows_in_the_integrator_is_no_warning_of_its_own():
    """A block of 1e-300 kg: accelerations are finite, their squares in SciPy's norms are not."""
    scene = sliding_block(plane_friction(0.1, 0.1), mass=1e-300)

    def effort(t, q, v):
        return [28.0 * np.sin(6.0 * t)]

    assert np.isfinite(pf.simulate(scene, [0.0], [0.0], effort, 0.03).q).all()
    with pytest.raises(SimulationError, match="t = 0 s the integration fails: values are too"):
        pf.simulate(scene, [0.0], [0.0], effort, 0.03, "regularized")


CASES = """
event  {dt: 0.001}  dt = 0.001: is for timestepping; event takes rtol, atol
timestepping  {rtol: 1.0e-06}                   is for event and regularized; timestepping takes dt
timestepping  {max_step: 0.1}                   max_step = 0.1: is for event and regularized
regularized   {max_events: 5}                   max_events = 5: is for event;
event         {regularization_velocity: 0.001}  is for regularized;
"""


@pytest.mark.parametrize(
    ("method", "number", "text"),
    table(CASES, str, yaml.safe_load, str),
)
def test_a_number_that_the_method_would_ignore_is_refused(method, number, text):
    """A given step promises an error that depends on it."""
    with pytest.raises(SimulationError) as caught:
        pf.simulate(pf.load_scene("pendulum"), [0.0], [0.0], [0.0], 0.01, method, **number)
    assert text in str(caught.value)


def test_every_number_is_read_by_a_method():
    """None means not given."""
    assert {name for names in _READ.values() for name in names} == set(Numbers.__annotations__)
    assert set(_READ) == set(METHODS)
    scene = pf.load_scene("pendulum")
    motion = pf.simulate(scene, [0.0], [0.0], [0.0], 0.01, "timestepping", dt=1e-3, max_step=None)
    assert len(motion.t) == 11  # dt is the step


@pytest.mark.parametrize("method", ["event", "regularized"])
def test_an_effort_too_fast_for_any_run_is_refused(method):
    """28 million periods would be integrated for hours."""
    scene = pf.load_scene("pendulum")
    fast = {"effort": {"joint_1": {"sine": {"amplitude": 2.0, "angular_frequency": 6e9}}}}
    start = scene.simulation.model_dump() | fast
    with pytest.raises(
        SimulationError, match=r"efforts that change within 1\.66667e-10 s: 1\.8e\+08"
    ):
        pf.simulate(scene.with_(simulation=start), t_end=0.03, method=method)
    with pytest.raises(SimulationError, match="max_step = 1e-10 s: 3e"):
        pf.simulate(scene, [0.0], [0.0], [0.0], 0.03, method, max_step=1e-10)


def test_simulations_within_and_beside_each_other_do_not_meet():
    """A simulation lends its workspace; the scene's next one finds nothing of the last."""
    scene = pf.load_scene("three_link")

    def run(inner=False):
        calls = count()

        def effort(t, q, v):
            if next(calls) % 100 == 50 and inner:
                pf.simulate(scene, q, v, None, 0.02)
            return [np.sin(9.0 * t), 0.0, 0.1]

        return pf.simulate(scene, np.zeros(3), [1.0, -1.0, 1.0], effort, 0.1, rtol=1e-6)

    alone = run()
    middle = alone.sample(np.array([0.0505]))
    with pytest.raises(pf.PinfricError):  # what ends badly lends nothing on
        pf.simulate(scene, np.zeros(3), np.zeros(3), lambda t, q, v: [np.nan] * 3, 0.1)
    with ThreadPoolExecutor(3) as pool:
        beside = list(pool.map(lambda _: run(), range(6)))
    for other in (run(inner=True), *beside):
        for name in ("t", "q", "v", "a", "effort", "modes", "friction", "normal_load"):
            assert_array_equal(getattr(other, name), getattr(alone, name), name)
    assert_array_equal(alone.sample(np.array([0.0505])).a, middle.a)


def test_a_motion_says_where_other_modes_may_obey(tmp_path, monkeypatch):
    """Twelve sliders in a chain: more than are tried, and nothing proves one answer."""
    names, body = [f"s{i}" for i in range(12)], lump(1.0)
    model = chain(*((name, pin.JointModelPX(), body) for name in names), gravity=0.0)
    push, still = np.random.default_rng(3).normal(scale=2.0, size=12), np.zeros(12)
    scene = pf.Scene(model=model, friction=dict.fromkeys(names, dry(1.3, 1.0)))
    for in_tree, unproved in ((search._in_tree, ()), (lambda *_: None, (0.0,))):
        monkeypatch.setattr(search, "_in_tree", in_tree)
        motion = pf.simulate(scene, still, still, push, 0.01)
        assert motion.unproved == unproved
        assert ("other modes may obey" in repr(motion)) == bool(unproved)
        assert pf.load_motion(motion.save(tmp_path / "motion"), scene).unproved == unproved


@pytest.mark.parametrize(("t_end", "samples"), [(1.0, 1001), (1e-2, 1001), (1e-3, 101), (1e-6, 11)])
def test_a_short_motion_has_fewer_samples(t_end, samples):
    """Each costs a solve: a millisecond of 200 joints had 1001."""
    motion = pf.simulate(pf.load_scene("pendulum"), [0.0], [5.0], [0.0], t_end)
    assert len(motion.t) - len(motion.events) in (samples, samples - 1)
    assert motion.t[-1] == t_end
