"""The functions of rooms above that methods of scenes and results call.

Imports go down only. `scene.solver()` and `result.plot()` lead up all the same: the package, which
stands above every room, registers what they call when it is imported. No other module may lead up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from pinfric.dynamics.solver import Solver
    from pinfric.model.scene import Scene

#: The public names that methods lead up to.
NAMES = ("Solver", "plot", "summary")
_FUNCTIONS: dict[str, Callable[..., Any]] = {}


def register(name: str, function: Callable[..., Any]) -> None:
    """Let a public name be called from the rooms below it."""
    _FUNCTIONS[name] = function


def make_solver(scene: Scene, attached: Iterable[str] | None) -> Solver:
    """Return `pf.Solver(scene, attached)`."""
    solver: Solver = _FUNCTIONS["Solver"](scene, attached)
    return solver


class Shown:
    """Results with a table and a picture."""

    def plot(self, **options: Any) -> Figure:
        """Return the figure that `--out` writes, a `matplotlib.figure.Figure`: `pf.plot`."""
        figure: Figure = _FUNCTIONS["plot"](self, **options)
        return figure

    def summary(self) -> pd.DataFrame:
        """Return the figures of each drive, a row a drive, SI units: `pf.summary`."""
        table: pd.DataFrame = _FUNCTIONS["summary"](self)
        return table
