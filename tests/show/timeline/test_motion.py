"""The motion of a replay: a saved one of this scene only."""

from __future__ import annotations

import pytest

import pinfric as pf
from pinfric.errors import PinfricError, StateError
from pinfric.show.timeline.motion import motion_to_replay

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def test_motion_of_another_scene_is_refused_and_says_what_differs(three_link, pendulum_motion):
    scene, _ = three_link
    with pytest.raises(StateError, match=r"pendulum\.yaml.*three_link\.yaml differs in joints"):
        pf.replay(scene, pendulum_motion[1])
    smoother = pf.Scene(model=scene.model, friction={"joint_12": {"viscous": 0.1}})
    with pytest.raises(StateError, match="differs in friction"):
        pf.replay(smoother, three_link[1])


def test_saved_motion_of_another_scene_is_refused(three_link, pendulum_motion, tmp_path):
    file = pendulum_motion[1].save(tmp_path / "motion.npz")
    back = pf.load_motion(file, pendulum_motion[0])
    assert pf.replay(pendulum_motion[0], back).stick_intervals == (
        pendulum_motion[1].stick_intervals()
    )
    with pytest.raises(PinfricError, match=r"pendulum\.yaml.*differs in joints"):
        pf.load_motion(file, three_link[0])


def test_motion_file_that_is_not_there_is_called_so(pendulum_motion):
    with pytest.raises(PinfricError, match=r"there is no file nothing\.npz"):
        motion_to_replay(pendulum_motion[0], "nothing.npz")
