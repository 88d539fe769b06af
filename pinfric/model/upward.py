"""The functions of higher layers that methods of scenes and results call.

Imports go down only, but `scene.solver()` and `result.plot()` call upward: the package registers
their functions here when it is imported. No other module may call upward.
"""

from __future__ import annotations

import html
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from pinfric.errors import StateError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from pinfric.checking.findings import Finding
    from pinfric.dynamics.forward.solver import Solver

#: The registered functions by their public names.
NAMES = ("Solver", "findings_of", "plot", "summary")
_FUNCTIONS: dict[str, Callable[..., Any]] = {}


def register(name: str, function: Callable[..., Any]) -> None:
    """Let a public function be called from lower layers."""
    _FUNCTIONS[name] = function


def make_solver(scene: object, attached: Iterable[str] | None) -> Solver:
    """Return `pf.Solver(scene, attached)`."""
    solver: Solver = _FUNCTIONS["Solver"](scene, attached)
    return solver


def find(scene: object, meshes: bool) -> tuple[Finding, ...]:
    """Return `checking.plausibility.findings_of`."""
    found: tuple[Finding, ...] = _FUNCTIONS["findings_of"](scene, meshes)
    return found


class Shown:
    """Results with a table and a picture.

    >>> import pinfric as pf
    >>> motion = pf.simulate(pf.load_scene("pendulum"), t_end=0.1)
    >>> motion.summary().columns.tolist()
    ['unit', 'peak', 'rms', 'work', 'heat', 'gear_heat', 'stick_time']
    """

    def plot(self, figure: str = "", **options: Any) -> Figure:
        """Return the figure that `--out` writes, or another by its name: `pf.plot`."""
        drawing: Figure = _FUNCTIONS["plot"](self, figure, **options)
        return drawing

    def summary(self) -> pd.DataFrame:
        """Return the figures of each drive, one row per drive, in SI units: `pf.summary`."""
        table: pd.DataFrame = _FUNCTIONS["summary"](self)
        return table

    def _repr_html_(self) -> str | None:
        """Return the result's table for a notebook, with units; None without times.

        For None notebooks show `repr`.
        """
        try:
            table = self.summary()
        except StateError:
            return None
        title = html.escape(repr(self).partition("\n")[0])
        shown: str = table.attrs.get("html") or table.to_html(
            float_format="{:.4g}".format, na_rep=""
        )
        return f"<p><b>{title}</b></p>{shown}"
