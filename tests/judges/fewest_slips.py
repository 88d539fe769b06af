"""Joints at rest under constant friction: every set that may slip, by bounded least squares."""

from itertools import combinations

import numpy as np
from scipy.optimize import lsq_linear

_ROUNDING = 1e-9


def fewest_slips(R, r, static, kinetic):
    """Frictions (n,) with the fewest slipping joints, one for each answer; rates are r + R x.

    Slipping frictions minimize x^T S x / 2 + s^T x within their kinetic limits; in S and s the
    others are held.
    """
    n = len(r)
    for level in range(n + 1):
        found = []
        for slips in map(list, combinations(range(n), level)):
            held, x = np.setdiff1d(np.arange(n), slips), np.zeros(n)
            back = np.linalg.solve(R[np.ix_(held, held)], np.column_stack([R[held], r[held]]))
            if slips:
                S = R[np.ix_(slips, slips)] - R[np.ix_(slips, held)] @ back[:, slips]
                s = r[slips] - R[np.ix_(slips, held)] @ back[:, -1]
                L, limit = np.linalg.cholesky(S), kinetic[slips]
                goal = -np.linalg.solve(L, s)
                x[slips] = lsq_linear(L.T, goal, (-limit, limit), method="bvls", tol=1e-14).x
                if (np.abs(x[slips]) < limit * (1.0 - _ROUNDING)).any():
                    continue
            x[held] = -back[:, :-1] @ x - back[:, -1]
            if (np.abs(x[held]) <= static[held] * (1.0 + _ROUNDING)).all():
                found.append(x)
        if found:
            return found
    return []
