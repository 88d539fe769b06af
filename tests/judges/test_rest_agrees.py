"""What holds, forward dynamics and the efforts of inverse dynamics say of the same state at rest.

`holds` and forward dynamics ask one function, `search.rests`. Two others check it: the proof by
branching (`holding.decide`), and the ends of the efforts that inverse dynamics finds from corners.
"""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pinocchio as pin
import pytest
from judges import geared_states
from judges.limits_apart import WORM
from judges.resting_states import KINDS, five_bar
from mechanisms import three_rrs, two_ball_loops

import pinfric as pf
from pinfric.dynamics.forward import holds
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.errors import AccelerationError, PinfricError

#: An effort this close to an end, as a share of the interval, decides nothing.
_ROUNDING = 1e-8
#: An interval narrower than this share of its ends is one effort: nothing rubs there.
_RUBS = 1e-6
#: An acceleration (rad/s2, m/s2) of rounding: joints without friction move by it.
_STILL = 1e-9


def _of_judge(kind):
    def make(rng):
        state = KINDS[kind](rng)
        return state.scene, pin.neutral(state.scene.model)

    return make


def _one_freedom(rng):
    """Loops with one freedom, so that one interval says all."""
    state = five_bar(rng, [(4,), (4, 3), (4, 3, 3)][rng.integers(3)])
    return state.scene, pin.neutral(state.scene.model)


def _geared(make, **more):
    def state(rng):
        scene, q, *_ = make(rng, **more)
        return scene, q

    return state


def _legs(rng):
    scene, guess = three_rrs(rng.uniform(0.05, 0.25), 0.01, rng.choice([1.0, 1.2]))
    guess[7::2] += 0.2 * rng.normal(size=3)
    return scene, scene.close(guess)


def _ball_loops(rng, worm=None):
    """Two of three have efforts without bounds, or none that are known; those are drawn again."""
    while True:
        scene, q, _ = two_ball_loops(int(rng.integers(1 << 20)), (4, 2, 2))
        if worm is not None:
            drives = [{"joint": drive.name, "transmission": worm} for drive in scene.drives]
            scene = scene.with_(actuators=drives)
        still = np.zeros((1, scene.model.nv))
        with suppress(PinfricError):
            if np.isfinite(pf.inverse_dynamics(scene, q[None], still, still).effort_lower).all():
                return scene, q


def _between_worms(rng):
    return _ball_loops(rng, {**WORM, "no_load_torque": 0.002})


STATES = {
    "trees": _of_judge("trees"),
    "one freedom": _one_freedom,
    "five-bars": _of_judge("five-bars"),
    "geared loops": _of_judge("geared loops"),
    "worms": _geared(geared_states.worm),
    "arms that lock": _geared(geared_states.arm, locks=0.8, mu=True, most=3),
    "rings that lock": _geared(geared_states.bars),
    "deltas": _of_judge("deltas"),
    "3-RRS": _legs,
    "ball loops": _ball_loops,
    "balls between worms": _between_worms,
}


def _efforts(
    rng: np.random.Generator, low: np.ndarray, high: np.ndarray
) -> Iterator[tuple[np.ndarray, bool]]:
    """Efforts within all their intervals, and one of them a little beyond."""
    width = high - low
    for beyond in (0.0, 10.0 ** -rng.uniform(0.0, 6.0), 10.0 ** -rng.uniform(0.0, 6.0)):
        share = rng.uniform(0.01, 0.99, len(low))
        if beyond:
            share[rng.integers(len(low))] = rng.choice([-beyond, 1.0 + beyond])
        out = width * np.maximum(-share, share - 1.0)
        if (out > _ROUNDING * (np.abs(high) + np.abs(low) + width)).any() or not beyond:
            yield low + share * width, bool(beyond)


def _freedoms(scene: pf.Scene, q: np.ndarray) -> int:
    ws = Workspace(scene)
    ws.assemble(q, np.zeros(ws.nv), np.zeros(ws.na))
    return int(ws.machine.maps.freedoms[0]) if ws.closed else ws.nv


def _rests(scene: pf.Scene, q: np.ndarray, given: dict[str, np.ndarray]) -> bool:
    try:
        found = pf.forward_dynamics(scene, q, np.zeros(scene.model.nv), **given)
    except AccelerationError:
        return False
    return not found.modes.any() and np.abs(found.a).max() < _STILL


def disagreements(kind: str, seed: int, proofs: list[holds.Verdict]) -> tuple[int, list[str]]:
    """How many efforts were looked at, and what the codes say differently.

    Args:
        proofs: overwritten by each call of `holds` with what `decide` says of every way to hold.
    """
    rng = np.random.default_rng([list(STATES).index(kind), seed])
    scene, q = STATES[kind](rng)
    still, count, wrong = np.zeros((1, scene.model.nv)), 0, list[str]()
    try:
        ends = pf.inverse_dynamics(scene, q[None], still, still)
    except PinfricError:
        return 0, []
    geared = all(drive.transmission is not None for drive in scene.drives)
    freedoms = _freedoms(scene, q)
    alone = len(scene.drives) == 1 or not scene.loops
    for name in ("effort", "motor_torque") if geared else ("effort",):
        low, high = (getattr(ends, f"{name}_{side}")[0] for side in ("lower", "upper"))
        if not np.isfinite(low + high).all():
            continue
        if (high - low < _RUBS * (np.abs(low) + np.abs(high))).any():
            continue  # it rests, or does not, by rounding
        for effort, beyond in _efforts(rng, low, high):
            given, count = {name: effort}, count + 1
            proofs.clear()
            found, rests = pf.holds(scene, q, **given), _rests(scene, q, given)
            at = f"{kind} {seed} {name} {effort}: use {found.use}, "
            if (found.held is True) != rests or (found.held and not found.proved):
                wrong.append(at + f"held {found.held}, forward {'rests' if rests else 'moves'}")
            known = [proof for proof in proofs if proof.proved]
            holds_by_proof = any(proof.held for proof in known)
            if holds_by_proof and not rests:
                wrong.append(at + "a friction holds")
            if proofs and len(known) == len(proofs) and not holds_by_proof and rests:
                wrong.append(at + "no friction holds")
            if not ends.interval_exact[0] or len(scene.drives) != freedoms:
                continue
            if beyond and rests:
                wrong.append(at + f"beyond {low} to {high}")
            if not beyond and alone and not rests:
                wrong.append(at + f"within {low} to {high}")
    return count, wrong


@pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
@pytest.mark.parametrize(
    ("kind", "seeds"),
    [
        *((kind, range(1 if "ball" in kind else 3)) for kind in STATES),
        *(
            pytest.param(kind, range(100, 105 if "balls" in kind else 130), marks=pytest.mark.slow)
            for kind in STATES
        ),
    ],
)
def test_what_holds_rests_and_is_within_its_interval(kind, seeds, monkeypatch):
    proofs, decide = list[holds.Verdict](), holds.decide
    monkeypatch.setattr(
        holds, "decide", lambda *given: [proofs.append(decide(*given)), proofs[-1]][1]
    )
    total, wrong = 0, list[str]()
    for seed in seeds:
        count, those = disagreements(kind, seed, proofs)
        total, wrong = total + count, wrong + those
    assert not wrong
    assert total >= len(seeds) / 2
