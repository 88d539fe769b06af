"""Result of a sweep: values of every sample, percentiles, probabilities, influences."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pinfric.errors import SweepError, choose_from
from pinfric.model.brief import file_name, listed, screen
from pinfric.model.described import described, quantity
from pinfric.model.upward import Shown
from pinfric.sweeps.cycle import DEMANDS, ELASTIC_FIGURES, FIGURES
from pinfric.sweeps.motors import Trial
from pinfric.sweeps.parameters import seeded

if TYPE_CHECKING:
    import pandas as pd

#: 95 % of a normal distribution lies within so many standard deviations.
_Z95 = 1.959963984540054
#: Shares of the variance below it are not worth a name.
_LEAST_SHARE = 0.01
#: Of the bootstrap behind the intervals of Sobol's shares.
_RESAMPLES = 200
#: Samples that are written at once.
_ROWS = 50_000


@described
class Probability:
    """A share of the samples; its 95 % interval (Wilson) where samples are independent."""

    value: float = quantity("the share")
    low: float | None = quantity("lower end of the interval; none for other designs")
    high: float | None = quantity("upper end of the interval; none for other designs")


@dataclass(frozen=True)
class SobolIndices:
    """Shares of a figure's variance, (np,) by parameter.

    Attributes:
        first: of the parameter alone (first-order index).
        total: with its interactions (total-effect index).
        first_low, first_high, total_low, total_high: 95 % bootstrap intervals.
    """

    first: np.ndarray
    total: np.ndarray
    first_low: np.ndarray
    first_high: np.ndarray
    total_low: np.ndarray
    total_high: np.ndarray


@dataclass(frozen=True)
class SweepResult(Shown):
    """All samples of a sweep; SI units.

    The figures of each drive (`figure`) are those of `pinfric inverse`: `peak`, `rms` of the worst
    end of the effort interval; `motor_peak`, `motor_rms` at the motor's shaft; `speed`, the drive's
    largest |v|; and `margin`, the least of all criteria of a catalogue's drive.

    Attributes:
        scene, trajectory, sweep: their names.
        sampling: random, sobol or grid. seed: of the samples.
        parameter_names: (np,) the columns of `values`.
        actuator_names, units, motor_units: (na,) the drives, and the units of their efforts at the
            joint and at the motor's shaft: N m or N.
        values: (n, np) parameters of each sample.
        figures: (n, na, number of figures); NaN where a sample has no solution.
        verdicts: (n, number of criteria) columns (drive on trial, criterion): whether a sample
            meets it; NA: not checked.
        unsolved: (n,) number of instants without a solution.
        problems: (n,) why a sample could not be computed; empty if it could.
        trials: the drives on trial.
        percentiles: the requested ones.
        processes: number of processes used.
        notes: remarks for the reader.
        elastic: (n, 4) lowest frequency (Hz), the tool's sag, interval and reversal error at rest
            (m), the worst of each cycle; (n, 0) where neither stiffness nor hysteresis varies.
    """

    scene: str
    trajectory: str
    sweep: str
    sampling: str
    seed: int
    parameter_names: tuple[str, ...]
    actuator_names: tuple[str, ...]
    units: tuple[str, ...]
    motor_units: tuple[str, ...]
    values: np.ndarray
    figures: np.ndarray
    verdicts: pd.DataFrame
    unsolved: np.ndarray
    problems: tuple[str, ...]
    trials: tuple[Trial, ...]
    percentiles: tuple[float, ...]
    processes: int = 1
    notes: tuple[str, ...] = ()
    elastic: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))

    def __repr__(self) -> str:
        solved = int(self.solved.sum())
        facts = {
            "solved": "all" if solved == self.samples else f"{solved} of {self.samples}",
            "parameters": listed(self.parameter_names),
            "drives": listed(self.actuator_names),
        }
        if solved:
            middle = np.median(self.figure("peak")[self.solved], axis=0)
            peaks = [f"{x:.3g} {unit}" for x, unit in zip(middle, self.units, strict=True)]
            facts["peaks"] = f"{listed(self.actuator_names, peaks)} (median)"
        suffices = [f"{100 * np.mean(self.sufficing(trial)):.1f} %" for trial in self.trials]
        facts["suffice"] = listed([trial.drive for trial in self.trials], suffices)
        title = (
            f"{file_name(self.scene)} · {file_name(self.trajectory)}: "
            f"{self.samples} samples, {self.sampling}"
        )
        return screen(
            "SweepResult",
            title,
            {
                **facts,
                "more": ".summary() .plot() .to_dataframe() .quantiles(figure)",
            },
        )

    @property
    def samples(self) -> int:
        """Number of computed cycles."""
        return len(self.values)

    @cached_property
    def solved(self) -> np.ndarray:
        """(n,) the samples with all their figures."""
        return np.isfinite(self.figures).all(axis=(1, 2))

    @cached_property
    def _there(self) -> np.ndarray | slice:
        """The samples with a solution; where all have one, arrays are not copied."""
        return slice(None) if self.solved.all() else self.solved

    def figure(self, name: str) -> np.ndarray:
        """Return one figure of all samples and drives, (n, na).

        Raises:
            SweepError: there is no such figure.
        """
        if name not in FIGURES:
            raise SweepError(f"there is no figure {name!r}; {choose_from(name, FIGURES)}")
        return self.figures[:, :, FIGURES.index(name)]

    def quantiles(self, name: str) -> np.ndarray:
        """Return the percentiles of a figure, (number of percentiles, na), by drive.

        All samples with a solution weigh the same, also those of a grid.
        """
        drives = self.figure(name).T  # one after another: many samples fill much of the memory
        return np.column_stack([np.percentile(x[self._there], self.percentiles) for x in drives])

    @property
    def rated(self) -> tuple[str, str]:
        """The peak and the RMS by which motors are rated: at their shafts, if there are gears."""
        there = (self.figure("peak") != self.figure("motor_peak"))[self.solved]
        return ("motor_peak", "motor_rms") if there.any() else ("peak", "rms")

    def influences(self, name: str) -> np.ndarray:
        """Return the influence of each parameter on a figure, (np, na).

        Its total share of the variance if there are shares (`has_shares`), else its rank
        correlation.
        """
        shares = self.sobol(name) if self.has_shares else None
        if shares is None:
            return self.rank_correlation(name)
        return np.column_stack([drive.total for drive in shares])

    def strongest(self, influences: np.ndarray, most: int) -> list[int]:
        """Return the parameters that influence one drive's figure most, without noise.

        Args:
            influences: (np,) on that drive.
            most: how many at most.
        """
        least = _LEAST_SHARE if self.has_shares else self.correlation_noise
        order = np.argsort(-np.nan_to_num(np.abs(influences), nan=-1.0), kind="stable")
        return [int(j) for j in order[:most] if abs(influences[j]) > least]

    def elastic_quantiles(self) -> dict[str, np.ndarray]:
        """Return the percentiles of the known elastic figures, by name."""
        there = self.elastic[self.solved] if self.elastic.size else self.elastic
        known = [k for k in range(there.shape[1]) if np.isfinite(there[:, k]).all() and len(there)]
        return {
            ELASTIC_FIGURES[k]: np.asarray(np.percentile(there[:, k], self.percentiles))
            for k in known
        }

    def sufficing(self, trial: Trial | None = None) -> np.ndarray:
        """Return (n,) in which samples a motor (None: every motor) meets all its criteria.

        A sample without a solution counts as failed.
        """
        trials = self.trials if trial is None else (trial,)
        met = [mask for t in trials for mask in self.met(t).values()]
        there = np.isfinite(self.figures[:, [t.actuator for t in trials]]).all(axis=(1, 2))
        return np.logical_and.reduce([*met, there])

    def met(self, trial: Trial) -> dict[str, np.ndarray]:
        """Return for each checked criterion which samples meet it, (n,).

        A sample without a solution meets none.
        """
        solved = np.isfinite(self.figure("margin")[:, trial.actuator])
        verdicts = {name: self.verdicts[trial.drive, name] for name in trial.checks}
        return {
            name: solved & verdict.fillna(True).to_numpy(dtype=bool)
            for name, verdict in verdicts.items()
            if not solved.any() or not verdict[solved].isna().all()
        }

    def not_checked(self, trial: Trial) -> tuple[str, ...]:
        """Return the criteria for which a solved sample lacks a figure."""
        solved = np.isfinite(self.figure("margin")[:, trial.actuator])
        lacks = [self.verdicts[trial.drive, name][solved].isna().any() for name in trial.checks]
        return tuple(name for name, lack in zip(trial.checks, lacks, strict=True) if lack)

    def probability(self, mask: np.ndarray) -> Probability:
        """Return the share of a (n,) mask with its confidence interval."""
        from scipy.stats import binomtest

        share = float(np.mean(mask))
        if self.sampling != "random":
            return Probability(share, None, None)
        ends = binomtest(int(np.sum(mask)), len(mask)).proportion_ci(method="wilson")
        return Probability(share, float(ends.low), float(ends.high))

    def rank_correlation(self, name: str) -> np.ndarray:
        """Return Spearman's correlation of each parameter with a figure, (np, na), in [-1, 1].

        It shows monotonic effects only: for a figure with a minimum inside a parameter's range (a
        mounting angle) use the shares of Sobol's design. NaN if a parameter or a figure does not
        vary.
        """
        if name not in self._correlations:
            figures = [_ranks(x[self._there]) for x in self.figure(name).T]
            self._correlations[name] = self._parameter_ranks @ np.column_stack(figures)
        return self._correlations[name]

    @cached_property
    def _correlations(self) -> dict[str, np.ndarray]:
        """What `rank_correlation` has computed, by figure."""
        return {}

    @cached_property
    def _parameter_ranks(self) -> np.ndarray:
        """(np, number of samples with a solution) `_ranks` of each parameter."""
        return np.array([_ranks(x[self._there]) for x in self.values.T])

    @property
    def correlation_noise(self) -> float:
        """The rank correlation that is significant at the 5 % level."""
        return _Z95 / math.sqrt(max(int(self.solved.sum()) - 1, 1))

    @property
    def has_shares(self) -> bool:
        """Whether `sobol` gives shares of the variance: Sobol's design, all samples solved."""
        return self.sampling == "sobol" and bool(self.solved.all())

    def sobol(self, name: str) -> tuple[SobolIndices, ...] | None:
        """Return the shares of a figure's variance by drive; None for other designs.

        With A, B and AB (A with one column of B), means over rows and the variance V of A and B:
        first = <f_B (f_AB - f_A)>/V, total = <(f_A - f_AB)^2>/(2 V). NaN for a figure that does not
        vary or has no value in some sample.

        Source: Saltelli et al. (2010), Computer Physics Communications 181, 259-270, table 2 b, f.
        """
        if self.sampling != "sobol":
            return None
        return tuple(self._sobol(self.figure(name)[:, i]) for i in range(len(self.actuator_names)))

    def _sobol(self, y: np.ndarray) -> SobolIndices:
        from scipy.stats import bootstrap

        d = len(self.parameter_names)
        n = self.samples // (d + 2)
        varies = np.isfinite(y).all() and np.ptp(y) > 1e-12 * np.abs(y).max()
        if not varies or d == 1:  # one parameter has all of the variance
            return SobolIndices(*[np.full(d, 1.0 if varies else np.nan)] * 6)
        f = y.reshape(d + 2, n)
        f = f - f[:2].mean()  # the estimators of the first order lose digits to the mean

        def shares(rows: np.ndarray) -> np.ndarray:
            A, B, AB = f[0, rows], f[1, rows], f[2:, rows]
            parts = (B * (AB - A)).mean(axis=1), ((A - AB) ** 2).mean(axis=1) / 2
            return np.array(parts) / f[:2, rows].var()

        rows, seed = np.arange(n), seeded(bootstrap, "random_state", self.seed)
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a parameter without any influence: no spread
            spread = bootstrap((rows,), shares, n_resamples=_RESAMPLES, vectorized=False, **seed)
        indices = first, total = shares(rows)
        low, high = (np.where(np.isnan(end), indices, end) for end in spread.confidence_interval)
        return SobolIndices(first, total, low[0], high[0], low[1], high[1])

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row per sample: `sample`, the parameters, `<drive>.<figure>`, what failed.

        For each drive on trial `<drive>.suffices`, `<drive>.<criterion>` of the checked criteria,
        and the least `<drive>.margin`.
        """
        import pandas as pd

        return pd.DataFrame(self._columns())

    def write_csv(
        self, path: str | Path, progress: Callable[[int, int], object] | None = None
    ) -> None:
        """Write `to_dataframe` as CSV, in parts that take little memory.

        Args:
            progress: called with the number of written samples and of all.
        """
        import pandas as pd

        columns = self._columns()
        with Path(path).open("w", encoding="utf-8", newline="") as file:
            for start in range(0, self.samples, _ROWS):
                rows = slice(start, min(start + _ROWS, self.samples))
                part = pd.DataFrame({name: column[rows] for name, column in columns.items()})
                part.to_csv(file, index=False, header=not start)
                if progress is not None:
                    progress(rows.stop, self.samples)

    def _columns(self) -> dict[str, Any]:
        """The columns of `to_dataframe`, those of figures as views of them."""
        columns: dict[str, Any] = {"sample": np.arange(self.samples)}
        columns |= {name: self.values[:, j] for j, name in enumerate(self.parameter_names)}
        for i, drive in enumerate(self.actuator_names):
            columns |= {f"{drive}.{f}": self.figures[:, i, k] for k, f in enumerate(DEMANDS)}
        for trial in self.trials:
            columns[f"{trial.drive}.suffices"] = self.sufficing(trial)
            columns |= {f"{trial.drive}.{name}": mask for name, mask in self.met(trial).items()}
            columns[f"{trial.drive}.margin"] = self.figure("margin")[:, trial.actuator]
        columns |= {
            name: self.elastic[:, k] for k, name in enumerate(ELASTIC_FIGURES) if self.elastic.size
        }
        return columns | {"unsolved": self.unsolved, "problem": self.problems}


def _ranks(x: np.ndarray) -> np.ndarray:
    """Ranks less their mean, at length 1: two such multiply to Spearman's correlation, or NaN."""
    from scipy.stats import rankdata

    ranks = rankdata(x) - (len(x) + 1) / 2
    with np.errstate(invalid="ignore"):  # 0/0 of what does not vary
        return np.asarray(ranks / np.linalg.norm(ranks))
