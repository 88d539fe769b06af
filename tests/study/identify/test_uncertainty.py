"""What logs say of each other, and of friction at rest, against figures worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pinfric.study.identify.columns import Rows
from pinfric.study.identify.laws import BACKWARD, FORWARD, SLOT, SLOTS
from pinfric.study.identify.normal import Fit
from pinfric.study.identify.rest import break_aways
from pinfric.study.identify.uncertainty import between_logs


@pytest.mark.parametrize(
    ("factors", "spread"),
    [
        # means 1.0 and 1.2, variance 0.02; blocks: variance 0.02 over 2 each, 0.01 taken off
        ([[1.1, 0.9], [1.3, 1.1]], 0.1),
        ([[1.0, 1.0], [1.2, 1.2]], np.sqrt(0.02)),
        ([[1.3, 0.7], [1.2, 0.8]], 0.0),
    ],
)
def test_what_blocks_of_one_log_scatter_is_no_difference_between_logs(factors, spread):
    """One joint with 2 N m of Coulomb friction, ten rows in each block."""
    factor = np.repeat(np.ravel(factors), 10)
    slots = np.zeros((40, len(SLOTS)))
    slots[:, SLOT[FORWARD]] = 1.0
    still = np.zeros(40)
    rows = Rows(
        np.zeros((40, 10)),
        slots,
        2.0 * factor,
        np.repeat(np.arange(4), 10),
        np.repeat([0, 1], 20),
        still,
        still,
        still,
    )
    fit = Fit(np.zeros(10), 2.0 * (np.arange(len(SLOTS)) == SLOT[FORWARD])[None, :])
    found = SimpleNamespace(prepared=[None, None], rows=[rows], fit=fit)
    assert between_logs(found) == pytest.approx([spread], abs=1e-9)


@pytest.mark.parametrize("side", ["motor", "joint"])
@pytest.mark.parametrize("way", [FORWARD, BACKWARD])
def test_a_gears_loss_is_taken_out_of_what_a_joint_broke_away_at(side, way):
    """A load of 10 N m, a gear that loses a tenth of it driving and driven, 2 N m of friction."""
    sign, load, loss = (1.0 if way == FORWARD else -1.0), 10.0, 0.1
    held, moved = np.minimum(np.arange(200) / 125, 1.0), np.full(75, 0.75)
    friction = 2.0 * np.tile(np.concatenate((held, moved)), 3)
    rests = np.tile(np.arange(275) < 200, 3)
    losing = 1.0 + sign * loss  # the load is lifted forward, let down backward
    effort = (
        (load + sign * friction) * losing if side == "joint" else load * losing + sign * friction
    )
    slots = (loss * (np.arange(len(SLOTS)) == SLOT[f"gear both, {side} side"]))[None, :]
    recording = SimpleNamespace(
        trajectory=SimpleNamespace(t=0.004 * np.arange(825)),
        step=0.004,
        rests=rests[:, None],
        velocity=np.where(rests, 0.0, sign)[:, None],
        effort=effort[:, None],
    )
    found = SimpleNamespace(
        choice=SimpleNamespace(laws=[SimpleNamespace(load="gear", side=side)]),
        fit=Fit(np.zeros(10), slots),
        delay=SimpleNamespace(value=0.0),
        prepared=[SimpleNamespace(recording=recording, load=np.full((825, 1), load))],
    )
    ((key, broke),) = break_aways(found).items()
    assert key == (0, way)
    assert broke.mean == pytest.approx(2.0, rel=0.02)
