"""Which law each joint follows: the smallest one that is not worse on held-out blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pinfric.identification.columns import Rows
from pinfric.identification.laws import INERTIA, PLAIN, K, Law
from pinfric.identification.normal import (
    BlockProducts,
    FrictionNormalEquations,
    ManyNormalEquations,
    Normal,
    Prior,
    block_errors,
    residuals,
)
from pinfric.model.arrays import BoolArray, FloatArray, IntArray

#: A law whose RMS error is larger by less than this share is not worse.
MARGIN = 0.02
#: Blocks are held out in so many parts; whole logs, where there are as many as the second and
#: each joint slides in several.
_FOLDS, _LOGS = 10, 5
#: No part shall take a larger share of a joint's rows: the others must tell its law.
_MOST_OF_A_JOINT = 1.0 / 3.0
#: Share of the URDF's weight that remains where links are free: it decides what rows do not tell.
_FREE = 1e-4
#: rad/s^2 or m/s^2: rows that accelerate by less show no rotor.
_COASTS = 1e-3
#: Standard errors of the parts' differences by which a law must be worse to be ruled out.
_RULED_OUT = 2.0
#: Rounds in which joints change their laws one at a time.
_ROUNDS = 2


@dataclass(frozen=True)
class Problem:
    """What is fitted: all joints' summed products, and what may be chosen.

    Attributes:
        grams: of each joint. weights: (nj,) 1/variance of each joint's residual.
        prior: of the links' parameters. laws: the candidates of each joint.
        folds: (blocks,) the part with which each block is held out; -1: in no part, in no fit.
        rotor: whether rotors' inertias are fitted.
    """

    grams: Sequence[BlockProducts]
    weights: FloatArray
    prior: Prior
    laws: Sequence[Sequence[Law]]
    folds: IntArray
    rotor: bool

    def slots(self, laws: Sequence[Law]) -> list[tuple[int, ...]]:
        """Return the slots of all joints' laws and rotors that the joint's rows fill."""
        rotor = (INERTIA,) if self.rotor else ()
        return [
            tuple(slot for slot in (*rotor, *law.slots) if own[slot])
            for own, law in zip(self._seen, laws, strict=True)
        ]

    def normal(self, blocks: BoolArray | None = None) -> Normal:
        """Return the normal equations of some blocks; None: of all."""
        all_blocks = np.ones(self.folds.size, dtype=bool)
        return Normal.of(self.grams, all_blocks if blocks is None else blocks, self.weights)

    @cached_property
    def _seen(self) -> list[list[bool]]:
        """In which slots each joint's rows are not all zero, or a rotor all but coasts."""
        sizes = [gram.products.diagonal(axis1=1, axis2=2).sum(axis=0) for gram in self.grams]
        least = np.zeros(K)
        least[INERTIA] = _COASTS**2
        return [
            (size[-K - 1 : -1] > least * gram.count.sum()).tolist()
            for size, gram in zip(sizes, self.grams, strict=True)
        ]


@dataclass(frozen=True)
class Choice:
    """The chosen laws, and the held-out error of each candidate, by joint.

    Attributes:
        errors: law -> RMS on held-out rows, N m or N.
        rivals: laws with another load that these rows do not rule out.
    """

    laws: tuple[Law, ...]
    errors: tuple[Mapping[Law, float], ...]
    rivals: tuple[tuple[Law, ...], ...] = ()

    def on_motors(self, there: BoolArray) -> Choice:
        """Return the choice with the friction of some drives (nj,) on their motors' sides."""

        def moved(law: Law, motor: bool) -> Law:
            return replace(law, side="motor") if motor else law

        laws = tuple(moved(law, bool(m)) for law, m in zip(self.laws, there, strict=True))
        errors = tuple(
            {moved(law, bool(m)): error for law, error in own.items()}
            for own, m in zip(self.errors, there, strict=True)
        )
        rivals = tuple(
            tuple(moved(law, bool(m)) for law in own)
            for own, m in zip(self.rivals, there, strict=True)
        )
        return replace(self, laws=laws, errors=errors, rivals=rivals)


