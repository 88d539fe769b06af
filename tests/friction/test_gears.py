"""Gears as entries of a friction problem, against M r = h + t + y and u - I r = F(t) of each."""

from itertools import product

import numpy as np
import pytest
from friction_cases import a_tree

from pinfric.friction import gears
from pinfric.friction.given_modes import slide, try_modes
from pinfric.friction.problem import Modes, empty_problem
from pinfric.friction.rest import solve_modes

N = 4
#: Coordinate of each gear: two share one.
ON = (2, 0, 0)


class Train:
    """A random machine of N coordinates, each with a bearing, and gears on some of them."""

    def __init__(self, seed, back=(0.3, 0.9), inertia=(0.5, 2.0), loads=5, on=ON):
        rng = np.random.default_rng(seed)
        ng = self.ng = len(on)
        self.on = np.array(on)
        A = rng.normal(size=(N, N))
        self.M, self.h = A @ A.T + np.eye(N), rng.normal(scale=4.0, size=N)
        self.u, self.inertia = rng.normal(scale=4.0, size=ng), rng.uniform(*inertia, ng)
        self.loss, self.back = rng.uniform(1.05, 1.5, ng), rng.uniform(*back, ng)
        self.idle = rng.uniform(0.05, 0.3, ng)
        self.way = rng.choice([-1.0, 1.0], N)
        self.S = np.eye(N)[self.on]
        coordinate = np.r_[np.arange(N), self.on].astype(np.int64)
        owner = np.sort(rng.integers(0, N, loads)).astype(np.int64)
        p = empty_problem(coordinate, np.ones(N + ng), owner, np.zeros(N + ng), ng, 2)
        R = np.linalg.inv(self.M + self.S.T @ np.diag(self.inertia) @ self.S)
        p.rate_slope[:] = 0.5 * (R + R.T)
        p.rate_free[:] = p.rate_slope @ (self.h + self.S.T @ self.u)
        p.rate_scale[:] = np.abs(p.rate_free)
        p.contact[:, 0] = rng.normal(size=(loads, 3))
        p.contact[:, 1:] = 0.2 * rng.normal(size=(loads, N, 3))
        p.mu_slip[:N] = 0.1
        p.coulomb_slip[:N] = rng.uniform(0.0, 0.3, (N, 2))
        p.gear_rotor[:] = np.column_stack([self.u, self.inertia])
        for g in range(ng):
            for law in range(4):
                way = 1.0 if law % 2 == 0 else -1.0
                below, above = (self.back[g], self.loss[g])[:: int(way)]
                p.gear_lines[g, law] = (
                    (below, way * self.idle[g], -np.inf),
                    (above, way * self.idle[g], 0.0),
                )
        p.gear_held[:], p.gear_held[:, 0] = (np.inf, -np.inf), (-100.0, 100.0)
        self.problem, self.modes = p, Modes.of(N, N + ng, ng)
        self.modes.direction[:] = self.way

    def set_back(self, g, slope):
        """Set the slope of a gear's line when it is driven backward."""
        self.back[g] = slope
        self.problem.gear_lines[g, 0::2, 0, 0] = self.problem.gear_lines[g, 1::2, 1, 0] = slope

    def stick(self, which):
        """Let coordinates stick."""
        self.modes.stuck[list(which)], self.modes.direction[list(which)] = True, 0.0

    def coupling(self, stuck):
        """W (ng, ng): rates per effort, without rotors, while coordinates stick."""
        free = np.setdiff1d(np.arange(N), stuck)
        W = np.zeros((N, N))
        W[np.ix_(free, free)] = np.linalg.inv(self.M[np.ix_(free, free)])
        return W

    def torque(self, t, way):
        """F(t): the torque that arrives at each gear for the effort it delivers.

        Regularized motion counts a share |way| of its losses.
        """
        slope = np.where(t * way > 0.0, self.loss, self.back)
        return t + np.abs(way) * (slope - 1.0) * t + way * self.idle

    def contraction(self):
        """Spectral radius of y -> x -> loads -> y at the modes' solution, where nothing sticks."""
        p, way, t = self.problem, self.way[self.on], self.modes.effort
        slope = 1.0 + np.abs(way) * (np.where(t * way > 0.0, self.loss, self.back) - 1.0)
        of_rate = self.S.T @ np.diag(self.inertia * (1.0 - 1.0 / slope)) @ self.S
        mass = self.M + self.S.T @ np.diag(self.inertia / slope) @ self.S
        x_by_y = np.eye(N) + of_rate @ np.linalg.inv(mass)
        force = p.contact[:, 0] + np.einsum("tce,c->te", p.contact[:, 1:], self.modes.friction)
        unit = force / np.linalg.norm(force, axis=1)[:, None]
        load_by_x = np.zeros((N, N))
        np.add.at(load_by_x, p.contact_entry, np.einsum("tce,te->tc", p.contact[:, 1:], unit))
        return np.abs(np.linalg.eigvals(0.1 * self.way[:, None] * load_by_x @ x_by_y)).max()

    def check(self, stuck=()):
        """Assert that the modes' solution is one of the machine."""
        p, m = self.problem, self.modes
        force = p.contact[:, 0] + np.einsum("tce,c->te", p.contact[:, 1:], m.friction)
        load = np.bincount(p.contact_entry, np.linalg.norm(force, axis=1), N)
        dry = np.where(self.way > 0, p.coulomb_slip[:N, 0], p.coulomb_slip[:N, 1])
        y = -self.way * (0.1 * load + dry)
        left = self.M @ m.rate - self.h - self.S.T @ m.effort - y
        for c in range(N):
            if c in stuck:
                assert m.rate[c] == pytest.approx(0.0, abs=1e-12)
            else:
                assert left[c] == pytest.approx(0.0, abs=1e-11)
        moves = [g for g in range(self.ng) if self.on[g] not in stuck]
        arrives = self.u - self.inertia * m.rate[self.on]
        wanted = self.torque(m.effort, self.way[self.on])
        np.testing.assert_allclose(arrives[moves], wanted[moves], atol=1e-11)


