"""Friction laws: values by hand, thresholds from both sides, kernel against plain NumPy."""

import numpy as np
import pytest
from builders import (
    plane_friction,
    random_friction,
    random_states,
    random_tree,
    sliding_block,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from judges.plain_laws import plain_friction
from judges.verdict import judge

import pinfric as pf
from pinfric.model.laws import friction_bounds, friction_law, law_table
from pinfric.model.schema import Friction


def bounds(friction, velocity, load=0.0, at_rest=False):
    law = law_table([friction_law(Friction.model_validate(friction), 1e-6)])
    lower, upper, sticking = np.empty((1, 1)), np.empty((1, 1)), np.empty((1, 1), dtype=bool)
    friction_bounds(
        np.array([[velocity]]),
        np.array([[load]]),
        law,
        np.array([[at_rest]]),
        lower,
        upper,
        sticking,
    )
    return lower[0, 0], upper[0, 0], sticking[0, 0]


def test_stribeck_falls_from_static_to_kinetic():
    friction = plane_friction(0.4, 0.3, stribeck={"velocity": 0.02, "exponent": 2.0})
    at = {v: -bounds(friction, v, 10.0)[0] for v in (1e-5, 0.02, 1.0)}
    assert at[1e-5] == pytest.approx(4.0, rel=1e-6)
    assert at[0.02] == pytest.approx(10 * (0.3 + 0.1 * np.exp(-1)), rel=1e-12)
    assert at[1.0] == pytest.approx(3.0, rel=1e-12)


def test_coulomb_by_direction_opposes_the_motion_it_is_named_for():
    friction = {
        "coulomb": {
            "positive": {"static": 2.0, "kinetic": 1.0},
            "negative": {"static": 6.0, "kinetic": 5.0},
        },
        "viscous": 0.5,
    }
    assert bounds(friction, 2.0) == (-2.0, -2.0, False)
    assert bounds(friction, -2.0) == (6.0, 6.0, False)
    assert bounds(friction, 0.0) == (-2.0, 6.0, True)


def test_stick_velocity_from_both_sides():
    friction = plane_friction(0.4, 0.3, stick_velocity=1e-3)
    assert bounds(friction, 1e-3, 10.0) == (-4.0, 4.0, True)
    lower, upper, sticking = bounds(friction, np.nextafter(1e-3, 1), 10.0)
    assert (lower, upper, sticking) == (-3.0, -3.0, False)


def test_creeping_adds_the_drag_to_what_standstill_admits():
    friction = plane_friction(0.4, 0.3, viscous=10.0, stick_velocity=0.5)
    assert bounds(friction, 0.2, 10.0) == (-6.0, 4.0, True)
    assert bounds(friction, -0.2, 10.0) == (-4.0, 6.0, True)


def test_without_dry_friction_there_is_nothing_to_stick_by():
    friction = {"viscous": 10.0, "stick_velocity": 0.5}
    assert bounds(friction, 0.2) == (-2.0, -2.0, True)
    assert bounds(friction, 0.0) == (0.0, 0.0, True)


@st.composite
def friction_entries(draw):
    """Every kind of law, with a wide stick velocity."""

    def pair(most):
        static = draw(st.floats(0.0, most))
        return {"static": static, "kinetic": static * draw(st.floats(0.0, 1.0))}

    coulomb = {"positive": pair(5.0), "negative": pair(5.0)} if draw(st.booleans()) else pair(5.0)
    more = {"coulomb": coulomb, "viscous": draw(st.floats(0.0, 20.0))}
    if draw(st.booleans()):
        velocity, exponent = draw(st.floats(1e-3, 1.0)), draw(st.floats(0.5, 2.0))
        more["stribeck"] = {"velocity": velocity, "exponent": exponent}
    mu = pair(0.5)
    return plane_friction(
        mu["static"], mu["kinetic"], **more, stick_velocity=draw(st.floats(1e-6, 0.5))
    )


@settings(deadline=None)  # the first example may compile a kernel
@given(friction_entries(), st.floats(0.0, 100.0), st.sampled_from([-1.0, 1.0]))
def test_no_step_out_of_the_interval_at_the_stick_velocity(friction, load, side):
    """The sliding value just above the stick velocity lies in the interval just below it."""
    edge = side * friction["stick_velocity"]
    sliding, same, _ = bounds(friction, np.nextafter(edge, 2 * edge), load)
    lower, upper, sticking = bounds(friction, edge, load)
    assert sticking
    assert sliding == same
    rounding = 1e-12 * max(abs(lower), abs(upper))
    assert lower - rounding <= sliding <= upper + rounding
    # at 0 exactly it is what the static limits say
    law = friction_law(Friction.model_validate(friction), 1e-6)
    assert bounds(friction, 0.0, load)[:2] == (
        -(law.static.mu * load + law.static.forward),
        law.static.mu * load + law.static.backward,
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000))
def test_efforts_of_a_tree_just_above_lie_in_their_intervals_just_below(seed):
    """The same states with a stick velocity below and above their speeds, gears included."""
    model = random_tree(seed % 20, joints=4)
    gear = {"ratio": 50.0, "efficiency": 0.9, "back_efficiency": 0.8, "motor_viscous": 1e-4}
    actuators = [{"joint": f"joint_{j}", "transmission": gear} for j in range(1, 5)]
    states = random_states(model, seed, 5)
    slides, creeps = (
        pf.inverse_dynamics(
            pf.Scene(
                model=model,
                friction=random_friction(model, seed),
                actuators=actuators,
                stick_velocity=stick,
            ),
            *states,
        )
        for stick in (0.0, 100.0)
    )
    assert creeps.sticking.all()
    assert not slides.sticking.any()
    for kind in ("effort", "motor_torque"):
        lower, upper = getattr(creeps, f"{kind}_lower"), getattr(creeps, f"{kind}_upper")
        rounding = 1e-12 * np.abs(upper - lower).max()
        assert (lower <= getattr(slides, f"{kind}_lower") + rounding).all()
        assert (getattr(slides, f"{kind}_upper") <= upper + rounding).all()
    assert judge(creeps).passed(1e-10)


