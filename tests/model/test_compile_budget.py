"""What compiling costs, counted in the source: a kernel more, or a longer one, is a choice."""

from __future__ import annotations

import ast
import importlib
import inspect
import textwrap
from functools import cache

import pytest
from numba.core.dispatcher import Dispatcher

from pinfric.dynamics.problem.instant import finish
from pinfric.friction.consistency import site_friction

#: Entry -> milliseconds of processor time that compiling it and all it calls may take, about:
#: 200 for each kernel, 3 for each operation that is typed, 1 for each that LLVM optimizes with it,
#: fitted to 140 kernels timed one by one (correlation 0.87). What `finish` does beyond 2,000: loads
#: of gears and bearings that hold without limit, and exact zeros beside what sticks. A kernel that
#: entries share counts in each of them, and is compiled once.
BUDGET = {
    "dynamics.problem.instant.solve_instant": 66_300,
    "dynamics.problem.instant.finish": 3_500,
    "dynamics.inverse.effort_maps.map_friction": 6_300,
    "dynamics.inverse.effort_maps.write_wrenches": 1_400,
    "dynamics.inverse.choices.solve_list": 13_400,
    "dynamics.forward.solver.rub": 5_800,
    "dynamics.samples.threaded.bound_in_parts": 3_900,
    "friction.branching.branch": 6_700,
    "friction.least_use.descend": 5_100,
    "model.kinematics.relate_pairs": 6_700,
    "model.kinematics.act_on_joints": 3_400,
}
OPERATIONS = (
    ast.BinOp,
    ast.UnaryOp,
    ast.BoolOp,
    ast.Compare,
    ast.Call,
    ast.Subscript,
    ast.Assign,
    ast.AugAssign,
    ast.For,
    ast.If,
    ast.IfExp,
)


def callees(kernel):
    function = kernel.py_func
    named = (function.__globals__.get(name) for name in function.__code__.co_names)
    return [found for found in named if isinstance(found, Dispatcher)]


@cache
def operations(kernel):
    tree = ast.parse(textwrap.dedent(inspect.getsource(kernel.py_func)))
    return sum(isinstance(node, OPERATIONS) for node in ast.walk(tree))


@cache
def optimized(kernel):
    """Operations of a kernel with those of its callees, once for every place that calls them."""
    return operations(kernel) + sum(map(optimized, callees(kernel)))


def reached(entry):
    found = [entry]
    for kernel in found:  # grows while it is walked
        found += [callee for callee in callees(kernel) if callee not in found]
    return found


def cost(kernel):
    return 200 + 3 * operations(kernel) + optimized(kernel)


@pytest.mark.parametrize("entry", BUDGET)
def test_compiling_stays_within_its_budget(entry):
    module, _, name = entry.rpartition(".")
    kernels = reached(getattr(importlib.import_module(f"pinfric.{module}"), name))
    found, dearest = sum(map(cost, kernels)), sorted(kernels, key=cost, reverse=True)[:5]
    assert found <= BUDGET[entry], f"{len(kernels)} kernels; the dearest: " + ", ".join(
        f"{kernel.py_func.__name__} {cost(kernel)}" for kernel in dearest
    )


def test_what_a_kernel_calls_counts():
    assert site_friction in reached(finish)
    assert optimized(finish) > operations(finish) + operations(site_friction)
