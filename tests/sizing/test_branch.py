"""The lightest set with a sufficient frequency, against an enumeration of all sets."""

from itertools import product

import numpy as np
import pytest
from builders import example

import pinfric as pf
from pinfric.sizing.branch import SwingingArm, stiff_enough


def invented(rng, joints, poses, drives):
    """Mass matrices that are linear in the drives' masses, and fronts of drives."""
    root = rng.normal(size=(poses, joints, joints))
    still = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(joints)
    per_mass = np.zeros((joints, poses, joints, joints))
    for k in range(1, joints):
        lever = np.concatenate([rng.normal(size=(poses, k)), np.zeros((poses, joints - k))], axis=1)
        per_mass[k] = lever[:, :, None] * lever[:, None, :]
    fronts = []
    for k in range(joints):
        masses = np.sort(rng.uniform(0.1, 4.0, drives))
        stiffness = np.sort(rng.uniform(2e3, 9e4, drives))
        fronts.append([(m, K, m if k else 0.0) for m, K in zip(masses, stiffness, strict=True)])
    return still, per_mass, fronts


def enumerated(still, per_mass, fronts, frequency):
    """The least mass over every set, all eigenvalues at every pose."""
    sets = np.array(list(product(*(range(len(front)) for front in fronts))))
    table = [np.array(front) for front in fronts]
    mass = sum(t[sets[:, k], 0] for k, t in enumerate(table))
    added = np.stack([t[sets[:, k], 2] for k, t in enumerate(table)], axis=1)
    stiffness = np.stack([t[sets[:, k], 1] for k, t in enumerate(table)], axis=1)
    ok, root = np.ones(len(sets), dtype=bool), stiffness**-0.5
    for p in range(len(still)):
        M = still[p] + np.einsum("nk,kij->nij", added, per_mass[:, p])
        slowest = np.linalg.eigvalsh(M * root[:, :, None] * root[:, None, :])[:, -1]
        ok &= slowest <= (2 * np.pi * frequency) ** -2.0
    return float(mass[ok].min()) if ok.any() else None, len(sets)


@pytest.mark.parametrize(
    ("seed", "joints", "drives"), [*((s, 3, 9) for s in range(8)), (8, 4, 6), (9, 3, 47)]
)
def test_branch_and_bound_finds_what_an_enumeration_finds(seed, joints, drives):
    rng = np.random.default_rng(seed)
    still, per_mass, fronts = invented(rng, joints, 4, drives)
    frequencies = rng.uniform(4.0, 30.0, 1 if drives > 9 else 4)
    for frequency in frequencies:
        least, count = enumerated(still, per_mass, fronts, frequency)
        picked, looked = stiff_enough(SwingingArm(still, per_mass, frequency), fronts)
        assert (picked is None) == (least is None)
        if picked is not None:
            found = sum(front[p][0] for front, p in zip(fronts, picked, strict=True))
            assert found == pytest.approx(least, rel=1e-12)
        assert looked < count
    if drives == 47:
        assert count > 100_000


@pytest.mark.slow
def test_a_whole_arm_swings_as_fast_as_it_is_asked_to():
    """Each axis alone allows a softer arm; the frequency is that of the report's own modes."""
    scene, motion = example("scara")
    alone = pf.size(scene, motion, "default", on_miss="ignore")
    lowest = float(alone.elastic.frequency.min())
    wanted = 1.15 * lowest
    together = pf.size(
        scene, motion, "default", conditions={"lowest_frequency": wanted}, on_miss="ignore"
    )
    assert float(together.elastic.frequency.min()) >= wanted
    assert together.verdict.mass > alone.verdict.mass
    assert all(joint.choice.fits for joint in together.joints[:2])
