"""A log that somebody has as arrays: from a simulation, or a format that is not read here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pinfric.errors import TrajectoryError
from pinfric.model.arrays import real_numbers
from pinfric.motions.log.frame import OpenedLog, arrays_log


@dataclass(frozen=True)
class Log:
    """Samples that were measured; they are read and filtered as a file's are.

    Args:
        t: (T,) time; s, or as `ReadingOptions` say. Whole numbers keep all their digits.
        q: (T, nj) positions, rad or m; columns as the scene's joints.
        effort: (T, nj) N m or N; NaN where there is none.
        v: (T, nj) measured velocities, which are only compared.
        payload: payload -> (T,) 1 where it is carried.
        name: for messages.

    Raises:
        TrajectoryError: shapes that do not agree.
    """

    t: ArrayLike
    q: ArrayLike
    effort: ArrayLike | None = None
    v: ArrayLike | None = None
    payload: Mapping[str, ArrayLike] = field(default_factory=dict)
    name: str = "log"

    def opened(self, joints: Sequence[str]) -> OpenedLog:
        """Return the file that it would be.

        Args:
            joints: the scene's, in its order.
        """
        t, shape = np.asarray(self.t), (np.size(self.t), len(joints))
        columns: dict[str, Any] = {"t": t}
        for quantity, given in (("", self.q), ("/velocity", self.v), ("/effort", self.effort)):
            if given is None:
                continue
            what = f"{self.name}: {quantity[1:] or 'q'}"
            values = real_numbers(what, given, TrajectoryError)
            if t.ndim != 1 or values.shape != shape:
                raise TrajectoryError(
                    f"{what} has shape {values.shape}; t and the scene's joints make {shape}"
                )
            columns |= {f"{joint}{quantity}": values[:, i] for i, joint in enumerate(joints)}
        for payload, carried in self.payload.items():
            columns[f"payload.{payload}"] = np.asarray(carried, dtype=np.float64)
        return arrays_log(columns, {}, recorded=True)
