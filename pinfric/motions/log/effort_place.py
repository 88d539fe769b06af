"""What a log's efforts are: motor torques, these times the gear ratios, or efforts behind gears."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pinfric.errors import PinfricError, choose_from
from pinfric.model.arrays import FloatArray
from pinfric.model.scene import Scene

#: `--effort-at`: what the efforts of a log are, and how a result names them.
EFFORT_PLACES: Mapping[str, str] = {
    "reflected": "motor torques times the gear ratios",
    "motor": "torques at the motors' shafts",
    "joint": "efforts behind the gears",
}
#: Where another place leaves less than this share of the error, a line says so.
_FITS_BETTER = 0.5


def check_effort_place(at: str, error: type[PinfricError]) -> None:
    """Refuse a place that is not one of `EFFORT_PLACES`."""
    if at not in EFFORT_PLACES:
        raise error(f"--effort-at {at}: {choose_from(at, EFFORT_PLACES)}")


def drive_ratios(scene: Scene) -> FloatArray:
    """Return the gear ratio of each drive, (na,); 1 without a gear."""
    return np.array([drive.ratio for drive in scene.drives])


def factors_to_joint(scene: Scene, at: str) -> FloatArray:
    """Return factors (na,) from logged efforts to efforts at the joint."""
    return drive_ratios(scene) if at == "motor" else np.ones(len(scene.drives))


def place_note(scene: Scene, at: str) -> str:
    """Return what a log's efforts are taken for, if it matters, else ""."""
    ratios = np.unique(np.abs(drive_ratios(scene)))
    if (ratios == 1.0).all():
        if at != "motor":
            return ""
        return (
            "the log's efforts are torques at the motors' shafts (--effort-at motor), but the "
            "scene names no gear: ratio 1; give `actuators: ... transmission: {ratio: ...}`"
        )
    low, high = f"{ratios[0]:.5g}", f"{ratios[-1]:.5g}"
    span = f"ratio {low}" if low == high else f"ratios {low} to {high}"
    others = " or ".join(
        f"--effort-at {name} ({words})" for name, words in EFFORT_PLACES.items() if name != at
    )
    return f"the log's efforts are taken as {EFFORT_PLACES[at]} ({span}); otherwise give {others}"


def better_place(at: str, errors: Mapping[str, float]) -> str:
    """Return a line where the log's efforts fit another place clearly better; else "".

    `errors`: place -> median of the drives' relative errors.
    """
    best = min(errors, key=errors.__getitem__)
    if not errors[best] < _FITS_BETTER * errors[at]:
        return ""
    return (
        f"the log's efforts fit better as {EFFORT_PLACES[best]} (--effort-at {best}): off by "
        f"{errors[best]:.2g} of their RMS, not by {errors[at]:.2g} (median over the drives)"
    )
