"""All states of friction of one sample, enumerated and proved, and the ends of efforts.

The choices are those of `friction_states`. The limit of a sticking ball is a sphere: its friction
is turned towards each end, from several starts.
"""

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from judges.friction_states import SiteLaw
from judges.interval_search import Loads, all_solutions
from judges.judged_sample import SampleMaps

from pinfric.dynamics.samples.outcome import Status

#: Up to this number of choices all are tried; beyond it, one friction at a time is changed.
_ENUMERATED = 4096
#: Starts and turns of a sticking ball's friction, and the change at which it counts as constant.
_STARTS, _TURNS, _STAYS = 2, 60, 1e-9


@dataclass
class States:
    """Results of the enumeration of a sample's states.

    Attributes:
        lower, upper: (na,) ends of the efforts. friction_lower, friction_upper: (ns,).
        fewest, most: least and greatest number of solutions of one choice.
        decided: whether these are proved to be all that the choices have.
        sampled, flipped: only some choices were tried: sticking balls have infinitely many; or
            there were too many.
        reference: (n, ne) solutions in which sticking sites have no friction.
    """

    lower: np.ndarray
    upper: np.ndarray
    friction_lower: np.ndarray
    friction_upper: np.ndarray
    reference: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    fewest: int = 1
    most: int = 0
    decided: bool = True
    sampled: bool = False
    flipped: bool = False

    @property
    def certain(self) -> bool:
        """Whether the ends are certain."""
        return self.decided and not self.sampled and not self.flipped

    def possible(self, status: Status) -> bool:
        """Return whether a sample with these states can have this status."""
        if status == Status.JAMMED:
            return self.fewest == 0 or self.flipped
        if self.fewest == 0 and self.decided:
            return False
        if status == Status.CONVERGED:
            return self.most <= 1
        return self.most > 1 or not self.certain


def enumerate_states(maps: SampleMaps, laws: list[SiteLaw]) -> States:
    """Return what `friction_states.find_states` returns, proved where it can be."""
    return Enumeration(maps, laws).run()


