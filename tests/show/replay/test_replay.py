"""Replays without a browser: frames, what each site does, shapes, pages, bad input."""

import json

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, lump
from numpy.testing import assert_allclose
from replay_cases import arm, result_of

import pinfric as pf
from pinfric.errors import PinfricError, PinfricWarning, StateError
from pinfric.model.described import in_json
from pinfric.retiming.limits import read_limits
from pinfric.retiming.problem import usage
from pinfric.show.replay.replay import (
    Replay,
    open_page,
    replay_lines,
)
from pinfric.show.timeline.frames import make_frames
from pinfric.show.timeline.motion import motion_to_replay

pytestmark = [
    pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:.*loaded without:pinfric.errors.PinfricWarning"),
    pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning"),
]


def test_replay_goes_on_without_meshes(tmp_path):
    scene = arm(tmp_path, "gone.stl")
    t = np.linspace(0, 1, 50)[:, None]
    result = pf.inverse_dynamics(scene, t, np.ones_like(t), 0 * t, t=t[:, 0])
    with pytest.warns(PinfricWarning, match="gone.stl"):
        shown = pf.replay(scene, result, html=tmp_path / "out.html")
    assert shown.html.stat().st_size > 300_000


def test_notebook_shows_the_page_in_a_frame(three_link):
    shown = pf.replay(*three_link)
    inside = shown._repr_html_()
    assert inside.startswith("<iframe srcdoc=")
    assert '"' not in inside.split('srcdoc="')[1].split('" style=')[0]


def test_a_trajectory_is_replayed_as_its_inverse_dynamics():
    scene = pf.load_scene("pendulum")
    trajectory = pf.load_trajectory("pendulum", scene)
    result = pf.inverse_dynamics(scene, trajectory)
    shown = pf.replay(scene, trajectory)
    assert in_json(shown) == in_json(pf.replay(scene, result))
    assert len(shown.stick_intervals) == 3


def test_json_is_what_the_command_prints(three_link, tmp_path):
    shown = pf.replay(*three_link, html=tmp_path / "out.html")
    printed = json.loads(json.dumps(in_json(shown)))
    assert set(printed) == {"html", "duration", "frames", "stick_intervals"}
    assert printed["html"] == str(tmp_path / "out.html")
    assert [i["site"] for i in printed["stick_intervals"]] == ["joint_12"] * 3


def test_springs_are_not_said_to_drive(tmp_path):
    """The KR 300 is driven at its joints, and has a gas spring between two links."""
    q = np.array([[0.0, -1.5, 1.5, 0.0, 0.0, 0.0]] * 2)
    scene = pf.load_scene("kr300")
    for springs, seen in ((scene.springs, True), ((), False)):
        now = scene.with_(springs=springs)
        result = pf.inverse_dynamics(now, q, 0 * q, 0 * q, t=[0.0, 1.0])
        text = pf.replay(now, result, html=tmp_path / "out.html").html.read_text()
        assert ("spring between links" in text) == seen
        assert "cylinder or force that drives" not in text


def pushed():
    """2 kg m^2 that 4 N m speed up for 1 s, that rests on at 2 rad/s, that 6 N m brake; rest."""
    model = chain(("j", pin.JointModelRZ(), lump(1.0, moment=2.0)))
    t = np.arange(3001) / 1000.0
    a = np.select([t <= 1.0, t <= 2.0, t < 2.0 + 2 / 3], [2.0, 0.0, -3.0], 0.0)[:, None]
    v = np.where(t <= 1.0, 2.0 * t, np.clip(2.0 - 3.0 * (t - 2.0), 0.0, 2.0))[:, None]
    scene = pf.Scene(model=model)
    return scene, pf.inverse_dynamics(scene, np.cumsum(v, axis=0) / 1000.0, v, a, t=t)


def test_limits_that_hold_the_motion_back_are_marked_while_it_moves():
    scene, result = pushed()
    limits = {"j": {"peak_torque": 4.01, "velocity": 2.0}}
    marked = make_frames(scene, result, limits=read_limits(scene, limits)).limiting
    (torque, over), (speed, faster) = marked["j"]["peak torque"], marked["j"]["joint speed"]
    assert_allclose(torque, [(0.0, 1.0), (2.0, 2.0 + 2 / 3)], atol=3e-3)
    assert_allclose(over, torque[1:], atol=1e-9)
    assert_allclose(speed, [(1.0, 2.0)], atol=3e-3)
    assert faster == ()
    assert make_frames(scene, result).limiting == {}
    page = pf.replay(scene, result, limits=limits).page
    assert "peak torque exceeded" in page
    geared = scene.with_(actuators=[{"joint": "j", "transmission": {"ratio": 2.0}}])
    old = result.states
    half = pf.inverse_dynamics(geared, old.q, old.v, old.a, t=old.t)  # its motor gives half of it
    assert "peak torque" not in pf.replay(geared, half, limits=limits).page


