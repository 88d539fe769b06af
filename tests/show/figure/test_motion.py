import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, plane_friction, sliding_block
from printed import assert_printed, figure_text

import pinfric as pf
from pinfric.show.figure.motion import motion_figure


@pytest.mark.parametrize(
    "moved",
    [
        lambda: pf.simulate(sliding_block(plane_friction(0.5, 0.3)), [0.0], [1.0], [0.0], 1.0),
        lambda: many(5),
        lambda: pf.simulate(pf.load_scene("four_bar"), t_end=0.02),
    ],
    ids=["block", "chain", "loop"],
)
def test_what_is_drawn(moved, request):
    """The block rests from 1/(0.3 x 9.81) = 0.34 s on; a loop's joint has no position."""
    text = figure_text(motion_figure(moved()))
    assert_printed(__file__, f"motion_{request.node.callspec.id}", text)


def many(count, still=3):
    """A chain of `count` joints: the first has little friction, the last `still` are held."""
    link = pin.JointModelRZ(), pin.Inertia.FromSphere(0.1, 0.02), [0.0, 0.0, 0.1]
    model = chain(*((f"finger_{i}_joint", *link) for i in range(count)))
    held = {f"finger_{i}_joint": dry(9.0, 8.0) for i in range(count - still, count)}
    held["finger_0_joint"] = dry(1e-4)
    scene = pf.Scene(model=model, friction=held)
    speed = np.append(np.full(count - still, 1.0), np.zeros(still))
    return pf.simulate(scene, np.zeros(count), speed, np.zeros(count), 0.01)


@pytest.mark.slow
def test_the_figure_of_many_joints_is_one_screen_or_two_and_counts_the_rest():
    motion = many(40)
    figure = motion_figure(motion)
    width, height = figure.get_size_inches() * figure.dpi
    assert (width, height) == (1650, pytest.approx(3000, abs=300))
    texts = [text.get_text() for text in figure.texts]
    drawn = [name for axes in figure.axes if "finger" in (name := axes.get_title(loc="left"))]
    assert len(drawn) == 16
    assert drawn == sorted(drawn, key=lambda name: int(name.split("_")[1]))  # as in the model
    assert not {f"finger_{i}" for i in range(37, 40)} & set(drawn)
    (line,) = [text for text in texts if "not drawn" in text]
    assert "3 that never move and 21 that travel less" in line
    figure.draw_without_rendering()


@pytest.mark.slow
def test_joints_that_never_move_give_way_where_there_are_many():
    figure = motion_figure(many(20, still=15))
    assert len(figure.axes) == 3 * 5
    assert any("not drawn: 15 that never move" in text.get_text() for text in figure.texts)
    assert len(motion_figure(many(16, still=15)).axes) == 3 * 16
