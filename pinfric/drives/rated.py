"""A rating as a motion to size by, alone or beside a duty.

A joint's means are over its own part, its move or the holds: all others' parts would dilute its RMS
effort. A duty beside is one more part. A drive must bear each of them, and the peaks of all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pinfric.drives.demand import DriveCycle
from pinfric.drives.duty import Duty, Schedule
from pinfric.motions.rating import Lift, Rated
from pinfric.motions.trajectory import Trajectory


@dataclass(frozen=True)
class RatedCycle:
    """A rating's parts behind the cycles of a duty, as one motion.

    Attributes:
        motion: the cycles, then the rating, then the time switched off.
        schedule: how often a period runs each part: of a rating beside a duty never.
        moves: drive -> its part. holds: payload -> parts in which all joints stand with it.
        duty: beside it.
        fast: the part of the top speeds, which is never run: only its peaks count.
    """

    rated: Rated
    motion: Trajectory
    schedule: Schedule
    moves: dict[int, int]
    holds: dict[str, tuple[int, ...]]
    fast: int
    duty: Duty | None

    @classmethod
    def of(cls, rated: Rated, duty: Duty | None) -> RatedCycle:
        """Return a rating as a motion, beside a duty with the payloads of the given scene."""
        payloads, lifts, parts = zip(*rated.motions(), strict=True)
        fast = rated.at_top_speed()
        if duty is None:
            whole, cycles = Duty(tuple((part, 1.0) for part in parts), beside=(fast,)), 0
        else:
            given = tuple((_also(rated, cycle), weight) for cycle, weight in duty.cycles)
            whole, cycles = replace(duty, cycles=given, beside=(*parts, fast)), len(given)
        numbered: Sequence[tuple[int, Lift | None]] = list(enumerate(lifts, start=cycles))
        return cls(
            rated,
            whole.motion(),
            whole.schedule(),
            {lift.drive: k for k, lift in numbered if lift is not None},
            {
                name: tuple(
                    k for k, lift in numbered if lift is None and payloads[k - cycles] == name
                )
                for name in dict.fromkeys(payloads)
            },
            cycles + len(parts),
            duty,
        )

    @property
    def cycles(self) -> int:
        """How many parts are cycles of the duty."""
        return 0 if self.duty is None else len(self.duty.cycles)

    def means(self, drive: int) -> dict[str, Schedule]:
        """Return the schedules of a drive's means, by name: each must be borne.

        Its holds are those with the payload that it moves.
        """
        means = {"cycle": self.schedule} if self.cycles else {}
        means["rating: hold"] = self.schedule.only(self.holds[self.rated.carried_by(drive)])
        if drive in self.moves:
            means["rating: move"] = self.schedule.only((self.moves[drive],))
        return means

    def apart(self) -> dict[str, tuple[int, ...]]:
        """Return the parts of the cycles, and of the rating beside them."""
        runs = range(len(self.schedule.repeats))
        beside = range(self.cycles, len(runs) - self.schedule.off)
        return {"cycle": tuple(k for k in runs if k not in beside), "rating": tuple(beside)}

    @property
    def source(self) -> str:
        """The cycles, and what the robot is rated for, in words."""
        rating = f"rating {self.rated.rating.payload:g} kg"
        if self.duty is None:
            return rating
        single = len(self.duty.cycles) == 1 and self.duty.on == 1
        return f"{self.duty.cycles[0][0].source if single else self.duty.source}, {rating}"

    @property
    def once(self) -> np.ndarray:
        """(T,) which samples are the motion that is stopped: the duty, else holds and moves."""
        return np.arange(len(self.motion.t)) < self.schedule.starts[self.cycles or self.fast]

    def others_speed(self, cycle: DriveCycle) -> np.ndarray:
        """(T,) which samples are of the top speeds of other joints: a drive stands in them."""
        fast = np.zeros(len(cycle.t), dtype=bool)
        fast[self.schedule.starts[self.fast] : self.schedule.starts[self.fast + 1]] = True
        return fast & (cycle.velocity == 0.0)

    def own_speed(self, cycle: DriveCycle) -> DriveCycle:
        """Return a drive's samples without effort where another joint is at its top speed.

        Its hold in that posture counts as a part of its own.
        """
        counts = ~self.others_speed(cycle)
        names = ("effort_lower", "effort_upper", "effort_frictionless")
        return replace(cycle, **{name: getattr(cycle, name) * counts for name in names})

    @property
    def own(self) -> np.ndarray:
        """(T,) which samples are of the duty, not of the rating."""
        return np.arange(len(self.motion.t)) < self.schedule.starts[self.cycles]


def _also(rated: Rated, cycle: Trajectory) -> Trajectory:
    """A cycle in which the rated payload is not carried."""
    names = tuple(rated.scene.payloads)
    columns = dict(zip(cycle.payload_names, cycle.attached.T, strict=True))
    none = np.zeros(len(cycle.t), dtype=bool)
    attached = np.column_stack([columns.get(name, none) for name in names])
    return replace(cycle, payload_names=names, attached=attached)
