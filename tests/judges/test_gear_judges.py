"""The judges of gears judged: by published curves, by a stiff integrator, by each other."""

import numpy as np
import pytest
from judges.gear_judges import (
    Gear,
    accelerations,
    break_away,
    follow,
    locks,
    mesh_reversal,
    sine_against_load,
    smoothed,
    spun_down,
)
from numpy.testing import assert_allclose

#: Modelica.Mechanics.Rotational.Examples.LossyGearDemo1 and 2 as `sine_against_load`.
DEMO = {
    1: (1.5, Gear(0.5, 0.5, inertia=4.0), 20.0, 2 * np.pi, 10.0, -2.5, 0.5),
    2: (1.5, Gear(0.5, 0.5, n=1.0, inertia=4.0, drag=2.0), 20.0, 2 * np.pi, 10.0, -2.5, 0.5),
}
#: Times of events (s) and angles (rad) in the Modelica Association's reference results (Dymola,
#: DASSL, tolerance 1e-6): stop, forward, stop, backward; after both stops, and velocity at 0.5 s.
PUBLISHED = {
    1: (
        (0.0804771289480603, 0.19951990084761, 0.371342745023564, 0.464539461636518),
        (-0.00111688794644722, 0.000208357928579372, 1.66216871678419e-05),
        -0.0162619240385781,
    ),
    2: (
        (0.0635911045847122, 0.230374015885001, 0.308306846100604, 0.472738310500834),
        (-0.000559046146154517, -0.000501771985663904, -0.000589183323069425),
        -0.0096242780930112,
    ),
}


@pytest.mark.parametrize("demo", DEMO)
def test_the_closed_forms_of_lossy_gears_are_the_published_curves(demo):
    found = sine_against_load(*DEMO[demo])
    times, angles, rate = PUBLISHED[demo]
    events = [found[0].end, found[1].start, found[1].end, found[2].start]
    assert_allclose(events, times, rtol=0, atol=1e-7)
    ends = np.array([stretch.at(stretch.end) for stretch in found])
    assert_allclose(ends[:, 0], angles, rtol=0, atol=1e-8)
    assert ends[2, 1] == pytest.approx(rate, abs=5e-8)


def test_a_stiff_integrator_comes_as_near_to_demo_1_as_its_width():
    M, gear, A, w, h0, h1, t_end = DEMO[1]
    times, errors = np.linspace(0.0, t_end, 60), []
    by_hand = follow(sine_against_load(*DEMO[1]), times)[0]
    for width in (1e-4, 1e-5):
        q, _ = smoothed(
            M, lambda t: h0 + h1 * t, lambda t: A * np.sin(w * t), gear, 0.0, t_end, width, times
        )
        errors.append(np.abs(q - by_hand).max())
    assert errors[0] < 1e-4
    assert errors[1] < 0.15 * errors[0]


@pytest.mark.parametrize("drag", [0.0, 0.3])
def test_a_flywheel_loses_its_energy_to_the_gear_and_the_drag(drag):
    """Rotor and wheel: (I + M) v^2/2 = n q + mu_b integral |M a| v + k integral v^2."""
    M, gear, v0 = 2.0, Gear(0.8, 0.6, 0.5, 0.7, drag), 4.0
    path = spun_down(M, gear, v0)
    t = np.linspace(0.0, path.end, 200_001)
    q, v = path.at(t)
    a = (-gear.n - drag * v) / path.m
    lost = gear.n * q[-1] + np.trapezoid(((1 - gear.eta_b) * M * np.abs(a) + drag * v) * v, t)
    assert v[-1] == pytest.approx(0.0, abs=1e-14)
    assert lost == pytest.approx((gear.inertia + M) * v0**2 / 2, rel=1e-9)


def test_a_stiff_integrator_agrees_where_the_mesh_reverses_on_the_way():
    M, gear = 2.0, Gear(0.7, 0.5, 0.3, 0.4)
    times = np.linspace(0.0, 1.5, 20)
    path = mesh_reversal(M, gear, 3.0, 2.0, 4.0, 1.5)
    assert 0.0 < path[1].start < 1.5
    by_hand = follow(path, times)
    assert by_hand[1].min() > 0.5  # it moves forward all the time
    stiff = smoothed(M, lambda t: 0.0, lambda t: 2.0 - 4.0 * t, gear, 3.0, 1.5, 1e-3, times)
    assert_allclose(stiff, by_hand, rtol=1e-7)


def test_what_one_joint_does_follows_from_trying_which_side_drives():
    gear = Gear(0.7, 0.5, 0.3, 0.4)
    path = mesh_reversal(2.0, gear, 3.0, 2.0, 4.0, 1.5)
    for t, m in ((0.2, path[0].m), (1.0, path[1].m)):
        (a,) = accelerations(
            np.array([[2.0]]), np.zeros(1), np.array([2.0 - 4.0 * t]), np.ones(1), [gear]
        )
        assert a[0] == pytest.approx((2.0 - 4.0 * t - 0.3) / m)


@pytest.mark.parametrize("enough", [True, False])
def test_gears_that_lock_have_one_answer_for_every_torque_where_rotors_are_heavy(enough):
    rng, counts = np.random.default_rng(3), []
    for _ in range(30):
        root = rng.normal(size=(2, 2))
        M, size = root @ root.T + 0.3 * np.eye(2), rng.uniform(0.05, 3.0, 2)
        gears = [Gear(0.4, -0.3, 0.2, x) for x in size]
        if (locks(M, gears) > 0) != enough:
            continue
        for _ in range(30):
            v = rng.choice([-1.0, 1.0], 2)
            found = accelerations(M, rng.normal(size=2), 3.0 * rng.normal(size=2), v, gears)
            counts.append(len(found))
    assert (set(counts) == {1}) == enough
    assert len(counts) > 100


def test_a_worm_holds_its_load_between_lowering_and_raising():
    assert break_away(98.1, Gear(0.4, -0.2, 1.0)) == pytest.approx((-20.62, 246.25))
