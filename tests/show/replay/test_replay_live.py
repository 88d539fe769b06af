"""The live viewer: its server, what it shows of a running simulation, how it ends."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from test_replay import boom  # beside this file

import pinfric as pf
from pinfric.errors import PinfricWarning, SceneError
from pinfric.show.replay.live import LiveReplay, simulate_live

ROBOTS = Path(__file__).parents[3] / "robots"
pytestmark = pytest.mark.filterwarnings("ignore:zmq.eventloop:DeprecationWarning")


@pytest.fixture(scope="module")
def three_link():
    return pf.load_scene(ROBOTS / "three_link.yaml")


@pytest.fixture(scope="module")
def pendulum_motion():
    scene = pf.load_scene(ROBOTS / "pendulum.yaml")
    return scene, pf.simulate(scene, [0.524], [1.0], None, 2.0)


def test_live_server_takes_the_next_port_shows_states_and_ends(three_link):
    busy = []
    for port in (7000, 6000):
        taken = socket.socket()
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            taken.bind(("0.0.0.0", port))
            taken.listen()
        except OSError:  # somebody else has it: as good
            taken.close()
        else:
            busy.append(taken)
    with pf.LiveReplay(three_link) as live:
        port = int(live.url.split(":")[2].split("/")[0])
        assert port > 7000
        with urllib.request.urlopen(live.url, timeout=10) as answer:
            assert b"meshcat" in answer.read().lower()
        process = live._window._process
        before = live._window.sent
        for k in range(300):  # a simulation's steps come faster than frames
            live(1e-3 * k, np.array([1e-3 * k, 0.0, 0.0]), modes=np.array([0]))
        assert 1 <= live.frames < 100
        assert live._window.sent - before >= 3 * live.frames
        live.show(np.zeros(3), v=np.array([0.0, 1.0, 0.0]))
        assert live._states == ["sliding"]
        live.show(np.zeros(3), v=np.zeros(3))
        assert live._states == ["sticking"]
    assert process.poll() is not None
    for taken in busy:
        taken.close()


def test_watched_simulation_is_the_same_simulation(pendulum_motion):
    scene, alone = pendulum_motion
    with pf.LiveReplay(scene, rate=1e6) as live:
        watched = pf.simulate(scene, [0.524], [1.0], t_end=2.0, **live.watch())
        assert live.frames > 100
        assert live._states == ["sliding"]
    np.testing.assert_array_equal(watched.q, alone.q)
    assert watched.stick_intervals() == alone.stick_intervals()


def test_scene_is_simulated_live_at_the_pace_asked_for():
    scene, said = pf.load_scene(ROBOTS / "pendulum.yaml"), []
    begun = time.monotonic()
    motion = simulate_live(scene, said.append, t_end=0.8, pace=2.0)
    assert time.monotonic() - begun > 0.4
    assert motion.t[-1] == pytest.approx(0.8)
    assert len(said) == 1
    assert "http://127.0.0.1:" in said[0]
    with pytest.raises(SceneError, match="no `simulation` section"):
        simulate_live(pf.Scene(model=scene.model), said.append)


def test_live_server_that_dies_does_not_stop_the_simulation(three_link):
    with LiveReplay(three_link) as live:
        live._window._process.kill()
        live._window._process.wait()
        with pytest.warns(PinfricWarning, match="going on without") as caught:
            [live.show(np.full(3, x)) for x in (0.0, 1.0)]
        assert len(caught) == 1


def test_live_server_ends_with_its_process_however_that_ends():
    code = (
        "import os, pinfric as pf\n"
        f"live = pf.LiveReplay(pf.load_scene(r'{ROBOTS / 'pendulum.yaml'}'))\n"
        "print(live._window._process.pid, flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == -9
    status = Path(f"/proc/{int(done.stdout)}/stat")
    deadline = time.monotonic() + 5.0
    while status.exists() and status.read_text().split()[2] != "Z":
        assert time.monotonic() < deadline, "the server outlived its owner"
        time.sleep(0.05)


class Commands:
    """A live viewer's window that keeps what it is told, by path."""

    def __init__(self):
        self.transforms, self.properties, self.url = {}, {}, ""

    def send(self, command):
        data = command.lower()
        if data["type"] == "set_transform":
            self.transforms[data["path"]] = np.reshape(data["matrix"], (4, 4)).T
        elif data["type"] == "set_property":
            self.properties[data["path"], data["property"]] = data["value"]

    def close(self):
        pass


@pytest.fixture
def commands(monkeypatch):
    window = Commands()
    monkeypatch.setattr("pinfric.show.replay.live.ServerWindow", lambda: window)
    return window


def test_live_cylinder_reaches_from_link_to_link(commands):
    with LiveReplay(boom()) as live:
        for angle in (0.0, -0.4):
            live.show(np.array([angle]))
            place = commands.transforms["/meshcat/world/cylinder lift"]
            rod = commands.transforms["/meshcat/world/cylinder lift/rod"]
            np.testing.assert_allclose(place[:3, 3], [0.3, 0, 0], atol=1e-6)
            hinge = pin.SE3(pin.utils.rotate("y", angle), np.array([0, 0, 0.5]))
            end = (place @ rod @ [0, 0, 1, 1])[:3]
            np.testing.assert_allclose(end, hinge.act(np.array([0.7, 0, 0])), atol=1e-6)


def test_live_viewer_begins_with_closed_loops(commands):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    with LiveReplay(scene):
        pass
    data = scene.model.createData()
    pin.forwardKinematics(scene.model, data, scene.close(scene.start_configuration))
    for name in scene.joint_names:
        shown = commands.transforms[f"/meshcat/world/{name}"]
        expected = data.oMi[scene.model.getJointId(name)].homogeneous
        np.testing.assert_allclose(shown, expected, atol=1e-6)


def test_live_rings_show_that_loops_joints_stick_and_slide(commands):
    scene = pf.load_scene(ROBOTS / "four_bar.yaml")
    trajectory = pf.load_trajectory(ROBOTS / "four_bar.waypoints.yaml", scene)
    loop = scene.site_names.index("rocker_pin")
    with LiveReplay(scene) as live:
        for sample, state in ((0, "sticking"), (len(trajectory.t) // 4, "sliding")):
            live.show(trajectory.q[sample], trajectory.v[sample])
            assert live._states[loop] == state
