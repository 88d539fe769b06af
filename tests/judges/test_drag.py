"""Joints without dry friction, and drag in time steps: closed forms of a block on a slide."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from numpy.testing import assert_allclose
from scipy.optimize import brentq

import pinfric as pf
from pinfric.model.entry import NonNegative, Positive
from pinfric.model.friction_terms import (
    TERMS,
    FrictionTerm,
    Row,
    Shape,
    Strength,
    Stribeck,
    friction_term,
)

M, G, METHODS = 2.0, 9.81, ("event", "timestepping", "regularized")


@pytest.fixture(scope="module", autouse=True)
def load_drag():
    """A term mu |v|^exponent times the load, known while the tests of this file run."""

    @friction_term("load_drag")
    class LoadDrag(FrictionTerm):
        coefficient: NonNegative
        exponent: Positive

        def rows(self, stribeck: Stribeck | None) -> tuple[Row, ...]:
            return ((Shape(power=self.exponent), Strength(mu=self.coefficient)),)

    yield
    del TERMS["load_drag"]


def block(friction: dict) -> pf.Scene:
    """M on a level slide that carries its weight; load M g."""
    body = lump(M)
    model = chain(("slide", pin.JointModelPX(), body))
    return pf.Scene(model=model, friction={"slide": friction})


def loaded(mu: float, exponent: float = 1.0) -> pf.Scene:
    """Friction mu |v|^exponent M g and no other."""
    bearing = {"bearing": {"kind": "linear", "radial": 1.0}, "mu": {"static": 0.0, "kinetic": 0.0}}
    return block({**bearing, "load_drag": {"coefficient": mu, "exponent": exponent}})


def drawn(limit: float, c: float, exponent: float, **more) -> pf.Scene:
    """Friction limit + c |v|^exponent."""
    dry = {"coulomb": {"static": limit, "kinetic": limit}} if limit else {}
    return block({**dry, "viscous": {"coefficient": c, "exponent": exponent}, **more})


@pytest.mark.parametrize("method", METHODS)
def test_what_cannot_stick_slips_as_it_moves(method):
    """x = sin(t) / 2 or so: its modes are the signs of its velocity, and it has no events."""
    found = pf.simulate(
        block({"viscous": 0.05}),
        [0.5],
        [0.0],
        lambda t, q, v: -M * q,
        10.0,
        method,
        sample_step=0.1,
    )
    assert (found.v[1:] != 0.0).all()
    assert (found.modes[:, 0] == np.sign(found.v[:, 0])).all()
    assert not found.events
    assert not found.stick_intervals()


@pytest.mark.parametrize("method", METHODS)
def test_drag_of_the_load_brakes_from_rest_and_after_it_turned(method):
    """M x'' = u - mu M g x': from rest under u = 1, and an oscillator u = -k x that turns round."""
    mu, k = 0.05, 40.0
    near = {"rel": 1e-6} if method != "timestepping" else {"rel": 5e-3}
    c = mu * G
    found = pf.simulate(loaded(mu), [0.0], [0.0], [1.0], 2.0, method)
    assert found.v[-1, 0] == pytest.approx((1 - np.exp(-2 * c)) / (M * c), **near)
    found = pf.simulate(loaded(mu), [0.0], [1.0], lambda t, q, v: -k * q, 2.0, method)
    w = np.sqrt(k / M - c**2 / 4)
    wanted = np.exp(-c * found.t / 2) * np.sin(w * found.t) / w
    assert_allclose(found.q[:, 0], wanted, rtol=0, atol=near["rel"] / w)
    assert found.energy().friction_loss[0] > 0.3 * M / 2


