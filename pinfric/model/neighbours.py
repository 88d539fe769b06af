"""Modules that register what they add: each in the folder of its registry."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules


@cache
def import_neighbours(registry: str) -> None:
    """Import all modules in the folder of a module, by its name; once in a process."""
    package = import_module(registry.rpartition(".")[0])
    for module in iter_modules(package.__path__):
        import_module(f"{package.__name__}.{module.name}")
