"""Random trees and linkages of pins in the plane, at rest and in motion, and all their modes.

    python tests/judges/planar_states.py 1000 2000

Newton and Euler bar by bar in absolute coordinates (`pin_chains.PinChain`), plain NumPy: no
Pinocchio, no pinfric. One acceleration obeys the laws, because static and kinetic friction are
equal and friction contracts.
"""

import sys
import warnings
from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    TESTS = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(TESTS), str(TESTS / "helpers")]
from judges.pin_chains import PinChain, random_chain

import pinfric as pf

#: Loops of one freedom: of three bars, and more that each add two.
ONE_FREEDOM = [(4,), (4, 3), (4, 3, 3), (4, 3, 3, 3)]
#: Pins of trees, and how often of a hundred: 3^12 modes take half a minute.
_PINS = [2, 3, 4, 5, 6, 7, 9, 10, 11]
_OFTEN = [20, 20, 20, 20, 10, 7, 1.5, 1, 0.5]
#: What rounding leaves, as a share of the terms.
ROUNDING = 1e-9
#: Modes that are solved at once.
_AT_ONCE = 20_000


class Moving:
    """One state of a chain with torques: accelerations and forces as maps of the pins' friction.

    Args:
        chain: the bars. rate: (np,) of each pin, of the child relative to the parent; of a loop's
            pin of its first bar relative to its second. torque: (na,) of the drives.
    """

    def __init__(self, chain: PinChain, rate: np.ndarray, torque: np.ndarray) -> None:
        nb, pins = len(chain.parent), len(chain.radius)
        bars, where = chain.joined()
        spin = np.zeros(nb)  # of each bar
        for b, parent in enumerate(chain.parent):
            spin[b] = rate[b] + (spin[parent] if parent >= 0 else 0.0)
        self.chain, self.rate = chain, rate
        A = np.zeros((3 * nb + 2 * pins, 3 * nb + 2 * pins))  # of accelerations, forces
        right = np.zeros((len(A), 1 + pins))
        for b in range(nb):
            A[3 * b : 3 * b + 3, 3 * b : 3 * b + 3] = np.diag([1, 1, 1e-2]) * -chain.mass[b]
            right[3 * b : 3 * b + 2, 0] = -chain.mass[b] * chain.gravity
        for k, pair in enumerate(bars):
            on, row = slice(3 * nb + 2 * k, 3 * nb + 2 * k + 2), 3 * nb + 2 * k
            for bar, sign in zip(pair, (1.0, -1.0), strict=True):
                if bar < 0:
                    continue
                r = where[k] - chain.center[bar]
                turn = np.array([-r[1], r[0]])
                A[3 * bar : 3 * bar + 2, on] += sign * np.eye(2)
                A[3 * bar + 2, on] += sign * turn
                right[3 * bar + 2, 1 + k] -= sign
                if k in chain.drives:
                    right[3 * bar + 2, 0] -= sign * torque[chain.drives.index(k)]
                A[row : row + 2, 3 * bar : 3 * bar + 2] += sign * np.eye(2)
                A[row : row + 2, 3 * bar + 2] += sign * turn
                right[row : row + 2, 0] += sign * spin[bar] ** 2 * r
        x = np.linalg.solve(A, right)
        turning = np.vstack([x[2 : 3 * nb : 3], np.zeros(1 + pins)])  # the last: the ground
        #: (np, 1 + np) relative angular accelerations, (np, 2, 1 + np) forces
        self.relative = turning[bars[:, 0]] - turning[bars[:, 1]]
        self.force = x[3 * nb :].reshape(pins, 2, -1)

    def load(self, phi: np.ndarray) -> np.ndarray:
        """(n, np) limits of friction where friction is phi (n, np)."""
        force = self.force[:, :, 0] + np.einsum("tek,nk->nte", self.force[:, :, 1:], phi)
        limit = self.chain.mu * self.chain.radius * np.linalg.norm(force, axis=2)
        return np.asarray(limit + self.chain.dry)

    def contraction(self) -> float:
        """Below 1 the passes of `solve` converge where everything slips."""
        slope = np.linalg.norm(self.force[:, :, 1:], axis=1)
        matrix = self.chain.mu * self.chain.radius[:, None] * slope
        return float(np.abs(np.linalg.eigvals(matrix)).max())

    def acceleration(self, phi: np.ndarray) -> np.ndarray:
        """(n, np) relative accelerations under friction phi (n, np)."""
        return np.asarray(self.relative[:, 0] + phi @ self.relative[:, 1:].T)

    def solve(self, mode: np.ndarray) -> np.ndarray:
        """(n, np) friction in modes (n, np): way of slip, 0 where a pin sticks.

        If not all friction of sticking pins can be chosen, that of least size is taken.
        """
        phi, stuck = np.zeros(mode.shape), mode == 0
        matrix = np.where(stuck[:, :, None], self.relative[:, 1:], np.eye(mode.shape[1]))
        inverse = (
            np.linalg.pinv(matrix, rcond=1e-10)
            if self.chain.close.size
            else (np.linalg.inv(matrix))
        )
        for _ in range(300):
            right = np.where(stuck, -self.relative[:, 0], -mode * self.load(phi))
            new = np.einsum("nij,nj->ni", inverse, right)
            change, phi = np.abs(new - phi).max(), new
            if change <= 1e-14 * np.abs(phi).max():
                break
        assert change <= 1e-10 * np.abs(phi).max()
        return phi

    def answers(self) -> np.ndarray:
        """(n, np) accelerations of the modes of an open chain that obey the laws, each once."""
        rest = np.flatnonzero(self.rate == 0.0)
        found: list[np.ndarray] = []
        every = product((-1, 0, 1), repeat=len(rest))
        while block := [mode for mode, _ in zip(every, range(_AT_ONCE), strict=False)]:
            mode = np.tile(np.sign(self.rate), (len(block), 1))
            mode[:, rest] = block
            phi = self.solve(mode)
            a, limit = self.acceleration(phi), self.load(phi)
            size = np.abs(self.relative[:, 0]) + np.abs(phi) @ np.abs(self.relative[:, 1:].T)
            slack = ROUNDING * np.abs(phi).max(axis=1, keepdims=True)
            holds = np.abs(phi) <= limit + slack
            slips = mode * a >= -ROUNDING * size
            good = np.where(mode == 0, holds, slips)[:, rest].all(axis=1)
            for one in np.where(mode == 0, 0.0, a)[good]:
                apart = (np.abs(one - other).max() / np.abs(other).max() for other in found)
                if not any(share <= 1e-7 for share in apart):
                    found.append(one)
        return np.array(found)


