"""What a judge of invariants compared, and what did not agree: a table by kind."""

from collections import Counter, defaultdict

import numpy as np


class Ledger:
    """Counts comparisons by kind, and keeps those that do not agree.

    Attributes:
        tried: kind -> number of comparisons. violated: kind -> a line for each that failed.
    """

    def __init__(self):
        self.tried, self.violated = Counter(), defaultdict(list)

    def holds(self, kind, where, held, said=""):
        """Count one statement that should be true, and return whether it is."""
        self.tried[kind] += 1
        if not held:
            self.violated[kind].append(f"{where}: {said}" if said else str(where))
        return bool(held)

    def same(self, kind, where, ours, theirs, relative=1e-9, scale=None):
        """Count two arrays or numbers that should be equal, to a share of their largest number.

        `scale`: what that share is of, where rounding is of something larger.
        """
        ours, theirs = (np.asarray(x, dtype=np.float64) for x in (ours, theirs))
        size = scale or max(np.abs(x[np.isfinite(x)]).max(initial=0.0) for x in (ours, theirs))
        good = ours.shape == theirs.shape and np.allclose(
            ours, theirs, rtol=0.0, atol=relative * size + 1e-300, equal_nan=True
        )
        if good or ours.shape != theirs.shape:
            said = f"shapes {ours.shape}, {theirs.shape}"
        else:
            off = np.abs(ours - theirs) - np.where(np.isfinite(ours - theirs), 0.0, np.inf)
            worst = np.unravel_index(np.argmax(np.nan_to_num(off, nan=np.inf)), off.shape)
            said = f"{ours[worst]:.9g} for {theirs[worst]:.9g} at {tuple(map(int, worst))}"
        return self.holds(kind, where, good, said)

    def add(self, other):
        """Take the counts of another ledger, too."""
        self.tried.update(other.tried)
        for kind, lines in other.violated.items():
            self.violated[kind] += lines

    def __str__(self):
        width = max((len(kind) for kind in self.tried), default=0)
        rows = [f"{'invariant':{width}}   tried  violated"]
        rows += [
            f"{kind:{width}}  {count:6d}  {len(self.violated.get(kind, [])):8d}"
            for kind, count in sorted(self.tried.items())
        ]
        broken = sum(map(len, self.violated.values()))
        rows.append(f"{'all':{width}}  {sum(self.tried.values()):6d}  {broken:8d}")
        return "\n".join(rows)

    def failures(self):
        """Every comparison that failed, a line each."""
        return [f"{kind}: {line}" for kind, lines in self.violated.items() for line in lines]
