"""Summary of a motion's efforts, as `pinfric inverse` prints and writes it."""

from __future__ import annotations

from collections.abc import Mapping

from pinfric.dynamics.inverse.balance import LIMIT, Balance
from pinfric.dynamics.inverse.result import InverseResult, StickInterval, runs
from pinfric.dynamics.inverse.standing import Standing
from pinfric.dynamics.samples.outcome import Status
from pinfric.elastic.motion import Elasticity
from pinfric.elastic.summary import ElasticSummary, elastic_summary
from pinfric.model.described import EFFORT, derived, described, quantity
from pinfric.model.massless import massless_joints
from pinfric.motions.log.judged import JudgedLog, LogSummary, log_summary
from pinfric.motions.summary import ActuatorSummary, beyond_limits, payload_phases, summarize


@described
class SiteSummary:
    """What the friction of one joint did along a motion."""

    name: str = quantity("the joint with friction")
    stick_intervals: int = quantity("number of stick intervals")
    reversals: int = quantity("number of reversals between samples")
    max_normal_load: float = quantity("largest load of its bearing", EFFORT)


@described
class Span:
    """A part of a motion."""

    start: float = quantity("its first time", "s")
    end: float = quantity("its last time", "s")


@described
class BaseSummary:
    """What the forces given leave of a free base's six equations."""

    force: float = quantity("RMS of the force left", "N")
    moment: float = quantity("RMS of the moment left", "N m")
    share: float = quantity("of the weight, or of the weight at the base's height", "1")
    limit: float = quantity("condition on the share", "1")

    @property
    @derived()
    def within(self) -> bool:
        """Whether the share is within its condition."""
        return self.share <= self.limit


@described
class StandingRange:
    """Between what a drive's efforts are over all forces at the feet within friction."""

    name: str = quantity("the drive", heading="joint", name=True)
    least: float = quantity("least effort at any sample", EFFORT, "least")
    greatest: float = quantity("greatest effort at any sample", EFFORT, "greatest")
    widest: float = quantity("widest range at one sample", EFFORT, "widest")


@described
class InverseSummary:
    """What inverse dynamics found along one motion."""

    trajectory: str = quantity("name or path of the motion")
    samples: int = quantity("number of samples")
    start: float = quantity("first time", "s")
    end: float = quantity("last time", "s")
    joints: tuple[ActuatorSummary, ...] = quantity("what each drive must deliver")
    sites: tuple[SiteSummary, ...] = quantity("stick time and load of each joint with friction")
    stick_intervals: tuple[StickInterval, ...] = quantity("when joints stick")
    payloads: Mapping[str, tuple[Span, ...]] = quantity("when each payload is carried")
    status: Mapping[str, int] = quantity("status -> number of samples")
    too_narrow: int = quantity("number of samples whose intervals may be too narrow")
    beyond_limits: tuple[str, ...] = quantity("efforts beyond the URDF's limits, in words")
    input: LogSummary | None = quantity("how the log was read; none: the motion is not a log")
    elasticity: ElasticSummary | None = quantity("effects of elastic gears; none: all are rigid")
    massless: tuple[str, ...] = quantity("joints that move no mass: their efforts are friction")
    standing: tuple[StandingRange, ...] = quantity(
        "ranges over all forces at the feet; empty: the forces are given", default=()
    )
    base: BaseSummary | None = quantity(
        "what given forces leave at a free base; none: it is fixed", default=None
    )


def inverse_summary(
    result: InverseResult,
    trajectory: str,
    log: JudgedLog | None = None,
    elastic: Elasticity | None = None,
    standing: Standing | None = None,
) -> InverseSummary:
    """Return the summary of a motion's efforts.

    Args:
        result: with times.
        trajectory: its name or path.
        log: how the trajectory was read, if it came from samples.
        elastic: effects of elastic gears, if there are any.
        standing: ranges over the forces at the feet, where these are not given.

    Raises:
        StateError: the result has no times.
    """
    joints, t = summarize(result), result.times
    sites = [
        SiteSummary(
            name,
            len(runs(result.sticking[:, s])),
            int(result.reversal[:, s].sum()),
            float(result.normal_load[:, s].max()),
        )
        for s, name in enumerate(result.site_names)
    ]
    return InverseSummary(
        trajectory=trajectory,
        samples=len(t),
        start=float(t[0]),
        end=float(t[-1]),
        joints=joints,
        sites=tuple(sites),
        stick_intervals=result.stick_intervals(),
        payloads={
            name: tuple(Span(*span) for span in spans)
            for name, spans in payload_phases(result).items()
        },
        status={status.name.lower(): int((result.status == status).sum()) for status in Status},
        too_narrow=int(result.interval_searched.sum()),
        beyond_limits=beyond_limits(result),
        input=None if log is None else log_summary(log),
        elasticity=None if elastic is None else elastic_summary(elastic),
        massless=massless_joints(result.scene, result.scene.payloads),
        standing=() if standing is None else _ranges(standing),
        base=None if result.balance is None else _base_summary(result.balance),
    )


def _ranges(standing: Standing) -> tuple[StandingRange, ...]:
    low, high = standing.effort_lower, standing.effort_upper
    return tuple(
        StandingRange(
            name, float(low[:, d].min()), float(high[:, d].max()), float((high - low)[:, d].max())
        )
        for d, name in enumerate(standing.result.actuator_names)
    )


def _base_summary(balance: Balance) -> BaseSummary:
    return BaseSummary(balance.force, balance.moment, balance.share, LIMIT)
