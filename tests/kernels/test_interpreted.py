"""Kernels are plain Python until compiling them pays, with the same results."""

import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.forward.solver import finish_sample, make_sample
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.kernels import interpreted
from pinfric.kernels.compiled import compiling, kernel

ROOT = Path(__file__).parents[2]


@kernel
def inner(x):
    return x * x


@kernel
def sum_of_squares(x, out):
    out[0] = 0.0
    for i in range(x.size):
        out[0] += inner(x[i])
    return out[0]


@kernel
def power(x, y):
    return x**y


def make_scaling(factor):
    """A kernel that no module has under its function's name, and that reads an outer variable."""

    @kernel
    def scale(x):
        return factor * x

    return scale


tripled = make_scaling(3.0)


@kernel
def triple_and_square(x):
    return inner(tripled(x))


class Sums(NamedTuple):
    total: np.ndarray
    count: np.ndarray


@kernel
def add_reciprocal(x, sums):
    sums.count[0] += 1
    sums.total[0] += 1.0 / x


@pytest.fixture
def patient(monkeypatch):
    """A clock of its own that has all its patience, and kernels that nothing holds."""
    clock = interpreted._Clock()
    for module in ("pinfric.kernels.compiled", "pinfric.kernels.interpreted"):
        monkeypatch.setattr(f"{module}.CLOCK", clock)
    monkeypatch.setattr(interpreted, "PATIENCE", 20.0)
    kernels = {inner, sum_of_squares, power, tripled, triple_and_square, add_reciprocal}
    monkeypatch.setattr("pinfric.kernels.compiled._MISSING", kernels)
    return clock


def test_few_numbers_are_interpreted_and_many_compiled(patient):
    few, many, out = np.arange(4.0), np.ones(5000), np.zeros(1)
    assert sum_of_squares(few, out) == out[0] == 14.0
    assert sum_of_squares.overloads == inner.overloads == {}
    assert 0.0 < patient.here < 1.0
    assert sum_of_squares(many, out) == out[0] == 5000.0
    assert len(sum_of_squares.overloads) == 1


def test_what_overflows_in_python_is_compiled(patient):
    assert power(10.0, 400.0) == np.inf
    assert len(power.overloads) == 1


def test_a_kernel_is_interpreted_whatever_name_it_has_in_its_module(patient):
    """As the kernels that box records have: all are called `box` in another module."""
    for _ in range(2):
        assert triple_and_square(2.0) == 36.0
    assert triple_and_square.overloads == tripled.overloads == {}


def test_what_is_compiled_in_the_middle_starts_from_the_arrays_as_they_were(patient):
    """Counted before the division by zero: interpreted and then compiled it would count twice."""
    sums = Sums(np.array([1.0]), np.zeros(1, dtype=np.int64))
    add_reciprocal(2.0, sums)
    assert (sums.total[0], sums.count[0]) == (1.5, 1)
    assert not add_reciprocal.overloads
    add_reciprocal(0.0, sums)
    assert (sums.total[0], sums.count[0]) == (np.inf, 2)
    assert len(add_reciprocal.overloads) == 1


def test_within_compiling_few_numbers_are_compiled_too(patient):
    with compiling():
        assert triple_and_square(2.0) == 36.0
    assert len(triple_and_square.overloads) == 1
    assert patient.here == 0.0
    assert triple_and_square(1.0) == 9.0  # and stays so
    assert patient.here == 0.0


@pytest.mark.parametrize("name", ["three_link", "ur10_machine_tending"])
def test_inverse_dynamics_of_one_state_can_be_interpreted(name):
    """Its module holds kernels that box records; friction and gears as the equations say."""
    scene = pf.load_scene(name)
    x = make_sample(Workspace(scene), scene)
    rng = np.random.default_rng(4)
    motion = rng.normal(size=(3, scene.model.nv))
    pinocchio = Workspace(scene).pinocchio
    pinocchio.balance(*motion)
    x.chain.force[:], x.chain.h[:] = pinocchio.views.force, pinocchio.views.h
    assert interpreted.plain(finish_sample)(x, *motion)
    rnea = pin.rnea(scene.model, scene.twin().model.createData(), x.q, x.v[0], x.a[0])
    found = x.found
    assert_allclose(found.effort_frictionless[0], rnea, rtol=1e-9, atol=1e-9)
    lost = (found.effort_lower[0] - found.effort_frictionless[0]) @ x.v[0]
    assert_allclose(lost, -(found.friction_lower[0] @ found.velocity[0]), rtol=1e-12)
    assert lost > 0.0


def test_patience_ends_and_is_remembered(patient, tmp_path, monkeypatch):
    patient.keep_in(str(tmp_path))
    patient.here = 12.0
    assert not patient.is_over()
    patient._write()
    later = interpreted._Clock()
    later.keep_in(str(tmp_path))
    assert not later.is_over()
    later.here = 9.0
    assert later.is_over()
    later._write()
    assert float((tmp_path / "pinfric.interpreted").read_text()) == pytest.approx(21.0)
    (tmp_path / "pinfric.interpreted").write_text("damaged")
    third = interpreted._Clock()
    third.keep_in(str(tmp_path))
    assert not third.is_over()


COLD = """
import sys
import numpy as np
import pinfric as pf
import pinocchio as pin
from pinfric.kernels import interpreted
if sys.argv[1] == "compiled":
    interpreted.PATIENCE = 0.0
for name in ("three_link", "drawer", "four_bar"):
    scene = pf.load_scene(f"{sys.argv[2]}/robots/{name}.yaml")
    neutral, v = pin.neutral(scene.model), np.linspace(0.3, 0.5, scene.model.nv)
    q = pin.integrate(scene.model, neutral, np.array([0.5, 0.4, 1.5])[: len(v)])
    if scene.loops:
        q, v = scene.close(q), 0.0 * v
    for effort in (0.0, 2.0):
        instant = pf.forward_dynamics(scene, q, v, np.full(len(scene.drives), effort))
        print(*(repr(float(x)) for x in (*instant.a, *instant.friction, *instant.normal_load)))
"""


def run(folder, *arguments, **more):
    env = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(folder)}
    return subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        env=env,
        check=True,
        timeout=300,
        **more,
    )


@pytest.mark.slow
def test_interpreted_and_compiled_agree(tmp_path):
    cold = run(tmp_path / "empty", "-c", COLD, "interpreted", str(ROOT)).stdout
    compiled = run(os.environ.get("NUMBA_CACHE_DIR", ""), "-c", COLD, "compiled", str(ROOT)).stdout
    a = np.array([float(x) for x in cold.split()])
    b = np.array([float(x) for x in compiled.split()])
    assert len(a) == len(b) > 20
    assert_allclose(a, b, rtol=1e-12, atol=1e-12 * np.abs(b).max())


@pytest.mark.slow
def test_a_first_simulation_does_not_wait_for_compilers(tmp_path):
    scene = ROOT / "robots/three_link.yaml"
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = run(tmp_path / "empty", "-m", "pinfric", "simulate", str(scene))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert "compiling" not in done.stderr
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 8.0