def held_out_parts(joint: IntArray, block: IntArray, log: IntArray) -> IntArray:
    """Return with which part each block is held out: whole logs, or neighbouring blocks.

    Parts are of blocks, or logs, in which something slides; all others are in part 0. No part
    takes more than a third of a joint's rows if that can be: then each joint's blocks are divided,
    those of the joint that slides in the fewest first.

    Args:
        joint, block, log: (n,) of every row of any joint.
    """
    kinds, whole_logs = list[IntArray](), np.unique(log)
    if whole_logs.size >= _LOGS:
        kinds.append(_spread(block, np.searchsorted(whole_logs, log)))
    held = np.unique(block)
    kinds.append(_spread(held, np.arange(held.size) * min(_FOLDS, held.size) // held.size))
    kinds.append(_parts_of_joints(joint, block))
    most = [_most_of_a_joint(parts, joint, block) for parts in kinds]
    return next(
        parts
        for parts, share in zip(kinds, most, strict=True)
        if share <= max(_MOST_OF_A_JOINT, most[-1])
    )


def _spread(blocks: IntArray, values: IntArray) -> IntArray:
    """Return the values by number of block, 0 for other blocks."""
    of_block = np.zeros(int(blocks.max()) + 1, dtype=np.int64)
    of_block[blocks] = values
    return of_block


def _parts_of_joints(joint: IntArray, block: IntArray) -> IntArray:
    """Return each block's part, with the blocks of each joint in as many parts as can be."""
    own = [np.unique(block[joint == j]) for j in np.unique(joint)]
    of_block = np.full(int(block.max()) + 1, -1)
    for blocks in sorted(own, key=len):
        new = blocks[of_block[blocks] < 0]
        first = int((of_block >= 0).sum())
        of_block[new] = (np.arange(new.size) * _FOLDS // max(new.size, _FOLDS) + first) % _FOLDS
    return np.maximum(of_block, 0)


def _most_of_a_joint(parts: IntArray, joint: IntArray, block: IntArray) -> float:
    """Return the largest share of one joint's rows that one part takes."""
    counts = [np.bincount(parts[block[joint == j]]) for j in np.unique(joint)]
    return max(float(count.max() / count.sum()) for count in counts)


def choose(problem: Problem) -> Choice:
    """Return each joint's law: all joints change together, then one at a time."""
    candidates = list(dict.fromkeys((PLAIN, *(law for laws in problem.laws for law in laws))))
    judge = _Judge(problem)
    tables: list[dict[Law, FloatArray]] = [{} for _ in problem.laws]
    for law in candidates:
        laws = [law if law in own else PLAIN for own in problem.laws]
        for j, error in enumerate(judge.errors(laws, range(len(laws)))):
            tables[j].setdefault(laws[j], error)
    chosen = [judge.taken(j, tables[j]) for j in range(len(tables))]
    for _ in range(_ROUNDS):
        before = list(chosen)
        for j, own in enumerate(problem.laws):
            for law in own:
                laws = [*chosen[:j], law, *chosen[j + 1 :]]
                tables[j][law] = judge.errors(laws, [j])[0]
            chosen[j] = judge.taken(j, tables[j])
        if chosen == before:
            break
    errors = tuple(
        {law: float(np.sqrt(e.sum() / max(judge.rows[j].sum(), 1.0))) for law, e in table.items()}
        for j, table in enumerate(tables)
    )
    rivals = tuple(
        not_ruled_out(law, {own: table[own] for own in laws}, judge.rows[j])
        for j, (law, laws, table) in enumerate(zip(chosen, problem.laws, tables, strict=True))
    )
    return Choice(tuple(chosen), errors, rivals)


def nested_errors(problem: Problem, rows: Sequence[Rows]) -> tuple[FloatArray, FloatArray]:
    """Return each joint's RMS error on blocks not used to choose or fit its law, N m or N.

    (nj,) of the laws chosen without these blocks, and of plain friction. Every row counts alike:
    weights of outliers follow the chosen law, and would flatter it.
    """
    squares = np.zeros((2, len(problem.laws)))
    plain = [PLAIN] * len(problem.laws)
    for fold in np.unique(problem.folds):
        test = problem.folds == fold
        others = replace(problem, folds=np.where(test, -1, problem.folds))
        laws = choose(others).laws
        reduced = FrictionNormalEquations(problem.normal(~test), problem.prior)
        for kind, taken in enumerate((laws, plain)):
            fit = reduced.fit(problem.slots(taken))
            for j, own in enumerate(rows):
                squares[kind, j] += np.sum(residuals(own, fit, j)[test[own.block]] ** 2)
    chosen, simple = np.sqrt(squares / np.maximum([own.effort.size for own in rows], 1.0))
    return chosen, simple


def free_errors(problem: Problem, rows: Sequence[Rows]) -> FloatArray:
    """Return (nj,) RMS errors on held-out blocks of ordinary least squares, with plain friction.

    The URDF only decides what no row determines.
    """
    squares, plain = np.zeros(len(rows)), problem.slots([PLAIN] * len(rows))
    free = replace(problem.prior, weight=_FREE * problem.prior.weight)
    for fold in np.unique(problem.folds):
        test = problem.folds == fold
        fit = FrictionNormalEquations(problem.normal(~test), free).fit(plain)
        squares += [
            np.sum(residuals(own, fit, j)[test[own.block]] ** 2) for j, own in enumerate(rows)
        ]
    return np.asarray(np.sqrt(squares / np.maximum([own.effort.size for own in rows], 1.0)))


class _Judge:
    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        used = problem.folds >= 0
        tests = [problem.folds == fold for fold in np.unique(problem.folds[used])]
        self._reduced = ManyNormalEquations(
            [FrictionNormalEquations(problem.normal(used & ~test), problem.prior) for test in tests]
        )
        self.rows = np.array([[gram.count[test].sum() for test in tests] for gram in problem.grams])
        self._grams = [
            np.array([gram.products[test].sum(axis=0) for test in tests]) for gram in problem.grams
        ]
        self._fits: dict[tuple[Law, ...], tuple[FloatArray, FloatArray]] = {}

    def errors(self, laws: Sequence[Law], joints: Sequence[int]) -> list[FloatArray]:
        """Return each joint's sum of squared errors in every part, (parts,)."""
        fits = self._fits.get(tuple(laws))
        if fits is None:
            slots = self._problem.slots(laws)
            fits = self._fits[tuple(laws)] = self._reduced.fit(slots)
        theta, slots_of = fits
        return [block_errors(self._grams[j], np.hstack((theta, slots_of[:, j]))) for j in joints]

    def taken(self, joint: int, errors: Mapping[Law, FloatArray]) -> Law:
        own = self._problem.laws[joint]
        return simplest_adequate_law({law: errors[law] for law in own}, self.rows[joint])


def simplest_adequate_law(errors: Mapping[Law, FloatArray], rows: FloatArray) -> Law:
    """Return the law of fewest coefficients that is not worse than the best one.

    Not worse: the parts' mean difference in squared error is within one standard error, or the RMS
    error within 2 %. Of equally many coefficients viscous friction goes before other powers of the
    speed, which noise prefers as often; then the smaller error decides.

    Args:
        errors: law -> (parts,) sum of squared errors. rows: (parts,) their numbers.
    """
    best = min(errors, key=lambda law: float(errors[law].sum()))
    least = float(errors[best].sum())

    def good(law: Law) -> bool:
        worse, spread = _worse(errors[law], errors[best], rows)
        return worse <= max(spread, ((1.0 + MARGIN) ** 2 - 1.0) * least)

    fine = [law for law in errors if good(law)]
    return min(
        fine, key=lambda law: (law.size, law.exponent not in (None, 1.0), float(errors[law].sum()))
    )


def not_ruled_out(
    chosen: Law, errors: Mapping[Law, FloatArray], rows: FloatArray
) -> tuple[Law, ...]:
    """Return the best law of each other load that held-out rows do not rule out.

    One loss of a gear and two are different loads; other terms are the chosen law's. Ruled out is
    what is worse by more than two standard errors of the parts' differences.
    """

    def load(law: Law) -> tuple[str, bool]:
        return law.load, law.both_ways

    def beside(law: Law) -> tuple[bool, float | None, tuple[int, ...]]:
        return law.coulomb, law.exponent, law.stribeck_slots

    best: dict[tuple[str, bool], Law] = {}
    for law in sorted(errors, key=lambda law: float(errors[law].sum())):
        if beside(law) == beside(chosen) and load(law) != load(chosen):
            worse, spread = _worse(errors[law], errors[chosen], rows)
            if worse <= _RULED_OUT * spread:
                best.setdefault(load(law), law)
    return tuple(best.values())


def _worse(law: FloatArray, other: FloatArray, rows: FloatArray) -> tuple[float, float]:
    """Return a law's sum of squares less another's, and its standard error."""
    difference = (law - other)[rows > 0]
    spread = float(difference.std(ddof=1)) if difference.size > 1 else 0.0
    return float(difference.sum()), spread * float(np.sqrt(difference.size))
