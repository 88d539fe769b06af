"""Watch a long simulation while it computes: the robot in a meshcat viewer, from a server of ours.

It looks on through the effort function, which every integrator calls with time and state:

>>> with pf.LiveReplay(scene) as live:
...     print(live.url)
...     pf.simulate(scene, q0, v0, t_end=60.0, **live.watch(effort))
"""

from __future__ import annotations

import atexit
import contextlib
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric.dynamics.forward.efforts import EffortLike, make_effort
from pinfric.dynamics.simulation.motion import Motion
from pinfric.dynamics.simulation.simulate import simulate
from pinfric.errors import PinfricError, PinfricWarning, SceneError
from pinfric.model.scene import Scene
from pinfric.show.replay import markers
from pinfric.show.replay.frames import site_rates
from pinfric.show.replay.replay import open_page
from pinfric.show.replay.stage import Stage, look_from_the_front, set_stage, stretch_cylinder
from pinfric.study.scene_run import start_state

#: Meshcat's server, which ends with us however we end: then its standard input closes. Its pages
#: are for this machine; by itself it serves them to every network (its commands it does not).
_SERVER = """
import os, sys, threading
def watch():
    sys.stdin.read()
    os._exit(0)
threading.Thread(target=watch, daemon=True).start()
import tornado.web
listen = tornado.web.Application.listen
def listen_here(application, port, address=None, **options):
    return listen(application, port, "127.0.0.1", **options)
tornado.web.Application.listen = listen_here
from meshcat.servers.zmqserver import main
sys.argv = ["meshcat-server"]
main()
"""
#: A server that does not answer for so long (s) is given up.
PATIENCE = 10.0