@pytest.mark.parametrize("share", [1.0, 0.4])
@pytest.mark.parametrize("seed", range(12))
def test_what_slides_obeys_its_gears_and_bearings(seed, share):
    train = Train(seed)
    train.way *= share
    train.modes.direction[:] = train.way
    assert slide(train.problem, train.modes)
    train.check()
    assert 1 <= train.modes.figures[1] <= 6  # passes of Newton's method
    assert train.contraction() <= train.modes.figures[0] < 0.9
    assert slide(train.problem, train.modes)
    assert train.modes.figures[1] == 0.0  # it starts from the last solution


@pytest.mark.parametrize("stuck", [(3,), (2,), (0, 3)])
@pytest.mark.parametrize("least", [0.3, 0.0])  # 0: driven backward it needs its idle torque only
@pytest.mark.parametrize("seed", range(8))
def test_given_modes_obey_gears_beside_what_sticks(seed, least, stuck):
    train = Train(seed, back=(least, 0.5))
    if least == 0.0:
        train.set_back(1, 0.0)
    train.stick(stuck)
    assert solve_modes(train.problem, train.modes, a_tree(N))[0]
    train.check(stuck)


@pytest.mark.parametrize("within", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_without_gears_the_bearings_friction_leads_to_the_same_rates(seed, within):
    train = Train(seed)
    p, m = train.problem, train.modes
    m.stuck[2] = True  # its gear is the first one, and holds efforts from 1 to 3 above u
    p.coulomb_stick[N] = -1.0, 3.0
    _, rows = gears.lines_and_rows(p, m)
    plain, of_y = gears.without_gears(p, m, rows, within)
    y = np.random.default_rng(seed).normal(size=N)
    x = of_y @ np.r_[1.0, y]
    rate = p.rate_free + p.rate_slope @ x
    np.testing.assert_allclose(plain.rate_free + plain.rate_slope @ y, rate, atol=1e-12)
    np.testing.assert_allclose(
        plain.contact[:, 0] + np.einsum("tce,c->te", plain.contact[:, 1:], y),
        p.contact[:, 0] + np.einsum("tce,c->te", p.contact[:, 1:], x),
        atol=1e-12,
    )
    # M r = h + t + y on the lines of coordinate 0, each t from its own
    t = [
        (train.u[g] - train.inertia[g] * rate[0] - offset) / slope
        for g in (1, 2)
        for slope, offset in [p.gear_lines[g, 0 if train.way[0] > 0 else 1, 1, :2]]
    ]
    assert (train.M @ rate - train.h)[0] == pytest.approx(sum(t) + y[0], abs=1e-11)
    # counted from `shift`, the same friction is allowed
    shift, (below, above) = x[2] - y[2], plain.coulomb_stick[N]
    assert (shift - below, shift + above) == pytest.approx((1.0, 3.0))
    assert shift == pytest.approx(2.0 if within else 1.0)
    others = np.arange(N + 3) != N
    np.testing.assert_array_equal(plain.coulomb_stick[others], p.coulomb_stick[others])


@pytest.mark.parametrize("stuck", [(), (3,)])
@pytest.mark.parametrize("way", [1.0, 0.0])  # 0: at rest, whichever way it goes
@pytest.mark.parametrize("seed", range(4))
def test_a_gear_jams_below_the_inertia_that_is_named(seed, way, stuck):
    def jam(inertia):
        train = Train(seed, inertia=(inertia, inertia), on=(0, 1, 2))
        train.set_back(1, -0.4)
        train.modes.direction[:] *= way
        train.stick(stuck)
        root = np.sqrt(train.inertia)
        E = np.diag(train.back) + root[:, None] * train.coupling(stuck)[:3, :3] * root
        return gears.jam(train.problem, train.modes), np.linalg.eigvalsh(E)[0]

    found, least = jam(0.02)
    assert found.gear == 1
    assert found.eigenvalue == pytest.approx(least)
    train = Train(seed, inertia=(0.02, 0.02), on=(0, 1, 2))
    root, W = np.full(3, np.sqrt(0.02)), train.coupling(stuck)[:3, :3]
    for factor in (0.999, 1.001):
        root[1] = np.sqrt(factor * found.inertia[1])
        E = np.diag([train.back[0], -0.4, train.back[2]]) + root[:, None] * W * root
        assert (np.linalg.eigvalsh(E)[0] > 0.0) == (factor > 1.0)
    assert jam(5.0)[1] > 0.0
    assert jam(5.0)[0] is None


def test_gears_that_lock_each_other_need_in_proportion_to_what_each_needs_alone():
    """Where they do not load each other, each exactly that: least slope + I / M > 0."""
    train = Train(2, inertia=(0.1, 0.1), on=(0, 1))
    M, R = np.array([4.0, 9.0]), np.eye(N)
    R[:2, :2] = np.diag(1.0 / (M + 0.1))
    train.problem.rate_slope[:] = R
    for g, slope in enumerate((-0.4, -0.7)):
        train.set_back(g, slope)
    found = gears.jam(train.problem, train.modes)
    assert found.gear == 1
    assert found.eigenvalue == pytest.approx(0.1 / 9.0 - 0.7)
    assert found.inertia == pytest.approx({0: 0.4 * 4.0, 1: 0.7 * 9.0}, rel=2e-9)


@pytest.mark.parametrize("stuck", [(), (3,)])
@pytest.mark.parametrize("seed", range(30))
def test_choices_are_the_lines_that_fit_and_stable_if_their_matrix_is_positive(seed, stuck):
    train = Train(seed, back=(-0.9, 0.3), inertia=(0.02, 0.6), on=(0, 1, 2))
    p, m = train.problem, train.modes
    p.mu_slip[:] = 0.0  # all is linear
    train.stick(stuck)
    dry = np.where(train.way > 0, p.coulomb_slip[:N, 0], p.coulomb_slip[:N, 1])
    force, W = train.h - train.way * dry, train.coupling(stuck)
    root, found = np.sqrt(train.inertia), {}
    for sides in product((0, 1), repeat=3):  # each gear's effort below or above zero
        lines = np.array(
            [p.gear_lines[g, 0 if train.way[g] > 0 else 1, side] for g, side in enumerate(sides)]
        )
        A = np.diag(lines[:, 0]) + train.inertia[:, None] * W[:3, :3]
        t = np.linalg.solve(A, train.u - lines[:, 1] - train.inertia * (W @ force)[:3])
        if ((t > 0) == np.array(sides, dtype=bool)).all():
            scaled = np.diag(lines[:, 0]) + root[:, None] * W[:3, :3] * root
            found[sides] = bool(np.linalg.eigvalsh(scaled)[0] > 0.0)
    # the modes are solved on some lines, here on those of no loss
    A = np.eye(3) + train.inertia[:, None] * W[:3, :3]
    m.effort[:] = np.linalg.solve(A, train.u - train.inertia * (W @ force)[:3])
    m.rate[:] = W @ (force + train.S.T @ m.effort)
    said = {
        tuple((t > 0).astype(int).tolist()): stable for t, stable in gears.choices_of_lines(p, m)
    }
    assert said == found


@pytest.mark.parametrize(
    ("needed", "holds", "effort"), [(1.0, (2.0, 5.0), 2.0), (-0.8, (-3.0, -1.0), -1.0)]
)
def test_a_gear_at_rest_holds_where_the_bearing_beside_it_has_most_room(needed, holds, effort):
    train = Train(5, on=(0, 2))
    p, m = train.problem, train.modes
    train.stick((2,))
    p.coulomb_stick[2] = 1.0, 0.5  # the bearing's, to which 0.5 of the load comes
    p.mu_stick[2], m.load[2] = 0.25, 2.0
    p.gear_held[1, :3] = (-3.0, -1.0), (0.0, 0.0), (2.0, 5.0)
    m.friction[2] = needed - train.u[1]
    lines, _ = gears.lines_and_rows(p, m)
    for changed in (1, 0):
        assert gears.fit(p, m, lines, True)[1] == changed
        assert m.effort[1] == effort
        below, above = p.coulomb_stick[N + 1]
        assert (train.u[1] - below, train.u[1] + above) == pytest.approx(holds)
    p.coulomb_stick[N + 1] = 0.0
    gears.hold_chosen(p, m)
    assert p.coulomb_stick[N + 1].tolist() == [below, above]


@pytest.mark.parametrize("needed", [-3.0, -1.0, 0.3, 4.0])
def test_margins_of_a_gear_at_rest_are_the_largest_over_what_its_bearing_leaves(needed):
    train = Train(6, back=(-0.5, 0.3), on=(0, 2))
    p, m = train.problem, train.modes
    train.stick((2,))
    p.coulomb_stick[2] = 1.2, 0.7
    m.friction[2] = needed - train.u[1]
    t = np.append(needed + np.array([-0.7, 1.2]), 0.0)
    t = t[(t >= needed - 0.7) & (t <= needed + 1.2)]  # linear between these
    forward, backward = (
        np.where(way * t > 0, train.loss[1], train.back[1]) * t + way * train.idle[1]
        for way in (1.0, -1.0)
    )
    wanted = train.u[1] - backward.min(), forward.max() - train.u[1]
    assert gears.gear_margins(p, m, 1) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("right", "sides"),
    [(-1e-6, [-1]), (-1e-13, [-1, 1]), (0.0, [-1, 1]), (1e-13, [-1, 1]), (1e-6, [1])],
)
def test_an_effort_where_two_lines_meet_is_sought_on_both_but_for_rounding(right, sides):
    """(I W + slope) t = right on either line, which end and begin at t = 0."""
    train = Train(3, on=(0,))
    p, m = train.problem, train.modes
    p.mu_slip[:] = 0.0
    p.gear_rotor[0, 0] = right + train.way[0] * train.idle[0]  # u = I r + F(t), here r = t = 0
    assert [np.sign(t) for (t,), _ in gears.choices_of_lines(p, m)] == sides


