"""States: refusals by name, other number types, normalized directions."""

import numpy as np
import pinocchio as pin
import pytest
from builders import block, chain, lump, plane_friction, sliding_block
from mechanisms import shifted
from tables import arguments, table

import pinfric as pf
from pinfric.dynamics.samples.reversals import reversals
from pinfric.errors import SceneError, StateError

WRONG = r"""
q=np.zeros((3, 2))                    q: shape \(3, 2\); should be \(T, 1\)
v=np.zeros((2, 1))                    3, 2, 3 samples
a=np.array([[0.0], [np.nan], [0.0]])  a: sample 1, column 0 is nan
t=np.array([0.0, 0.2, 0.2])           not increasing at sample 2
threads=0                             threads = 0
chunks=0                              chunks = 0
external={"table": np.zeros((2, 6))}  external
q=np.zeros((0, 1)), v=np.zeros((0, 1)), a=np.zeros((0, 1))  no samples
attached=np.zeros((3, 2), dtype=bool)  attached: shape
q="abc"                               q: is not an array of numbers: it holds text
a=np.zeros((3, 1), dtype=bool)        a: is not an array of numbers: it holds true and
v=np.zeros((3, 1), dtype=complex)     v: .* holds complex numbers; give real numbers
v=[[0.0], [1.0, 2.0], [0.0]]          v: is not an array of numbers: .*inhomogeneous
a=np.array([[0.0], [None], [1]])      a: is not an array of numbers: it holds objects
t=["0", "1", "2"]                     t: is not an array of numbers: it holds text
t=np.arange(3) * 1j                   t: is not an array of numbers: it holds complex numbers
attached=[["no"], ["no"], ["yes"]]    attached: is not an array of numbers: .* text
attached=[[0.5], [1], [0]]            attached: holds other numbers than 0 and 1
external={"table": np.full(6, 1j)}    external\['table'\]: .* complex numbers
external=np.zeros(6)                  external: should be a mapping of frames to wrenches on them,
chunks=2.5                            chunks = 2.5; should be a whole number of at least 1
chunks=True                           chunks = True; should be a whole number
chunks="2"                            chunks = '2'; should be a whole number
threads=1.5                           threads = 1.5; should be a whole number
"""


@pytest.mark.parametrize(("change", "says"), table(WRONG, arguments, str))
def test_wrong_states_are_named(change, says):
    model = block()
    model.addBodyFrame("table", 1, pin.SE3.Identity(), 0)
    scene = pf.Scene(model=model)
    given = {"q": np.zeros((3, 1)), "v": np.zeros((3, 1)), "a": np.zeros((3, 1)), **change}
    with pytest.raises(StateError, match=says) as error:
        pf.inverse_dynamics(scene, **given)
    assert "\n" not in str(error.value)


def test_numbers_of_numpys_other_types_are_numbers():
    scene = sliding_block()
    whole, half = np.ones((4, 1), dtype=np.int32), np.full((4, 1), 0.5, dtype=np.float32)
    expected = pf.inverse_dynamics(scene, np.ones((4, 1)), np.full((4, 1), 0.5), np.ones((4, 1)))
    parts = list(pf.inverse_dynamics(scene, whole, half, whole, chunks=np.int64(3)))
    assert [len(part.effort_lower) for part in parts] == [3, 1]
    np.testing.assert_array_equal(parts[0].effort_lower, expected.effort_lower[:3])


def test_directions_off_their_circle_are_normalized_with_a_warning():
    body = lump(1.0, [0.1, 0, 0], 1.0)
    model = chain(("wheel", pin.JointModelRUBZ(), body))
    model.gravity.linear = np.array([0.0, -9.81, 0.0])
    scene = pf.Scene(model=model)
    with pytest.warns(pf.PinfricWarning, match="normalized"):
        result = pf.inverse_dynamics(scene, [[2.0, 0.0]], [[0.0]], [[0.0]])
    assert result.effort_lower[0, 0] == pytest.approx(0.981)
    with pytest.raises(StateError, match="length 0"):
        pf.inverse_dynamics(scene, [[0.0, 0.0]], [[0.0]], [[0.0]])


def test_efforts_beyond_numbers_are_refused():
    model = block()
    model.armature = np.array([1e300])
    with pytest.raises(StateError, match="effort of slide at sample 0 overflows"):
        pf.inverse_dynamics(pf.Scene(model=model), [[0.0]], [[0.0]], [[1e10]])
    model.armature = np.array([1e290])
    drive = {"joint": "slide", "transmission": {"ratio": 1e-12}}
    geared = pf.Scene(model=model, actuators=[drive])
    with pytest.raises(StateError, match="effort of slide at sample 1 overflows"):  # the motor's
        pf.inverse_dynamics(geared, np.zeros((2, 1)), np.zeros((2, 1)), [[0.0], [1e10]])
    with pytest.raises(StateError, match=r"v: sample 0, column 0 is 1e.300; should be finite"):
        pf.inverse_dynamics(sliding_block(), [[0.0]], [[1e300]], [[0.0]])
    with pytest.raises(SceneError, match=r"viscous`: should be at most 1e.12"):
        pf.Scene(model=model, friction={"slide": {"viscous": 1e200}})


# Reactions and reversals of samples.


# Reactions: wrenches at joints and links by name.


def test_a_tool_wrench_loads_the_bearings_too():
    model = block(mass=2.0)
    model.addBodyFrame("table", 1, pin.SE3.Identity(), 0)
    scene = pf.Scene(model=model, friction={"slide": plane_friction(0.5, 0.5)})
    # pressed down by 100 N and pulled back by 7 N
    tool = np.array([-7.0, 0.0, -100.0, 0.0, 0.0, 0.0])
    result = pf.inverse_dynamics(scene, [[0.0]], [[1.0]], [[0.0]], {"table": tool})
    assert result.effort_upper[0, 0] == pytest.approx(7.0 + 0.5 * (2.0 * 9.81 + 100.0))


def test_a_link_with_a_joints_name_is_the_link():
    model = block(mass=2.0)
    model.addFrame(pin.Frame("slide", 1, pin.SE3.Identity(), pin.FrameType.JOINT))
    lifted = shifted(0.0, 0.5)
    model.addFrame(pin.Frame("slide", 1, lifted, pin.FrameType.BODY))
    scene = pf.Scene(model=model)
    push = np.array([10.0, 0, 0, 0, 0, 0])
    wrench = pf.joint_wrenches(scene, [[0.0]], [[0.0]], [[0.0]], {"slide": push})
    assert wrench[0, 0, 4] == pytest.approx(-10.0 * 0.5)
    bare = pf.joint_wrenches(sliding_block(), [[0.0]], [[0.0]], [[0.0]], {"slide": push})
    assert bare[0, 0, 0] == pytest.approx(-10.0)


# Reversals: reversals between samples, also between the parts of two threads.


def test_a_reversal_between_two_threads_parts_is_seen_once():
    """Four parts of two samples: the sign changes at every border, each time to a slower speed."""
    velocity = np.array([3.0, 2.0, -1.0, -2.0, 1.0, 2.0, -1.0, -2.0])[:, None]
    expected = [False, False, True, False, True, False, True, False]
    for threads in (1, 2, 3, 4):
        found = reversals(velocity, np.zeros(1), threads)
        assert found[:, 0].tolist() == expected, threads
