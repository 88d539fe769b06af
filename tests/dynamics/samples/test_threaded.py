"""Several threads: bitwise the same numbers, wherever the samples are cut."""

import os
import subprocess
import sys
import threading

import numba
import numpy as np
import pinocchio as pin
import pytest
from builders import random_friction, random_states, random_tree
from judges.verdict import judge

import pinfric as pf
from pinfric.dynamics.samples.threaded import team

EVERYTHING = (
    "effort_lower",
    "effort_upper",
    "effort_frictionless",
    "normal_load",
    "wrench",
    "friction_lower",
    "friction_upper",
    "sticking",
    "reversal",
)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [1, 2, 3, 7, 2049])
def test_threads_change_no_bit(samples):
    """Sliding joints, too: a guide fixed to its parent reads the displacement of its own samples"""
    model = random_tree(3, 6, sliding=0.5)
    model.armature = np.linspace(0.0, 0.3, model.nv)
    friction = random_friction(model, 3)
    moving = [
        joint
        for joint, kind in zip(model.names[1:], model.joints[1:], strict=True)
        if "P" in kind.shortname()[10:]
    ]
    friction |= {
        joint: {
            "bearing": {"kind": "guide", "length": 0.2, "width": 0.1, "on": "parent"},
            "mu": {"static": 0.3, "kinetic": 0.2},
        }
        for joint in moving
    }
    friction.pop(model.names[2])  # one joint without: its wrench is no site's
    scene = pf.Scene(model=model, friction=friction)
    assert moving
    q, v, a = random_states(model, 1, samples)
    v[samples // 2 :, 0] = 0.0
    t = np.arange(float(samples))
    one = pf.inverse_dynamics(scene, q, v, a, t=t, threads=1)
    for threads in (2, 3, 4):
        several = pf.inverse_dynamics(scene, q, v, a, t=t, threads=threads)
        for name in EVERYTHING:
            np.testing.assert_array_equal(getattr(several, name), getattr(one, name), err_msg=name)
    assert judge(one).passed(1e-10)


def test_a_team_leaves_numbas_threads_as_they_were():
    before = numba.get_num_threads()
    with team(2) as parts:
        assert numba.get_num_threads() == parts == min(2, numba.config.NUMBA_NUM_THREADS)
    assert numba.get_num_threads() == before
    with team(1000) as parts:
        assert parts == numba.config.NUMBA_NUM_THREADS
    with pytest.raises(ZeroDivisionError), team(2):
        raise ZeroDivisionError
    assert numba.get_num_threads() == before


def test_python_threads_share_a_scene():
    """Threads take turns between any two lines of Python."""
    scene = pf.Scene(model=random_tree(5, 30))
    motions = [random_states(scene.model, seed, 300) for seed in range(2)]
    right = [
        np.array([data_f(scene.model, *state) for state in zip(*motion, strict=True)])
        for motion in motions
    ]
    found: dict[int, np.ndarray] = {}

    def work(n):
        found[n] = np.array([pf.joint_wrenches(scene, *motions[n], threads=1) for _ in range(4)])

    threads = [threading.Thread(target=work, args=(n,)) for n in range(2)]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(interval)
    for n in range(2):
        for wrenches in found[n]:
            np.testing.assert_allclose(wrenches, right[n], atol=1e-9)


def data_f(model, q, v, a):
    """Wrenches of one state by data of its own."""
    data = model.createData()
    pin.rnea(model, data, q, v, a)
    return np.array([force.vector for force in data.f[1:]])


FORKED = """
import os, sys
import numpy as np
import pinfric as pf
scene = pf.load_scene("three_link")
q, v, a = np.random.default_rng(0).normal(size=(3, 9, 3))
for threads in (1, 2):
    whole = pf.inverse_dynamics(scene, q, v, a, threads=threads)
    child = os.fork()
    if child == 0:
        found = pf.inverse_dynamics(scene, q, v, a, threads=2)
        os._exit(0 if (found.effort_lower == whole.effort_lower).all() else 1)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.slow
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="threads need cores")
def test_a_forked_process_is_not_ended_by_the_threads_of_its_parent():
    """OpenMP ends a child that asks for threads after its parent had some: it gets one."""
    done = subprocess.run(
        [sys.executable, "-c", FORKED], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.split() == ["0", "0"], done.stderr