class ServerWindow:
    """A meshcat window on a server process that we start and that we end.

    Ports in use are passed over: the server takes the next ones, from 6000 (commands) and 7000
    (pages) on. A server that goes away does not stop the simulation: one warning, then silence.

    Attributes:
        url: where a browser shows it.
        sent: number of commands so far.

    Raises:
        PinfricError: the server does not start.
    """

    def __init__(self) -> None:
        import zmq

        self.sent, self._given_up = 0, False
        self._process = subprocess.Popen(
            [sys.executable, "-u", "-c", _SERVER],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
            start_new_session=True,  # Ctrl-C is for the simulation; it ends the server itself
        )  # fmt: skip
        atexit.register(self.close)
        commands, self.url = self._addresses()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVTIMEO, int(1000 * PATIENCE))
        self._socket.setsockopt(zmq.SNDTIMEO, int(1000 * PATIENCE))
        self._socket.connect(commands)

    def _addresses(self) -> tuple[str, str]:
        found: dict[str, str] = {}
        assert self._process.stdout is not None
        for line in self._process.stdout:
            name, _, value = line.strip().partition("=")
            found[name] = value
            if {"zmq_url", "web_url"} <= found.keys():
                return found["zmq_url"], found["web_url"]
        code = self._process.wait()
        raise PinfricError(f"live replay: meshcat's server ended at its start (exit code {code})")

    @property
    def alive(self) -> bool:
        """Whether the server still answers."""
        return self._process.poll() is None

    def send(self, command: Any) -> None:
        """Send one command; nothing happens once the server has gone."""
        import umsgpack  # type: ignore[import-untyped]
        import zmq

        self.sent += 1
        if self._given_up:
            return
        if not self.alive:
            self._give_up("it has ended")
            return
        data = command.lower()
        try:
            self._socket.send_multipart(
                [data["type"].encode(), data["path"].encode(), umsgpack.packb(data)]
            )
            self._socket.recv()
        except zmq.ZMQError as problem:
            self._give_up(str(problem))

    def _give_up(self, why: str) -> None:
        self.close()
        warnings.warn(
            f"live replay: the viewer's server does not answer ({why}); going on without",
            PinfricWarning,
            stacklevel=4,
        )

    def close(self) -> None:
        """End the server."""
        self._given_up = True
        atexit.unregister(self.close)
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(2.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        with contextlib.suppress(AttributeError):  # it ended before there was a socket
            self._socket.close()
            self._context.term()


class LiveReplay:
    """The robot of a scene, shown where a running simulation has got to.

    Call it with every accepted step; it shows at most `rate` of them per second and costs the
    simulation nothing for the others. Rings at the joints show what slides and what sticks.

    Args:
        scene: the robot.
        open_browser: show it at once; without a display or browser, `url` says where it is.
        rate: most frames per second of real time.
        pace: None shows steps as they come; a number holds the simulation back to so many
            simulated seconds per second.

    Raises:
        PinfricError: the server does not start.
    """

    def __init__(
        self, scene: Scene, open_browser: bool = False, rate: float = 30.0,
        pace: float | None = None,
    ) -> None:  # fmt: skip
        import meshcat

        self._scene, self._rate, self._pace = scene, rate, pace
        self._window = ServerWindow()
        try:
            self._viewer = meshcat.Visualizer(window=self._window)
            self._data = scene.model.createData()
            start = self._placements(_start(scene))
            self._stage: Stage = set_stage(self._viewer, scene, start[None])
            look_from_the_front(self._viewer, self._stage)
            for path in self._stage.site_paths:
                for part in ("arc_plus", "arc_minus", "force"):
                    self._viewer[path][part].set_property("visible", False)
        except BaseException:
            self.close()
            raise
        self._shown, self._begun = -np.inf, (0.0, 0.0)
        self._states = ["sliding"] * len(scene.sites)
        self.frames = 0
        self.opened = open_browser and open_page(self.url)

    @property
    def url(self) -> str:
        """Where a browser shows it."""
        return self._window.url

    def __call__(
        self, t: float, q: np.ndarray, v: np.ndarray | None = None, modes: np.ndarray | None = None
    ) -> None:
        """Show one state, unless the last one was shown too short a time ago.

        Args:
            t: simulated time, s.
            q: (nq,) configuration.
            v: (nv,) velocities: where a site is slower than its stick velocity, it sticks.
            modes: (ns,) -1, 0, 1 per site, 0 where it sticks; goes before v. Without either the
                rings stay as they are.
        """
        now = time.monotonic()
        if self.frames == 0:
            self._begun = now, t
        if now - self._shown < 1.0 / self._rate and self._pace is None:
            return
        if self._pace is not None:
            ahead = (t - self._begun[1]) / self._pace - (now - self._begun[0])
            if ahead < 0 and now - self._shown < 1.0 / self._rate:
                return
            time.sleep(max(ahead, 0.0))
        self.show(q, v, modes)

    def watch(
        self,
        effort: EffortLike = None,
        breakpoints: Sequence[float] | None = None,
        motor_torque: EffortLike = None,
    ) -> dict[str, Any]:
        """Return the `effort` or `motor_torque` of a simulation that is shown while it runs.

        Args:
            effort, breakpoints, motor_torque: as `simulate` takes them; None: the scene's own.

        Raises:
            SimulationError: an unknown drive, a wrong shape, a value not finite.
        """
        made = make_effort(self._scene, effort, breakpoints, motor_torque)

        def effort_shown(t: float, q: np.ndarray, v: np.ndarray) -> Any:
            self(t, q, v)
            return made.function(t, q, v)

        return {made.given: replace(made, function=effort_shown)}

    def show(
        self, q: np.ndarray, v: np.ndarray | None = None, modes: np.ndarray | None = None
    ) -> None:
        """Show one state now; see `__call__`."""
        q = np.asarray(q, dtype=float)
        if modes is None and v is not None:
            rates = site_rates(self._scene, q[None], np.asarray(v, dtype=float)[None])[0]
            modes = np.linalg.norm(rates, axis=1) > self._scene.site_tables.laws.stick_velocity
        places = self._placements(q)
        for path, place in zip(self._stage.joint_paths, places, strict=True):
            self._viewer[path].set_transform(pin.XYZQUATToSE3(place).homogeneous)
        for cylinder in self._stage.cylinders:
            stretch_cylinder(self._viewer, cylinder, places)
        if modes is not None:
            for s, mode in enumerate(np.asarray(modes)):
                self._mark(s, "sticking" if mode == 0 else "sliding")
        self.frames += 1
        self._shown = time.monotonic()

    def close(self) -> None:
        """End the viewer's server; an open page stays as it is."""
        self._window.close()

    def __enter__(self) -> LiveReplay:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _mark(self, s: int, state: str) -> None:
        if state == self._states[s]:
            return
        self._states[s] = state
        color = [int(markers.COLORS[state][i : i + 2], 16) / 255 for i in (1, 3, 5)]
        node, event = self._viewer[self._stage.site_paths[s]], state != "sliding"
        for part, opacity in (("ring", 1.0), ("ghost", 0.8 if event else 0.35), ("disc", 0.45)):
            node[part].set_property("color", [*color, opacity])
        node["disc"].set_property("visible", event)

    def _placements(self, q: np.ndarray) -> np.ndarray:
        """(nj, 7) of the joints in the world."""
        pin.forwardKinematics(self._scene.model, self._data, q)
        places = [pin.SE3ToXYZQUAT(place) for place in list(self._data.oMi)[1:]]
        return np.array(places).reshape(-1, 7)


def _start(scene: Scene) -> np.ndarray:
    """(nq,) what is shown first: where the scene starts, its loops closed if they can be."""
    start = scene.start_configuration
    try:
        return scene.close(start)
    except PinfricError:
        return start


def simulate_live(
    scene: Scene, say: Callable[[str], object], *, t_end: float | None = None,
    open_browser: bool = False, pace: float | None = 1.0, **options: Any,
) -> Motion:  # fmt: skip
    """Simulate a scene as its own `simulation` section says, shown while it computes.

    Args:
        scene: with a `simulation` section.
        say: called with a line that says where a browser shows it.
        t_end: s; None takes the scene's.
        open_browser: show it at once.
        pace: at most so many simulated seconds per second; None as fast as it computes.
        options: as `simulate` takes them (method, rtol, dt, ...).

    Raises:
        SceneError: there is no such section; PinfricError: the server does not start; and what
            `simulate` raises.
    """
    if scene.simulation is None:
        raise SceneError(f"{scene.source}: has no `simulation` section to show; give it effort and "
                         "t_end, or name a motion")  # fmt: skip
    q0, v0 = start_state(scene)
    with LiveReplay(scene, open_browser, pace=pace) as live:
        where = "is open in a browser" if live.opened else "waits for a browser"
        say(f"{live.url} {where}; it shows the simulation while it runs")
        end = t_end or scene.simulation.t_end
        return simulate(scene, q0, v0, t_end=end, **live.watch(), **options)