def test_limits_of_a_loops_drive_are_those_of_its_joint():
    scene = pf.load_scene("four_bar")
    given = pf.load_trajectory("four_bar", scene)
    t, q, v, a = (x[200:800:60] for x in (given.t, given.q, given.v, given.a))
    motion = pf.inverse_dynamics(scene, q, v, a, t=t)
    crank = scene.drives[0].velocity_index
    top = np.abs(motion.states.v[:, crank]).max()
    for speed, over in ((2.0 * top, False), (0.9 * top, True)):
        limits = read_limits(scene, {scene.actuator_names[0]: {"effort": 1e3, "velocity": speed}})
        assert (usage(motion, limits).max() > 1.0) == over
        make_frames(scene, motion, limits=limits)


def test_limits_of_a_simulated_motion_are_refused(pendulum_motion):
    scene, motion = pendulum_motion
    limits = {name: {"peak_torque": 1.0} for name in scene.actuator_names}
    with pytest.raises(StateError, match="limits are for results of inverse dynamics"):
        pf.replay(scene, motion, limits=limits)


def test_command_takes_a_trajectory_a_saved_motion_or_the_scenes_simulation(
    pendulum_motion, tmp_path, capsys
):
    scene, motion = pendulum_motion
    given, log = motion_to_replay(scene, "pendulum.waypoints.yaml")
    assert isinstance(given, pf.InverseResult)
    assert log is None  # way-points have no efforts of their own
    file = motion.save(tmp_path / "motion.npz")
    assert motion_to_replay(scene, str(file))[0].stick_intervals() == motion.stick_intervals()
    own, _ = motion_to_replay(scene)
    assert own.stick_intervals()[0].start == pytest.approx(1.07, abs=0.01)  # printed in the paper
    with pytest.raises(PinfricError, match=r"nothing\.csv"):
        motion_to_replay(scene, "nothing.csv")
    shown = pf.replay(scene, own, html=tmp_path / "out.html")
    first, second = replay_lines(shown, opened=False)
    assert "1 stiction interval: " in first
    assert str(tmp_path / "out.html") in first
    assert "no display" in second
    assert len(replay_lines(shown, opened=True)) == 1


def test_result_without_times_is_refused(three_link):
    scene, _ = three_link
    result = pf.inverse_dynamics(scene, np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)))
    with pytest.raises(StateError, match="give `t`"):
        pf.replay(scene, result)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
def test_rate_must_be_positive(three_link, rate):
    with pytest.raises(StateError, match="rate"):
        pf.replay(*three_link, rate=rate)


def test_without_display_the_page_is_written_and_named(three_link, monkeypatch):
    import webbrowser

    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(webbrowser, "open", lambda _: pytest.fail("a text browser was started"))
    shown = pf.replay(*three_link, open_browser=True)
    assert shown.html.read_text() == shown.page
    assert str(shown.html) in repr(shown)
    assert shown.open() is False
    monkeypatch.setenv("DISPLAY", ":0")
    asked = []
    monkeypatch.setattr(webbrowser, "open", lambda url: asked.append(url) or True)
    assert open_page(shown.html)
    assert open_page("http://127.0.0.1:7000/static/")
    assert asked == [shown.html.as_uri(), "http://127.0.0.1:7000/static/"]
    assert Replay("", None, 0.0, 0, ()).open() is False

    # The page: one file that fetches nothing.

    (pytest.mark.filterwarnings("ignore:.*<dynamics>:pinfric.errors.PinfricWarning"),)


def test_page_is_one_file_that_fetches_nothing(three_link, tmp_path):
    import re

    scene, result = three_link
    shown = pf.replay(scene, result, html=tmp_path / "deep" / "out.html", title="a < b & </script>")
    page = shown.html.read_text()
    assert page == shown.page
    assert "<title>a &lt; b &amp; &lt;/script&gt;</title>" in page
    assert not re.search(r"""(src|href)=["'](?!data:)|https?://|@import|fetch\(""", page)
    assert page.count("</script>") == 5  # viewer, data, commands, frames, ours
    assert not list((tmp_path / "deep").glob(".unfinished*"))
    assert (shown.frames, shown.duration) == (179, pytest.approx(2.9))


@pytest.mark.slow
def test_pages_of_the_bundled_robots_stay_below_a_megabyte_and_a_half():
    for name in ("panda_pick_and_place", "so101", "ur10_machine_tending"):
        scene, result = result_of(name)
        shown = pf.replay(scene, result)
        assert 1e6 < len(shown.page) < 1.5e6
        assert shown.html is None


def test_page_that_cannot_be_written_is_one_clear_error(three_link, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(PinfricError, match="cannot be written"):
        pf.replay(*three_link, html=tmp_path / "file" / "out.html")