def random_planar_tree(seed: int, pins: int, connected: bool = False) -> PinChain:
    """Return bars that hang from the ground or from each other by one pin each, depth first.

    `connected`: only the first hangs from the ground.
    """
    rng = np.random.default_rng(seed)
    parent, path = np.full(pins, -1), [-1]
    for b in range(pins):
        least = int(connected and b > 0)
        del path[1 + rng.integers(least, len(path)) :]  # the last bar or one that carries it
        parent[b] = path[-1]
        path.append(b)
    place = np.zeros((pins, 2))
    for b in range(pins):
        place[b] = rng.uniform(-0.5, 0.5, 2) + (place[parent[b]] if parent[b] >= 0 else 0.0)
    none = np.zeros((0, 2))
    chain = PinChain(
        parent, place, none.astype(int), none, rng.uniform(0.2, 3.0, pins),
        place + rng.uniform(-0.3, 0.3, (pins, 2)), tuple(range(pins)), rng.uniform(0.1, 1.0),
        rng.uniform(0.01, 0.05, pins), rng.choice([0.0, 0.3]) * rng.uniform(0.0, 1.0, pins),
    )  # fmt: skip
    worst = Moving(chain, np.zeros(pins), np.zeros(pins)).contraction()
    return chain.with_radius(min(1.0, 0.5 / worst) * chain.radius)


