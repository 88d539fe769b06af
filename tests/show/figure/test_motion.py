"""Pictures of simulated motions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, plane_friction, sliding_block

import pinfric as pf
from pinfric.show.figure.motion import motion_figure
from pinfric.show.motion_summary import motion_summary


def shades(axes):
    return [c.get_paths() for c in axes.collections if c.get_gid() == "sticking"]


def test_the_figure_shades_stick_and_has_a_panel_per_site():
    scene = sliding_block(plane_friction(0.5, 0.3))
    motion = pf.simulate(scene, [0.0], [1.0], np.zeros(1), 1.0)
    assert motion.stick_intervals()[0].start == pytest.approx(1.0 / (0.3 * 9.81), rel=1e-6)
    figure = motion_figure(motion)
    assert len(figure.axes) == 3
    assert [len(paths) for paths in shades(figure.axes[2])] == [1]
    loss = motion_summary(motion).energy.friction_loss
    assert loss["slide"] == pytest.approx(1.0, rel=1e-6)


def many(count, still=3):
    """A chain of `count` joints: the first rubs a little, the last `still` are held."""
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


def test_a_joint_is_shaded_where_it_sticks_and_nowhere_else():
    motion = many(5)
    by_name = {}
    for row in np.reshape(motion_figure(motion).axes, (-1, 3)):
        by_name[row[0].get_title(loc="left")] = [sum(map(len, shades(axes))) for axes in row]
    assert by_name["finger_0"] == [0, 0, 0]
    assert by_name["finger_4"] == [1, 1, 1]


def test_a_loops_joint_has_its_friction_and_says_why_it_has_no_position():
    motion = pf.simulate(pf.load_scene("four_bar"), t_end=0.02)
    figure = motion_figure(motion)
    *_, last = np.reshape(figure.axes, (-1, 3))
    assert [text.get_text() for text in last[0].texts] == ["closes a loop"]
    assert last[0].get_title(loc="left") == "rocker"
    assert len(last[2].lines) == 4
    figure.draw_without_rendering()