def test_passing_through_rest_encloses_both_standstill_and_sliding():
    friction = plane_friction(0.4, 0.4, viscous=10.0)
    lower, upper, sticking = bounds(friction, 1.0, 10.0, at_rest=True)
    assert (lower, upper, sticking) == (-14.0, 4.0, False)


@pytest.mark.parametrize("seed", range(4))
def test_kernel_equals_the_law_written_out(seed):
    model = random_tree(seed, joints=6)
    scene = pf.Scene(model=model, friction=random_friction(model, seed), stick_velocity=0.2)
    q, v, a = random_states(model, seed, 40)
    result = pf.inverse_dynamics(scene, q, v, a, t=np.arange(40.0))
    assert result.sticking.any()
    assert result.reversal.any()
    for i in range(len(q)):
        for s, site in enumerate(scene.sites):
            expected = plain_friction(
                site, v[i, s], result.normal_load[i, s], result.reversal[i, s]
            )
            found = result.friction_lower[i, s], result.friction_upper[i, s]
            assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("side", [-1, 1])
def test_block_on_an_incline_holds_by_itself_up_to_the_static_threshold(side):
    mu = 0.35
    angle = np.arctan(mu) + side * 1e-3
    scene = sliding_block(plane_friction(mu, mu), angle)
    result = pf.inverse_dynamics(scene, *np.zeros((3, 1, 1)))
    holds_alone = result.effort_lower[0, 0] <= 0 <= result.effort_upper[0, 0]
    assert holds_alone == (side < 0)
    weight = 2.0 * 9.81
    expected = -weight * np.sin(angle), mu * weight * np.cos(angle)
    assert result.effort_lower[0, 0] == pytest.approx(expected[0] - expected[1], rel=1e-12)
    assert result.effort_upper[0, 0] == pytest.approx(expected[0] + expected[1], rel=1e-12)
