"""Factors on efforts by a known payload: a motor constant, unit or gear ratio as an unknown.

    y_j = s_j (Y_j theta + P_j + friction)

P_j is what the payload takes. The links' theta and friction take up s_j, as they are free; P_j
does not, so s_j is its coefficient, if some logs carry the payload and others do not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pinfric.identification.columns import Prepared, Rows, at_rows, passed
from pinfric.identification.inertias import urdf_prior
from pinfric.identification.laws import INERTIA, Law
from pinfric.identification.normal import Prior
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.described import described, quantity
from pinfric.model.scene import Scene

#: Its friction: two losses of a gear would be a factor on the load themselves, and a law that was
#: chosen beside a wrong factor may contain anything. A loss in both directions hardly moves it: of
#: the loads t/eta and eta_b t the mean is (1/eta + eta_b)/2 t, 0.99 to 1.01 t.
_LAW = Law(load="gear", side="motor")
#: Standard deviations of the URDF's links, of one joint alone and times a factor.
_FREE = 10.0
#: A factor with a larger standard error is not known, and one is wrong beyond this share and so
#: many standard errors.
_KNOWN, _LEAST, _ERRORS = 0.25, 0.05, 2.5
#: Blocks with a payload, and without, from which their difference counts.
_FEWEST = 3


@described
class EffortFactor:
    """The factor by which a joint's logged effort exceeds its true one, by a known payload."""

    name: str = quantity("the joint", heading="joint", name=True)
    value: float = quantity("logged / true effort", "1", "factor")
    low: float = quantity("lower end of its 95 % interval", "1", "from")
    high: float = quantity("upper end", "1", "to")
    standard_error: float = quantity("from block to block", "1")

    @property
    def wrong(self) -> bool:
        """Whether it is not 1."""
        return abs(self.value - 1.0) > _LEAST + _ERRORS * self.standard_error


def effort_factors(
    scene: Scene,
    logs: Sequence[Prepared],
    rows: Sequence[Rows],
    weights: Sequence[FloatArray],
) -> tuple[EffortFactor, ...]:
    """Return the factor of each joint that a known payload shows; none where logs all carry it.

    Args:
        scene: with the URDF's links. logs: what `rows` of all joints are of.
        weights: (n,) of each joint's rows.
    """
    whole = np.concatenate([log.recording.trajectory.attached.any(axis=1) for log in logs])
    if whole.all() or not whole.any():
        return ()
    payloads = [passed(log.payload, log.recording.step)[log.kept] for log in logs]
    links = urdf_prior(scene.model, kept=False)
    factors = []
    for j, (name, own) in enumerate(zip(scene.joint_names, rows, strict=True)):
        loaded = [log.recording.trajectory.attached[log.kept[log.slides[:, j]]] for log in logs]
        carried = np.concatenate([at.any(axis=1) for at in loaded])
        payload = at_rows(payloads, logs, j)
        factors.append(_factor(name, own, weights[j], links, payload, carried))
    return tuple(x for x in factors if x is not None and x.standard_error < _KNOWN)


def _factor(
    name: str,
    rows: Rows,
    weight: FloatArray,
    links: Prior,
    payload: FloatArray,
    carried: BoolArray,
) -> EffortFactor | None:
    """Return a joint's factor, or None where too little is logged with a payload or without.

    Args:
        rows, weight: of the joint. links: prior of theta.
        payload, carried: (n,) what it takes at these rows (N m or N), and whether there is one.
    """
    from scipy.special import stdtrit

    if min(np.unique(rows.block[carries]).size for carries in (carried, ~carried)) < _FEWEST:
        return None
    # the rows' efforts are less the payload times 1: what is left of it is the factor less 1
    slots = [INERTIA, *_LAW.slots]
    columns = np.column_stack((rows.rigid, rows.slots[:, slots], payload))
    prior = np.zeros(columns.shape[1])
    prior[: links.center.size] = 1.0 / (_FREE * np.maximum(links.deviation, 1e-12)) ** 2
    right = np.zeros_like(prior)
    right[: links.center.size] = (prior[: links.center.size]) * links.center
    left = columns.T @ (weight[:, None] * columns) + np.diag(prior)
    size = np.sqrt(np.diag(left)) + 1e-300
    inverse = np.linalg.pinv(left / np.outer(size, size), hermitian=True) / np.outer(size, size)
    found = inverse @ (columns.T @ (weight * rows.effort) + right)
    scores = columns * (weight * (rows.effort - columns @ found))[:, None]
    blocks, at = np.unique(rows.block, return_inverse=True)
    of_block = np.zeros((blocks.size, prior.size))
    np.add.at(of_block, at, scores)
    moved = of_block @ inverse[:, -1]
    error = float(np.sqrt(blocks.size / (blocks.size - 1.0) * (moved @ moved)))
    reach = float(stdtrit(blocks.size - 1, 0.975)) * error
    value = 1.0 + float(found[-1])
    return EffortFactor(name, value, value - reach, value + reach, error)