class Enumeration:
    """Solves choices of friction of one sample.

    Args:
        balance: efforts and contact forces as functions of the friction.
        laws: of the sites.
    """

    def __init__(self, balance: SampleMaps, laws: list[SiteLaw]) -> None:
        self.balance, self.laws = balance, laws
        self.ns = len(laws)
        moved = np.abs(balance.contact[:, :, 1:]).max(axis=(0, 1), initial=0.0) > 0.0
        acts = np.zeros(self.ns, dtype=bool)
        np.logical_or.at(acts, balance.entry_site, moved)
        #: sites whose friction loads nothing: each end picks theirs
        self.leaves = [s for s in range(self.ns) if not acts[s] and len(self._values(s)) > 1]
        self.choosing = [s for s in range(self.ns) if acts[s] and len(laws[s].options) > 1]
        self.balls = [s for s in range(self.ns) if acts[s] and laws[s].sphere]
        na = len(balance.effort)
        self.states = States(*np.full((2, na), np.nan), *np.full((2, self.ns), np.nan))

    def _values(self, s: int) -> np.ndarray:
        """Options of a leaf; a sphere has two sides."""
        options = self.laws[s].options
        return np.vstack([-options[:1], options]) if self.laws[s].sphere else options

    def run(self) -> States:
        """Enumerate; see `States`."""
        still = np.array([law.still for law in self.laws]).reshape(1, self.ns, 2)
        if self.choosing or self.balls:  # else the only choice is that one
            self.states.reference = self._solve(still, self._directions(1))[1]
        sizes = [len(self.laws[s].options) for s in self.choosing]
        if np.prod([float(n) for n in sizes]) > _ENUMERATED:
            self.states.flipped = True
            self._flip()
            return self.states
        every = list(product(*map(range, sizes)))
        codes = np.array(every, dtype=int).reshape(len(every), len(sizes))
        if self.balls:
            self._turn(codes)
        else:
            self._take(codes, self._directions(len(codes)))
        return self.states

    def _directions(self, m: int) -> np.ndarray:
        parts = [law.direction for law in self.laws]
        return np.tile(np.concatenate(parts) if parts else np.zeros(0), (m, 1))

    def _take(self, codes: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solve choices, widen the ends; return efforts (m, na) at the lower and upper end.

        Args:
            codes: (m, number choosing) option of each site that chooses.
            directions: (m, ne).
        """
        m, U = len(codes), self.balance.effort
        lines = self._chosen(codes)
        choice, phi, load = self._solve(lines, directions)
        ends = np.full((2, m, len(U)), np.nan)
        if not self.choosing and not self.balls:
            self.states.reference = phi
        base = U[:, 0] + phi @ U[:, 1:].T
        low, high = base.copy(), base.copy()
        for s in self.leaves:
            entries = np.flatnonzero(self.balance.entry_site == s)
            values = self._values(s)[:, 0] + self._values(s)[:, 1] * load[:, s, None]
            effect = values[:, :, None] * self._lever(s, entries)
            low += effect.min(axis=1)
            high += effect.max(axis=1)
        for end, value, best in ((0, low, np.fmin), (1, high, np.fmax)):
            for n, c in enumerate(choice):
                ends[end, c] = best(ends[end, c], value[n])
        st = self.states
        st.lower = np.fmin(st.lower, np.fmin.reduce(low, axis=0, initial=np.nan))
        st.upper = np.fmax(st.upper, np.fmax.reduce(high, axis=0, initial=np.nan))
        self._range(phi, load)
        return ends[0], ends[1]

    def _lever(self, s: int, entries: np.ndarray) -> np.ndarray:
        """(na,) effort per unit friction of a leaf; a ball's along its most effective direction."""
        U = self.balance.effort[:, 1 + entries]
        return np.asarray(
            np.linalg.norm(U, axis=1) if self.laws[s].sphere else U @ self.laws[s].direction
        )

    def _range(self, phi: np.ndarray, load: np.ndarray) -> None:
        """Widen the range of each site's friction by solutions; a ball's is along its slip."""
        for s, law in enumerate(self.laws):
            entries = np.flatnonzero(self.balance.entry_site == s)
            values = phi[:, entries] @ law.direction
            if s in self.leaves:
                lines = self._values(s)
                values = (lines[:, 0] + lines[:, 1] * load[:, s, None]).ravel()
            if len(values):
                st = self.states
                st.friction_lower[s] = np.fmin(st.friction_lower[s], values.min())
                st.friction_upper[s] = np.fmax(st.friction_upper[s], values.max())

    def _chosen(self, codes: np.ndarray) -> np.ndarray:
        """(m, ns, 2) alpha and beta of every site; leaves have none, because they load nothing."""
        lines = np.zeros((len(codes), self.ns, 2))
        for s, law in enumerate(self.laws):
            if s not in self.leaves:
                lines[:, s] = law.options[0]
        for column, s in enumerate(self.choosing):
            lines[:, s] = self.laws[s].options[codes[:, column]]
        return lines

    def _solve(
        self, lines: np.ndarray, directions: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return choice (n,), friction (n, ne) and loads (n, ns) of every solution.

        Args:
            lines: (m, ns, 2) alpha and beta.
            directions: (m, ne).
        """
        b, contact = self.balance, self.balance.contact
        at, forces = b.entry_site, contact[:, :, 1:]
        own = np.zeros((self.ns, len(b.owner)))
        own[b.owner, np.arange(len(b.owner))] = 1.0
        moves = np.abs(forces).max(axis=(1, 2), initial=0.0) > 0.0
        varies = own @ moves > 0
        unknown = np.flatnonzero((lines[:, :, 1] != 0.0).any(axis=0) & varies)
        fixed = b.constant + own @ np.linalg.norm(contact[:, :, 0], axis=1)
        fixed[varies] = 0.0  # what these load has no part in what is known
        known = lines[:, :, 0] + np.where(
            np.isin(np.arange(self.ns), unknown), 0.0, lines[:, :, 1] * fixed
        )
        given = directions * known[:, at]
        gain = directions * lines[:, at, 1]
        rows = np.isin(b.owner, unknown)
        p = contact[rows][:, :, 0] + np.einsum("tek,mk->mte", forces[rows], given)
        place = at[:, None] == unknown
        P = np.einsum("tek,mk,kj->mtej", forces[rows], gain, place)
        found = all_solutions(Loads(b.constant[unknown], own[unknown][:, rows], p, P))
        phi = given[found.choice] + gain[found.choice] * (found.z @ place.T)
        size = np.linalg.norm(contact[:, :, 0] + np.einsum("tek,nk->nte", forces, phi), axis=2)
        count = np.bincount(found.choice, minlength=len(lines))
        st = self.states
        st.decided &= bool(found.decided.all())
        st.fewest = min(st.fewest, int(count.min()))
        st.most = max(st.most, int(count.max()))
        return found.choice, phi, b.constant + size @ own.T

    def _flip(self) -> None:
        """Search each end by changing one site's friction at a time, while that helps."""
        sizes = [len(self.laws[s].options) for s in self.choosing]
        trials = [(c, option) for c, n in enumerate(sizes) for option in range(n)]
        first = [np.flatnonzero(self.balance.entry_site == s)[0] for s in self.choosing]
        for drive, end in np.ndindex(len(self.balance.effort), 2):
            slope = self.balance.effort[drive, 1 + np.array(first)]
            code = ((slope > 0) == bool(end)).astype(int)
            code = np.minimum(code, np.array(sizes) - 1)
            best = -np.inf
            while True:
                codes = np.tile(code, (len(trials) + 1, 1))
                for row, (column, option) in enumerate(trials):
                    codes[row, column] = option
                ends = self._take(codes, self._directions(len(codes)))
                value = np.nan_to_num(ends[end][:, drive] * (1 if end else -1), nan=-np.inf)
                top = int(np.argmax(value))
                if not value[top] > best + 1e-12 * abs(best):
                    break
                code, best = codes[top], value[top]

    def _turn(self, codes: np.ndarray) -> None:
        """Turn the friction of sticking balls towards each end of each effort."""
        self.states.sampled = True
        U = self.balance.effort
        rng = np.random.default_rng(0)
        for drive, end in np.ndindex(len(U), 2):
            sign = 1.0 if end else -1.0
            for start in range(_STARTS):
                directions = self._directions(len(codes))
                g = np.tile(sign * U[drive, 1:], (len(codes), 1))
                g = g if start == 0 else rng.normal(size=g.shape)
                for _ in range(_TURNS):
                    before = directions.copy()
                    self._point(codes, directions, g)
                    if np.abs(directions - before).max() < _STAYS:
                        break
                    g = self._total_slope(codes, directions, drive, sign)
                self._take(codes, directions)

    def _point(self, codes: np.ndarray, directions: np.ndarray, g: np.ndarray) -> None:
        """Point every sticking ball's friction along g (m, ne); directions are overwritten."""
        for s in self.balls:
            entries = np.flatnonzero(self.balance.entry_site == s)
            sticks = (
                codes[:, self.choosing.index(s)] == 0
                if s in self.choosing
                else (np.ones(len(codes), dtype=bool))
            )
            size = np.linalg.norm(g[:, entries], axis=1)
            rows = np.flatnonzero(sticks & (size > 0.0))
            directions[np.ix_(rows, entries)] = g[np.ix_(rows, entries)] / size[rows, None]

    def _total_slope(
        self, codes: np.ndarray, directions: np.ndarray, drive: int, sign: float
    ) -> np.ndarray:
        """(m, ne) change of sign times an effort per unit friction added, with its effect on loads.

        phi = D (alpha + beta load(phi)) + delta, so the effort changes by U (I - D beta L)^-1 delta
        with L the slope of the loads.
        """
        b = self.balance
        lines = self._chosen(codes)
        out = np.zeros(directions.shape)
        choice, phi, load = self._solve(lines, directions)
        forces = b.contact[:, :, 1:]
        for n, (c, x) in enumerate(zip(choice, phi, strict=True)):
            force = b.contact[:, :, 0] + forces @ x
            size = np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-300)
            along = np.einsum("te,tek->tk", force / size, forces)
            L = np.zeros((self.ns, len(x)))
            np.add.at(L, b.owner, along)
            gain = (directions[c] * lines[c, b.entry_site, 1])[:, None] * L[b.entry_site]
            effect = b.effort[drive, 1:].copy()
            for s in self.leaves:  # at the limit that helps, which follows their load
                values = self._values(s) @ np.array([1.0, load[n, s]])
                lever = self._lever(s, np.flatnonzero(b.entry_site == s))[drive]
                helps = self._values(s)[np.argmax(sign * lever * values)]
                effect += lever * helps[1] * L[s]
            out[c] = sign * np.linalg.solve((np.eye(len(x)) - gain).T, effect)
        return out
