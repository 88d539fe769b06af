import numpy as np
import pinocchio as pin
from mechanisms import (
    add_link,
    bar,
    four_bar,
    grounded_model,
    pin_friction,
)
from scipy.optimize import root

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.friction.balance import Balance
from pinfric.friction.least_use import make_rest
from pinfric.friction.problem import Modes, Problem, empty_problem
from pinfric.friction.rest import Mechanism, solve_modes

#: Rows of coordinates that have none, see `gears.write_rows`.
NO_GEARS = np.empty((0, 3))


def random_problem(seed, nc=4, strength=0.15, shared=False, static=1.2) -> Problem:
    """A coupled problem of the kind a robot makes; `shared`: two sites on coordinate 0."""
    rng = np.random.default_rng(seed)
    shared = int(shared)
    ns = nc + shared
    coordinate = np.r_[np.arange(nc), np.zeros(shared, dtype=int)].astype(np.int64)
    ratio = np.r_[np.ones(nc), -np.ones(shared) * 0.7]
    contact_entry = np.sort(np.r_[np.arange(ns), rng.integers(0, ns, size=nc)]).astype(np.int64)
    p = empty_problem(coordinate, ratio, contact_entry, rng.uniform(0, 0.5, ns))
    A = rng.normal(size=(nc, nc))
    p.rate_slope[:] = A @ A.T + 0.3 * np.eye(nc)
    p.rate_free[:] = rng.normal(scale=3.0, size=nc)
    p.rate_scale[:] = np.abs(p.rate_free)
    p.contact[:, 0] = rng.normal(size=p.contact[:, 0].shape) * 2
    p.contact[:, 1:] = rng.normal(size=p.contact[:, 1:].shape)
    p.mu_slip[:] = strength * rng.uniform(0.5, 1.0, ns)
    p.mu_stick[:] = static * p.mu_slip
    p.coulomb_slip[:] = rng.uniform(0, 0.3, (ns, 2))
    p.coulomb_stick[:] = static * p.coulomb_slip
    p.drag[:] = 0.0
    return p


def strong_problem(seed, along=3, constant=0.0):
    """Friction strong enough for several solutions; contact forces along so many axes; directions.

    `constant` is the largest load-independent friction.
    """
    rng = np.random.default_rng(seed)
    p = random_problem(seed, nc=2, strength=float(rng.uniform(0.3, 1.0)))
    p.constant[:], p.coulomb_slip[:] = 0.0, constant
    p.contact[:, 0, along:], p.contact[:, 1:, along:] = 0.0, 0.0
    return p, rng.choice([-1.0, 1.0], 2)


def plain_loads(p, x):
    forces = p.contact[:, 0] + np.einsum("tce,c->te", p.contact[:, 1:], x)
    load = p.constant.copy()
    np.add.at(load, p.contact_entry, np.linalg.norm(forces, axis=1))
    return load


def plain_slip_friction(p, direction, load):
    """The slip law, written out per site and summed."""
    x = np.zeros(len(direction))
    for s, c in enumerate(p.coordinate):
        along = np.sign(p.ratio[s]) * direction[c]
        dry = p.mu_slip[s] * load[s] + p.coulomb_slip[s, 0 if along > 0 else 1]
        x[c] += p.ratio[s] * (-along * dry - p.drag[s])
    return x


def plain_limits(p, load):
    lower, upper = np.zeros(len(p.rate_free)), np.zeros(len(p.rate_free))
    for s, c in enumerate(p.coordinate):
        ends = [
            p.ratio[s] * -(p.mu_stick[s] * load[s] + p.coulomb_stick[s, 0]),
            p.ratio[s] * (p.mu_stick[s] * load[s] + p.coulomb_stick[s, 1]),
        ]
        lower[c] += min(ends)
        upper[c] += max(ends)
    return lower, upper


def plain_solve(p, stuck, direction):
    """Friction in given modes by SciPy, all unknowns at once; None if it fails."""

    def equations(x):
        slip = x - plain_slip_friction(p, direction, plain_loads(p, x))
        return np.where(stuck, p.rate_free + p.rate_slope @ x, slip)

    found = root(equations, np.zeros(len(stuck)), method="hybr", options={"xtol": 1e-13})
    return found.x if np.abs(equations(found.x)).max() < 1e-9 else None


def a_tree(nc):
    """Independent coordinates."""
    none = np.zeros(nc, dtype=bool)
    return Mechanism(False, np.eye(nc), np.arange(nc), none, none, np.zeros(nc))


def solved(p, stuck, direction):
    m = Modes.of(len(stuck), len(p.ratio))
    m.stuck[:], m.direction[:] = stuck, direction
    return solve_modes(p, m, a_tree(len(stuck))), m


G = 9.81


