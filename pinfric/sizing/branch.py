"""The lightest set of drives whose whole arm swings no slower than a given frequency, exactly.

With the motors held the arm swings on its gears. Its lowest frequency is at least f if, at every
pose,

    lambda_max(K^-1/2 M(q) K^-1/2) <= (2 pi f)^-2,

which falls with every stiffness K and rises with every drive's mass. The stiffest and the lightest
drive at each open joint bound what a partial set can reach, so branch and bound is exact.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

#: Poses, of a motion's, at which every set is looked at: the worst so far.
_POSES = 8


class SwingingArm:
    """Mass matrices along a motion, linear in the drives' masses.

    Args:
        still: (P, n, n) M without drives, of the joints that have gears. per_mass: (n, P, n, n)
            what 1 kg at each joint's drive adds. frequency: f, Hz.
    """

    def __init__(self, still: np.ndarray, per_mass: np.ndarray, frequency: float) -> None:
        self.still, self.per_mass = still, per_mass
        self.limit = (2 * np.pi * frequency) ** -2.0
        self.hard: list[int] = []

    def slowest(
        self, masses: np.ndarray, stiffness: np.ndarray, poses: list[int] | None = None
    ) -> np.ndarray:
        """Return (P,) lambda_max of a set of drives, s^2."""
        looked_at = slice(None) if poses is None else poses
        M = self.still[looked_at] + np.einsum("k,kpij->pij", masses, self.per_mass[:, looked_at])
        root = stiffness**-0.5
        return np.linalg.eigvalsh(M * root[:, None] * root)[:, -1]

    def swings(self, masses: np.ndarray, stiffness: np.ndarray, whole: bool = True) -> bool:
        """Return whether a set is stiff enough: at every pose, or at the hardest known ones."""
        if self.hard and (self.slowest(masses, stiffness, self.hard) > self.limit).any():
            return False
        if not whole:
            return True
        slowest = self.slowest(masses, stiffness)
        worst = int(slowest.argmax())
        if slowest[worst] <= self.limit:
            return True
        self.hard = [worst, *self.hard][:_POSES]
        return False


def stiff_enough(
    arm: SwingingArm, fronts: Sequence[Sequence[tuple[float, float, float]]]
) -> tuple[list[int] | None, int]:
    """Return the lightest choice, one of each front, and how many sets were looked at.

    Args:
        fronts: of each joint (mass, stiffness, added mass) of its drives, kg and N m/rad; the added
            mass is what the robot's links do not hold already.
    """
    n = len(fronts)
    table = [np.array(front, dtype=float).reshape(-1, 3) for front in fronts]
    if any(not len(front) for front in table):
        return None, 0
    least = np.array([front[:, 0].min() for front in table])
    added = np.array([front[:, 2].min() for front in table])
    stiffest = np.array([front[:, 1].max() for front in table])
    lightest = np.append(np.cumsum(least[::-1])[::-1], 0.0)
    best, chosen, looked = np.inf, None, 0

    def look(k: int, picked: list[int], mass: float) -> None:
        nonlocal best, chosen, looked
        if mass + lightest[k] >= best:
            return
        looked += 1
        masses = np.array([table[j][p, 2] for j, p in enumerate(picked)] + list(added[k:]))
        stiffness = np.array([table[j][p, 1] for j, p in enumerate(picked)] + list(stiffest[k:]))
        if not arm.swings(masses, stiffness, whole=k in (0, n)):
            return
        if k == n:
            best, chosen = mass, picked
            return
        for p in np.argsort(table[k][:, 0], kind="stable").tolist():
            look(k + 1, [*picked, p], mass + table[k][p, 0])

    look(0, [], 0.0)
    return chosen, looked
