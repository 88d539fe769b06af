"""Results of inverse dynamics, and trees."""

import numpy as np
import pytest
from builders import dry, plane_friction, random_states, random_tree, scene_of, sliding_block
from judges.verdict import judge
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.inverse import tree as inverse_tree
from pinfric.dynamics.problem.plan import drive_delivery
from pinfric.errors import StateError

# Result: the result: stick intervals, DataFrame, its own check.


def test_check_sees_a_wrong_effort_a_wrong_friction_and_a_wrong_wrench():
    scene = scene_of(3)
    result = pf.inverse_dynamics(scene, *random_states(scene.model, 3, 5))
    error = 1e-6 * judge(result).scale
    for name in ("effort_lower", "effort_upper", "friction_lower", "normal_load", "wrench"):
        array = getattr(result, name)
        array[2, 1] += error
        assert not judge(result).passed(1e-9), name
        array[2, 1] -= error
    assert judge(result).passed(1e-9)


def test_stick_intervals_and_dataframe():
    scene = sliding_block(plane_friction(0.5, 0.3))
    t = np.linspace(0, 1, 11)
    v = np.where((t > 0.25) & (t < 0.65), 0.0, 1.0)[:, None]
    result = pf.inverse_dynamics(scene, np.zeros((11, 1)), v, np.zeros((11, 1)), t=t)
    assert result.stick_intervals() == (pf.StickInterval("slide", t[3], t[6]),)
    frame = result.to_dataframe()
    assert frame["t"].tolist() == t.tolist()
    assert_array_equal(frame["slide.effort_upper"], result.effort_upper[:, 0])
    with pytest.raises(StateError, match="need times"):
        pf.inverse_dynamics(scene, [[0.0]], [[1.0]], [[0.0]]).stick_intervals()


def test_repr_offers_what_a_result_without_times_can_do():
    """Its `summary()` raises, so it is not offered, and a notebook shows no table."""
    result = pf.inverse_dynamics(pf.load_scene("pendulum"), [[0.1]], [[1.0]], [[0.0]])
    offers = [word for word in repr(result).split() if word.startswith(".")]
    assert offers == [".to_dataframe()", ".check()"]
    for offer in offers:
        getattr(result, offer[1:-2])()
    assert result._repr_html_() is None


def test_repr_has_peaks_below_one():
    scene = sliding_block(plane_friction(0.5, 0.3))
    small = pf.inverse_dynamics(scene, [[0.0]] * 2, [[1.0]] * 2, [[-0.3 * 9.81], [-2.8]])
    assert "peaks     1: slide 0.286 (N m or N)" in repr(small)


# Tree: open chains: one pass, no more reactions than friction needs.


def test_an_open_chain_never_iterates(monkeypatch):
    scene = scene_of(7)
    passes = []
    original = inverse_tree.reactions
    monkeypatch.setattr(
        inverse_tree, "reactions", lambda *args: (passes.append(1), original(*args))[1]
    )
    result = pf.inverse_dynamics(scene, *random_states(scene.model, 7, 100))
    assert len(passes) == 1  # one batch, looked at once
    assert (result.iterations == 0).all()
    assert (result.contraction == 0).all()


def test_constant_friction_computes_no_reactions(monkeypatch):
    model = random_tree(6)
    scene = pf.Scene(model=model, friction={"joint_2": dry(2.0, 1.0)})
    monkeypatch.setattr(inverse_tree, "reactions", lambda *_: pytest.fail("twin was called"))
    q, v, a = random_states(model, 6, 4)
    result = pf.inverse_dynamics(scene, q, np.abs(v), a)
    assert_allclose((result.effort_lower - result.effort_frictionless)[:, 1], 1.0)
    assert judge(result).passed()


def test_what_drives_deliver_of_joints_efforts_is_made_once_for_a_scene():
    """It took a tenth of `Solver.inverse`; scenes that share a twin have one each."""
    model = random_tree(0, 3)
    last = tuple(model.names)[-1]
    pair = [{"joint": last, "name": name, "share": 1.0} for name in ("left", "right")]
    scene = pf.Scene(model=model, actuators=pair)
    halves = drive_delivery(scene)
    assert_array_equal(halves[:, -1], [0.5, 0.5])
    assert drive_delivery(scene) is halves
    one = scene.with_(actuators=[{"joint": last}])
    assert drive_delivery(one).shape == (1, 3)
    assert_array_equal(drive_delivery(scene), halves)
