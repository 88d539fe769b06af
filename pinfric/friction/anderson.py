"""Fixed points by Anderson's extrapolation (Anderson 1965; Walker and Ni 2011)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

_PASSES = 400


def anderson(
    step: Callable[[np.ndarray], np.ndarray], x: np.ndarray, sharp: float
) -> tuple[np.ndarray | None, int]:
    """Solve x = G(x), with Anderson's extrapolation over the last four passes; None: it fails.

    It ends at a relative difference of `sharp`, or where rounding prevents further progress.
    """
    points: list[np.ndarray] = []
    residuals: list[np.ndarray] = []
    best, since = np.inf, 0
    for passes in range(_PASSES):
        image = step(x)
        rest = image - x
        if not np.isfinite(rest).all():
            return None, passes
        error, size = float(np.abs(rest).max(initial=0.0)), float(np.abs(image).max(initial=0.0))
        if error <= sharp * size:
            return image, passes
        since = 0 if error < 0.5 * best else since + 1
        best = min(best, error)
        if since > 12 and error <= 1e-12 * size:
            return image, passes  # rounding
        points, residuals = [*points[-4:], image], [*residuals[-4:], rest]
        x = image
        if len(points) > 1:
            slope = np.array([r - rest for r in residuals[:-1]]).T
            share_ = np.linalg.lstsq(slope, -rest, rcond=1e-10)[0]
            x = image + np.array([p - image for p in points[:-1]]).T @ share_
    return None, _PASSES
