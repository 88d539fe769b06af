"""Random chains and rings of pins at rest in the plane, and every corner of their friction.

Newton and Euler bar by bar in absolute coordinates, plain NumPy: no Pinocchio, no pinfric. From the
pins' friction torques phi follow their forces F and the drives' torques u; a corner has sign
sigma_k at pin k, and phi_k = sigma_k mu R |F_k(phi)|.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pinocchio as pin
from mechanisms import add_link, grounded_model, pin_friction

import pinfric as pf

GRAVITY = np.array([0.0, -9.81])


@dataclass(frozen=True)
class PinChain:
    """Bars joined by pins, in the pose in which all coordinates are 0.

    Attributes:
        parent: (nb,) bar that carries each bar, -1 the ground. place: (nb, 2) of its pin (m).
        close: (nl, 2) two bars, the second may be the ground, that a further pin joins.
        close_at: (nl, 2) its place (m).
        mass: (nb,) kg. center: (nb, 2) centres of mass (m).
        drives: bars whose pin is driven.
        mu, radius: of every pin. dry: (np,) its friction without load (N m).
        above: static friction per kinetic.
    """

    parent: np.ndarray
    place: np.ndarray
    close: np.ndarray
    close_at: np.ndarray
    mass: np.ndarray
    center: np.ndarray
    drives: tuple[int, ...]
    mu: float
    radius: np.ndarray
    dry: np.ndarray
    above: float = 1.0

    @property
    def gravity(self) -> np.ndarray:
        """(2,) m/s^2."""
        return GRAVITY

    def with_radius(self, radius: np.ndarray) -> PinChain:
        """Return the same with pins of other radii (np,)."""
        return replace(self, radius=radius)

    def joined(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the two bars (np, 2) that each pin joins, -1 the ground, and its place (np, 2)."""
        bars = np.column_stack([np.arange(len(self.parent)), self.parent])
        return np.vstack([bars, self.close]), np.vstack([self.place, self.close_at])

    def scene(self) -> pf.Scene:
        """The same as a scene of pinfric."""
        model, ids, loops = grounded_model((*GRAVITY, 0.0)), [0], []
        friction = {}

        def at(bar: int) -> np.ndarray:
            return self.place[bar] if bar >= 0 else np.zeros(2)

        for b, parent in enumerate(self.parent):
            offset = np.array([*(self.place[b] - at(parent)), 0.0])
            lever = np.array([*(self.center[b] - self.place[b]), 0.0])
            body = pin.Inertia(self.mass[b], lever, 1e-2 * self.mass[b] * np.eye(3))
            placement = pin.SE3(np.eye(3), offset)
            ids.append(
                add_link(model, ids[1 + parent], pin.JointModelRZ(), placement, f"p{b}", body)
            )
            friction[f"p{b}"] = self._friction(b)
        for k, (bars, there) in enumerate(zip(self.close, self.close_at, strict=True)):
            sides = {
                side: {"link": "ground" if bar < 0 else f"p{bar}", "xyz": [*(there - at(bar)), 0.0]}
                for side, bar in zip("ab", bars, strict=True)
            }
            loops.append({"name": f"c{k}", "kind": "planar_pin", **sides})
            friction[f"c{k}"] = self._friction(len(self.parent) + k)
        actuators = [{"joint": f"p{b}"} for b in self.drives]
        return pf.Scene(model=model, friction=friction, loops=loops, actuators=actuators)

    def _friction(self, k: int) -> dict:
        dry = {"static": self.above * self.dry[k], "kinetic": self.dry[k]}
        static = self.above * self.mu
        return {**pin_friction(self.mu, self.radius[k], static), "coulomb": dry}

    def balance(self) -> tuple[np.ndarray, np.ndarray]:
        """Return forces (np, 2, 1 + np) and torques (na, 1 + np) as maps of (1, phi)."""
        nb, pins = len(self.parent), len(self.radius)
        bars, where = self.joined()
        A = np.zeros((3 * nb, 2 * pins + len(self.drives)))
        right = np.zeros((3 * nb, 1 + pins))
        for b in range(nb):
            right[3 * b : 3 * b + 2, 0] = -self.mass[b] * GRAVITY
        for k in range(pins):
            for bar, sign in zip(bars[k], (1.0, -1.0), strict=True):
                if bar < 0:
                    continue
                x, y = where[k] - self.center[bar]
                A[3 * bar : 3 * bar + 2, 2 * k : 2 * k + 2] += sign * np.eye(2)
                A[3 * bar + 2, 2 * k : 2 * k + 2] += sign * np.array([-y, x])
                right[3 * bar + 2, 1 + k] -= sign
                if k in self.drives:
                    A[3 * bar + 2, 2 * pins + self.drives.index(k)] += sign
        x = np.linalg.solve(A, right)
        return x[: 2 * pins].reshape(pins, 2, -1), x[2 * pins :]

    def contraction(self) -> float:
        """Below 1 every corner has one solution."""
        slope = np.linalg.norm(self.balance()[0][:, :, 1:], axis=1)
        matrix = self.mu * self.radius[:, None] * slope
        return float(np.abs(np.linalg.eigvals(matrix)).max())

    def every_corner(self) -> np.ndarray:
        """Return the torques (2^np, na) at all corners."""
        torques = self.balance()[1]
        return np.asarray(torques[:, 0] + self._frictions() @ torques[:, 1:].T)

    def every_friction(self) -> tuple[np.ndarray, np.ndarray]:
        """Return least and greatest friction (np,) of each pin at all corners."""
        phi = self._frictions()
        return phi.min(axis=0), phi.max(axis=0)

    def _frictions(self) -> np.ndarray:
        """(2^np, np) friction at all corners."""
        forces = self.balance()[0]
        sign = np.array(list(product((-1.0, 1.0), repeat=len(self.radius))))
        phi, limit = np.zeros_like(sign), self.mu * self.radius
        for _ in range(3000):
            now = forces[:, :, 0] + np.einsum("tek,nk->nte", forces[:, :, 1:], phi)
            new = sign * (limit * np.linalg.norm(now, axis=2) + self.dry)
            change, phi = np.abs(new - phi).max(), new
            if change <= 1e-15 * np.abs(phi).max():
                break
        return phi