def test_quadratic_drag_stops_a_block_where_it_does():
    """M v' = -b - c v^2: it stops after M / (2 c) log(1 + c v^2 / b); steps are of first order."""
    b, c, v = 0.1 * M * G, 5.0, 10.0
    wanted, errors = M / (2 * c) * np.log(1 + c * v**2 / b), []
    for dt in (0.1, 0.05, 0.025, 0.0125):
        found = pf.simulate(drawn(b, c, 2.0), [0.0], [v], [0.0], 2.0, "timestepping", dt=dt)
        assert [event.kind for event in found.events] == ["stick"]
        errors.append(abs(found.q[-1, 0] - wanted))
    assert errors[0] < 0.2 * wanted
    assert errors[-1] < 0.02 * wanted


@pytest.mark.parametrize("dt", [0.01, 0.1, 1.0])
def test_a_root_of_the_speed_does_not_chatter(dt):
    """sqrt(v) = sqrt(v0) - c t / (2 M) until it stands, at 4 s."""
    found = pf.simulate(drawn(0.0, 1.0, 0.5), [0.0], [1.0], [0.0], 8.0, "timestepping", dt=dt)
    assert (found.v >= 0.0).all()
    assert (np.diff(found.v[:, 0]) <= 0.0).all()
    assert found.v[-1, 0] < 1e-3
    wanted = np.maximum(1.0 - found.t / (2 * M), 0.0) ** 2
    assert_allclose(found.v[:, 0], wanted, rtol=0, atol=0.3 * dt)


@pytest.mark.parametrize("exponent", [0.3, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("of_load", [False, True])
def test_speeds_settle_where_drag_and_drive_balance(exponent, of_load):
    """c v^p = u at v = 2, from far below and above, at steps beyond the time constant."""
    u = 30.0
    c = u / 2.0**exponent
    scene = loaded(c / (M * G), exponent) if of_load else drawn(0.0, c, exponent)
    for v, dt in ((0.0, 0.1), (20.0, 0.1), (0.0, 0.5), (20.0, 0.5)):
        found = pf.simulate(scene, [0.0], [v], [u], 100 * dt, "timestepping", dt=dt)
        assert found.v[-1, 0] == pytest.approx(2.0, rel=1e-3)
        assert (found.v[1:] > 0.0).all()


@pytest.mark.parametrize("seed", range(20))
def test_drag_that_outgrows_static_friction_just_off_rest_has_an_answer(seed):
    """Stribeck's fall and a steep power: friction passes its limit at rest."""
    rng = np.random.default_rng(seed)
    limit, decay, c = rng.uniform(1.0, 5.0), rng.uniform(0.3, 1.0), rng.uniform(5.0, 50.0)
    power, w, v0 = rng.uniform(0.2, 0.9), rng.uniform(1.0, 10.0), rng.normal()
    size = rng.uniform(1.2, 6.0) * limit
    scene = drawn(limit, c, power, stribeck={"velocity": 0.01, "exponent": decay})
    scene = scene.with_(
        friction={
            "slide": {
                **scene.friction["slide"].model_dump(exclude_unset=True),
                "coulomb": {"static": limit, "kinetic": 0.6 * limit},
            }
        }
    )
    found = pf.simulate(
        scene, [0.0], [v0], lambda t, q, v: [size * np.sin(w * t)], 2.0, "timestepping", dt=0.01
    )

    def beyond(v, push):  # of implicit Euler: friction at the end of the step, at least its limit
        dry = limit * (0.6 + 0.4 * np.exp(-((v / 0.01) ** decay)))
        return M * v + 1e-3 * (dry + c * v**power) - push

    wanted, v = 0.0, v0
    for k in range(2000):
        push = M * v + 1e-3 * size * np.sin(w * (k + 0.5) * 1e-3)
        after = 0.0
        if beyond(0.0, abs(push)) < 0.0:
            after = np.sign(push) * brentq(beyond, 0.0, abs(push) / M, args=(abs(push),))
        wanted, v = wanted + 5e-4 * (v + after), after
    assert found.q[-1, 0] == pytest.approx(wanted, abs=0.02 * abs(v0) + 0.01)
