"""Load-independent sliding friction: one ABA, against plain RNEA and against the search."""

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, geared_arm, lump, random_states
from mechanisms import pin_friction
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.forward.workspace import Workspace
from pinfric.errors import SceneError


@pytest.mark.parametrize("motors", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_what_slides_needs_one_aba(seed, motors):
    """The efforts of the resulting motion are those of the drives and of friction."""
    scene, rng = geared_arm(seed, locks=0.0)
    (q, *_), (v, *_), _ = random_states(scene.model, seed, 1)
    free, coupled = Workspace(scene, None, motors), Workspace(scene, None, motors)
    effort = rng.normal(scale=30.0, size=free.na)
    assert free.slides(q, v, effort, None, 1)
    coupled.solve_coupled(q, v, effort, None)
    for name in ("a", "effort", "phi", "load", "wrench", "site_modes"):
        same = getattr(coupled, name)
        assert_allclose(getattr(free, name), same, atol=1e-11 * np.abs(same).max(initial=0))
    need = pin.rnea(scene.model, scene.model.createData(), q, v, free.a)
    index = [scene.model.joints[scene.model.getJointId(n)].idx_v for n in scene.site_names]
    need[index] -= free.phi
    assert_allclose(free.effort, need, atol=1e-9 * np.abs(need).max())
    if motors:
        ratio = [drive.transmission.ratio for drive in scene.drives]
        found = pf.inverse_dynamics(scene, q[None], v[None], free.a[None]).motor_torque_upper[0]
        assert_allclose(found * ratio, effort, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize(
    ("friction", "v"),
    [
        (dry(1.0), [1.0, 0.0]),  # one rests
        (pin_friction(0.1), [1.0, 1.0]),  # loads matter
    ],
)
def test_other_states_are_left_to_the_search(friction, v):
    model = chain(*((n, pin.JointModelRY(), lump(1.0, (0.1, 0, 0)), (0.2, 0, 0)) for n in "ab"))
    scene = pf.Scene(model=model, friction=dict.fromkeys("ab", friction))
    assert not Workspace(scene).slides(np.ones(2), np.array(v), np.zeros(2), None, 1)


def test_a_singular_mass_matrix_is_still_named():
    """Two joints on one line: the first moves nothing that the second does not."""
    model = chain(("a", pin.JointModelPX()), ("b", pin.JointModelPX(), lump(1.0)), gravity=0.0)
    scene = pf.Scene(model=model, friction=dict.fromkeys("ab", dry(0.1)))
    with pytest.raises(SceneError, match=r"no finite acceleration|not positive definite"):
        pf.forward_dynamics(scene, np.zeros(2), np.ones(2), np.array([1.0, 1.0]))