def test_a_line_that_leaves_the_rates_open_is_no_choice():
    train = Train(0, inertia=(0.5, 0.5), on=(0,))
    train.M = np.eye(N)
    train.set_back(0, -0.5)  # -0.5 + I W = 0
    train.problem.rate_slope[:] = np.diag([1 / 1.5, 1.0, 1.0, 1.0])
    train.problem.mu_slip[:] = 0.0
    train.modes.effort[:], train.modes.rate[:] = 1.0, 1.0
    assert all(
        t * train.way[0] > 0 for (t,), _ in gears.choices_of_lines(train.problem, train.modes)
    )


@pytest.mark.parametrize("seed", range(4))
def test_a_solution_off_the_lines_that_are_asked_for_does_not_count(seed):
    train = Train(seed)
    p, m = train.problem, train.modes
    m.at_rest[3] = m.stuck[3] = True  # so that no other kernel takes it
    m.direction[3], p.coulomb_stick[3] = 0.0, 1e3
    assert try_modes(p, m, False) == (1, 1)
    right = m.effort.copy()
    assert try_modes(p, m, True) == (1, 1)
    for g in range(3):
        m.effort[:] = right
        m.effort[g] *= -1.0
        assert try_modes(p, m, True) == (0, 0)


def test_every_choice_of_what_gears_hold_comes_once():
    train = Train(0)
    m = train.modes
    m.stuck[:] = True
    train.problem.gear_held[0, :2] = (-3.0, -1.0), (2.0, 2.0)
    train.problem.gear_held[1, :1] = (-np.inf, np.inf)
    train.problem.gear_held[2, :3] = (-np.inf, -2.0), (0.0, 1.0), (4.0, np.inf)
    m.effort[:] = 7.0
    ways = np.array(list(gears.ways_to_hold(train.problem, m)))
    assert ways.shape == (6, 3)
    assert set(ways[:, 0]) == {-2.0, 2.0}
    assert set(ways[:, 1]) == {7.0}  # of one interval nothing is to be chosen
    below, inside, above = sorted(set(ways[:, 2]))
    assert below < -2.0
    assert inside == 0.5
    assert above > 4.0


@pytest.mark.parametrize(("beyond", "left"), [(-1e-3, 0), (1e-15, 0), (1e-10, 1), (1e-3, 1)])
def test_a_gear_leaves_its_line_where_its_effort_does_but_for_rounding(beyond, left):
    train = Train(1, on=(0,))
    p, m = train.problem, train.modes
    p.mu_slip[:] = p.coulomb_slip[:] = 0.0
    slope, offset = p.gear_lines[0, 0 if train.way[0] > 0 else 1, 0, :2]
    for t, ends in ((beyond, (-np.inf, 0.0)), (-beyond, (0.0, np.inf))):
        arrives = slope * t + offset
        m.rate[:], m.friction[:] = (train.u[0] - arrives) / train.inertia[0], t - arrives
        assert gears.fit(p, m, np.array([[slope, offset, *ends]]), False)[0] == left
        assert m.effort[0] == pytest.approx(t)