def tree_state(seed: int) -> tuple[Moving, np.ndarray]:
    """Return a tree with some pins at rest, and the torques of its drives."""
    rng = np.random.default_rng([seed, 1])
    pins = int(rng.choice(_PINS, p=np.array(_OFTEN) / sum(_OFTEN)))
    chain = random_planar_tree(seed, pins)
    rate = np.where(rng.random(pins) < rng.choice([0.0, 0.3]), rng.uniform(-3.0, 3.0, pins), 0.0)
    held = chain.balance()[1][:, 0]  # holds it without friction
    torque = held + rng.choice([0.3, 1.0, 3.0]) * rng.normal(size=pins) * (0.1 + 0.2 * np.abs(held))
    return Moving(chain, rate, torque), torque


def loop_state(seed: int) -> tuple[Moving, np.ndarray, np.ndarray | None]:
    """Return a linkage of one freedom, its torque, and the ends of those that hold it at rest."""
    rng = np.random.default_rng([seed, 2])
    chain = random_chain(seed, ONE_FREEDOM[seed % 4], rng.choice([0.1, 0.3, 0.8]), 0.5)
    rest = Moving(chain, np.zeros(len(chain.radius)), np.zeros(1))
    chain = chain.with_radius(min(1.0, 0.7 / rest.contraction()) * chain.radius)
    corners = chain.every_corner()[:, 0]
    ends = np.array([corners.min(), corners.max()])
    torque = rng.uniform(*(ends.mean() + np.array([-1.5, 1.5]) * (ends[1] - ends[0])), 1)
    if rng.random() < 0.6:
        return Moving(chain, 0 * rest.rate, torque), torque, ends
    way = rest.relative[:, 1 + chain.drives[0]]  # any torque accelerates along the one freedom
    rate = rng.choice([-1.0, 1.0]) * 2.0 * way / np.abs(way).max()
    return Moving(chain, rate, torque), torque, None


def expected(kind: str, seed: int) -> tuple[Moving, np.ndarray, np.ndarray]:
    """Return a state, its torques, and the accelerations (n, np) that obey the laws."""
    if kind == "tree":
        state, torque = tree_state(seed)
        return state, torque, state.answers()
    state, torque, ends = loop_state(seed)
    if ends is None:
        phi = state.solve(np.sign(state.rate)[None])
        return state, torque, state.acceleration(phi)
    if ends[0] <= torque[0] <= ends[1]:
        return state, torque, np.zeros((1, len(state.rate)))
    way = np.sign(torque[0] - ends.mean()) * np.sign(state.relative[:, 1 + state.chain.drives[0]])
    return state, torque, state.acceleration(state.solve(way[None]))


def compare(kind: str, seed: int) -> str:
    """Return "same", or what pinfric says instead of the one acceleration that obeys the laws."""
    state, torque, answers = expected(kind, seed)
    if len(answers) != 1:
        return f"the judge finds {len(answers)}"
    chain = state.chain
    scene, nb = chain.scene(), len(chain.parent)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = pf.forward_dynamics(scene, np.zeros(nb), state.rate[:nb], torque)
            obeys = pf.holds(scene, np.zeros(nb), torque) if not state.rate.any() else None
    except pf.PinfricError as error:
        return f"WRONG {type(error).__name__}: {error}"
    apart = np.abs(found.a - answers[0, :nb]).max()
    if not apart <= 1e-7 * np.abs(state.relative[:, 0]).max():
        return f"WRONG by {apart:.3g}: {found.a} for {answers[0, :nb]}"
    if obeys is not None and obeys.held == bool(answers.any()):
        return f"WRONG holds {obeys}: {answers[0]}"
    return "same"


def main() -> None:
    """Count outcomes of the seeds of the command line."""
    counts: Counter[str] = Counter()
    for seed in range(int(sys.argv[1]), int(sys.argv[2])):
        for kind in ("tree", "loop"):
            says = compare(kind, seed)
            counts[f"{kind} {says if says == 'same' else says.split(':')[0]}"] += 1
            if says != "same":
                print(kind, seed, says, flush=True)
    print(dict(counts))


if __name__ == "__main__":
    main()
