"""What is there: scene, robot, twin, bearings, laws, drives."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from pinfric.dynamics.solver import Solver as Solver
    from pinfric.model.scene import Scene

#: What `Scene.solver` calls: the package sets it, for dynamics build on scenes, not they on it.
make_solver: Callable[[Scene, Iterable[str] | None], Solver]