def random_chain(rng, pins, strong=False, cut=None):
    """A closed chain of bars in the plane, pins - 3 freedoms, friction in every pin; scene, q, P.

    Args:
        pins: their number; the first pins - 3 are driven.
        strong: mu 1.2 to 2.4 at 4 to 6 cm, where friction wedges itself.
        cut: which pin closes the loop; by default the last.
    """
    places = np.zeros((pins, 2))
    places[1:, 0] = 0.3 * np.arange(1, pins) + rng.uniform(-0.1, 0.1, pins - 1)
    places[1:, 1] = rng.uniform(-0.3, 0.4, pins - 1)
    gravity = (*(rng.normal(size=2) * 3 - [0, G]), 0.0)
    masses = rng.uniform(0.3, 2.0, pins - 1)
    mu = rng.uniform(1.2, 2.4, pins) if strong else rng.uniform(0.2, 0.8, pins)
    radius = rng.uniform(0.04, 0.06, pins) if strong else rng.uniform(0.01, 0.06, pins)
    cut = pins - 1 if cut is None else cut
    model, q = grounded_model(gravity), {}
    # bars k: pin k to pin k + 1; those before the cut hang from pin 0, those after from the last
    parent, angle, at = 0, 0.0, np.zeros(2)
    for k in range(cut):
        d = places[k + 1] - places[k]
        place = pin.SE3(np.eye(3), np.array([*at, 0.0]))
        parent = add_link(
            model, parent, pin.JointModelRZ(), place, f"pin_{k}", bar(masses[k], np.hypot(*d))
        )
        q[f"pin_{k}"], angle = np.arctan2(d[1], d[0]) - angle, np.arctan2(d[1], d[0])
        at = np.array([np.hypot(*d), 0.0])
    a = {"link": f"pin_{cut - 1}" if cut else "ground", "xyz": [*at, 0.0]}
    parent, angle, at = 0, 0.0, places[-1]
    for k in range(pins - 1, cut, -1):
        d = places[k - 1] - places[k]
        place = pin.SE3(np.eye(3), np.array([*at, 0.0]))
        parent = add_link(
            model, parent, pin.JointModelRZ(), place, f"pin_{k}", bar(masses[k - 1], np.hypot(*d))
        )
        q[f"pin_{k}"], angle = np.arctan2(d[1], d[0]) - angle, np.arctan2(d[1], d[0])
        at = np.array([np.hypot(*d), 0.0])
    b = {"link": f"pin_{cut + 1}" if cut < pins - 1 else "ground", "xyz": [*at, 0.0]}
    loop = {"name": f"pin_{cut}", "kind": "planar_pin", "a": a, "b": b}
    friction = {f"pin_{k}": pin_friction(mu[k] / 1.5, radius[k], static=mu[k]) for k in range(pins)}
    bars = [f"pin_{k}" if k < cut else f"pin_{k + 1}" for k in range(pins - 1)]
    forces = [
        {
            "force": {
                "name": f"push_{k}",
                "link": bars[k],
                "xyz": [0.1, 0.0, 0.0],
                "direction": [0.3, 1, 0],
            }
        }
        for k in range(pins - 3)
    ]
    drives = forces if cut != pins - 1 else [{"joint": f"pin_{k}"} for k in range(pins - 3)]
    scene = pf.Scene(model=model, friction=friction, loops=[loop], actuators=drives)
    order = list(model.names)[1:]
    return scene, scene.close(np.array([q[name] for name in order]))


def near_the_limit(rng, scene, q):
    """Efforts around the holding ones: the frictionless and a random push that is scaled to it."""
    still = np.zeros((1, scene.model.nv))
    balance = pf.inverse_dynamics(scene, q[None], still, still).effort_frictionless[0]
    push = rng.normal(size=len(balance))
    push *= 0.02 * np.abs(balance).max() / np.linalg.norm(push)
    use = pf.holds(scene, q, balance + push).use
    return balance, push * rng.uniform(0.75, 1.3) / use


def resting_six_bar(seed):
    """(Rest, problem) of a random chain of 6 pins that rests under its weight."""
    rng = np.random.default_rng(seed)
    scene, q = random_chain(rng, 6)
    balance, push = near_the_limit(rng, scene, q)
    ws = Workspace(scene)
    ws.modes.stuck[:] = True
    ws.assemble(q, np.zeros(ws.nv), balance + push, None)
    every = np.arange(len(ws.problem.rate_free))
    balance = Balance.of_rates(ws.problem, ws.mechanism.factor, every)
    return make_rest(ws.problem, every, balance)[0], ws


def two_that_share(rng, contact=1.0):
    """Problem and factor of two joints that share one freedom, and load each other in planes."""
    ws = Workspace(four_bar()[0])
    p = ws.problem._replace(
        rate_free=np.zeros(2),
        rate_slope=np.zeros((2, 2)),
        rate_scale=np.ones(2),
        contact=np.concatenate(
            [rng.normal(size=(2, 1, 3)), contact * rng.normal(size=(2, 2, 3))], axis=1
        )
        * [1, 1, 0],
        contact_entry=np.arange(2),
        constant=np.zeros(2),
        coordinate=np.arange(2),
        ratio=np.ones(2),
        mu_stick=rng.uniform(0.1, 0.6, 2),
        coulomb_stick=np.zeros((2, 2)),
        mu_slip=np.zeros(2),
        coulomb_slip=np.zeros((2, 2)),
        drag=np.zeros(2),
    )
    factor = rng.normal(size=(1, 2))
    p.rate_slope[:] = factor.T @ factor
    p.rate_free[:] = factor[0] * rng.uniform(0.0, 1.5)
    return p, factor


def grid_use(p, factor, reaches, count=20001):
    """The least use of two joints that share one freedom, along the line of equilibria."""
    x0 = -np.linalg.lstsq(p.rate_slope, p.rate_free, rcond=1e-9)[0]
    along, least = np.array([-factor[0, 1], factor[0, 0]]) / np.linalg.norm(factor), np.inf
    for reach in reaches:
        x = x0 + np.linspace(-reach, reach, count)[:, None] * along
        force = p.contact[:, :1] + x @ p.contact[:, 1:]  # (2, count, 3)
        limit = p.mu_stick * np.sqrt((force * force).sum(axis=2)).T
        limit = limit + np.where(x > 0.0, p.coulomb_stick[:, 1], p.coulomb_stick[:, 0])
        least = min(least, float((np.abs(x) / limit).max(axis=1).min()))
    return least
