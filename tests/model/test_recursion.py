"""The recursion for wrenches, many samples at once, against Pinocchio's `data.f` and NumPy."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, random_inertia, random_states
from numpy.testing import assert_allclose, assert_array_equal

from pinfric.kernels.compiled import call_compiled
from pinfric.kernels.interpreted import plain
from pinfric.kernels.lanes import LANES
from pinfric.model.recursion import _sine_cosine, links, write_reactions
from pinfric.model.twin import make_twin


def random_arm(seed):
    """One to ten joints that turn about coordinate or tilted axes or slide, one after another."""
    rng = np.random.default_rng(seed)
    model, parent = pin.Model(), 0
    for number in range(int(rng.integers(1, 11))):
        axis = rng.normal(size=3)
        kinds = [
            *(pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelPZ()),
            *(pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis)), pin.JointModelRUBZ()),
        ]
        placement = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.4, size=3))
        kind = kinds[int(rng.integers(len(kinds)))]
        parent = model.addJoint(parent, kind, placement, f"joint_{number}")
        model.appendBodyToJoint(parent, random_inertia(rng), pin.SE3.Identity())
    return model


def reactions(model, states, run=call_compiled):
    """(n, nj, 6), once for all samples."""
    twin = make_twin(model)
    wrench = np.full((len(states[0]), twin.n_joints, 6), np.nan)
    run(write_reactions, *states, twin.embedding, links(twin), wrench)
    return wrench


@pytest.mark.parametrize("seed", range(25))
def test_wrenches_of_random_arms_are_pinocchios(seed):
    model = random_arm(seed)
    states = random_states(model, seed, 1 + seed)
    data, expected = model.createData(), []
    for state in zip(*states, strict=True):
        pin.rnea(model, data, *state)
        expected.append([force.vector.copy() for force in data.f[1:]])
    scale = np.abs(expected).max()
    assert_allclose(reactions(model, states), expected, rtol=0, atol=1e-14 * scale)


def test_a_sample_has_the_bits_that_it_has_alone_and_interpreted():
    """Also beside an angle of 1e9 rad, whose sine is NumPy's."""
    model = random_arm(7)
    q, v, a = random_states(model, 7, 2 * LANES + 3)
    q[4, model.joints[1].idx_q] = 1e9
    whole = reactions(model, (q, v, a))
    for i in range(len(q)):
        alone = reactions(model, tuple(x[i : i + 1] for x in (q, v, a)))
        assert_array_equal(whole[i : i + 1], alone)
    interpreted = reactions(model, (q, v, a), lambda kernel, *given: plain(kernel)(*given))
    assert_array_equal(whole, interpreted)


def test_sines_and_cosines_are_right_to_a_unit_in_the_last_place():
    """Judge: NumPy in more digits. Also next to whole quarters of a turn, where digits cancel."""
    rng, quarters = np.random.default_rng(0), np.arange(-63_000.0, 63_000.0)
    angle = np.concatenate(
        (
            rng.uniform(-7.0, 7.0, 100_000),
            rng.uniform(-1e5, 1e5, 100_000),
            quarters * (np.pi / 2),
            np.nextafter(quarters * (np.pi / 2), 0.0),
            rng.choice([-1.0, 1.0], 1000) * 10.0 ** rng.uniform(-300.0, 0.0, 1000),
            [0.0, -0.0],
        )
    )
    given = np.zeros((5, angle.size))
    given[0] = angle
    _sine_cosine(given)  # in Python a row may be of any length
    for found, exact in zip(given[3:], (np.sin, np.cos), strict=True):
        right = exact(angle.astype(np.longdouble))
        assert np.finfo(right.dtype).eps < 1e-18
        unit = np.spacing(np.abs(right).astype(float))
        assert (np.abs(found - right) < unit).all()


def test_of_no_joint_and_of_a_massless_link():
    model = chain(("a", pin.JointModelRX()))
    model.inertias[1] = pin.Inertia.Zero()
    assert_array_equal(reactions(model, random_states(model, 0, 3)), np.zeros((3, 1, 6)))