def random_chain(seed: int, loops: tuple[int, ...], mu: float, most: float = 0.95) -> PinChain:
    """Return a random chain of bars with these loops of pins.

    Args:
        loops: number of pins of the first loop, and of what each further adds; 3 or more.
        most: the radii are so large that the contraction is at most this, but no more than 0.06 m.
    """
    rng = np.random.default_rng(seed)
    while True:
        parent, place, close, close_at = [], [], [], []
        for count in loops:
            # two bodies to join: the ground, or two different bars
            bodies = [-1, *range(len(parent))]
            first, last = (-1, -1) if not parent else rng.choice(bodies, 2, replace=False)
            start, end = (
                rng.uniform(-0.6, 0.6, 2) + (place[b] if b >= 0 else 0.0) for b in (first, last)
            )
            points = start + (end - start) * np.linspace(0, 1, count)[:, None]
            points[1:-1] += rng.uniform(-0.3, 0.3, (count - 2, 2))
            before = first
            for point in points[:-1]:
                parent.append(before)
                place.append(point)
                before = len(parent) - 1
            close.append((before, last))
            close_at.append(points[-1])
        nb = len(parent)
        pins, freedoms = nb + len(loops), nb - 2 * len(loops)
        center = np.array(place) + rng.uniform(-0.3, 0.3, (nb, 2))
        drives = tuple(sorted(int(b) for b in rng.choice(nb, freedoms, replace=False)))
        radius = rng.uniform(0.3, 1.0, pins)
        mass = rng.uniform(0.2, 3.0, nb)
        arrays = map(np.array, (parent, place, close, close_at))
        one = PinChain(*arrays, mass, center, drives, mu, 0.06 * radius, np.zeros(pins))
        try:
            worst = one.contraction()
        except np.linalg.LinAlgError:
            continue
        if np.abs(one.balance()[1]).max() > 300.0:  # nearly at a dead centre
            continue
        scale = min(1.0, most * rng.uniform(0.3, 1.0) / worst)
        if scale < 0.05:
            continue
        return _depth_first(one.with_radius(scale * one.radius))


def _depth_first(chain: PinChain) -> PinChain:
    """Return the same with its bars in the order that Pinocchio's mass matrix needs."""
    order: list[int] = []
    pending = [-1]
    while pending:
        order.append(pending.pop())
        pending += np.flatnonzero(chain.parent == order[-1])[::-1].tolist()
    old = np.array(order[1:])
    new = np.append(np.argsort(old), -1)  # of the old number, the ground last
    pins = np.append(old, np.arange(len(old), len(chain.radius)))
    return replace(
        chain,
        parent=new[chain.parent[old]],
        place=chain.place[old],
        close=new[chain.close],
        mass=chain.mass[old],
        center=chain.center[old],
        drives=tuple(sorted(int(new[b]) for b in chain.drives)),
        radius=chain.radius[pins],
        dry=chain.dry[pins],
    )
