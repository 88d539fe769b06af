"""Replay of a motion: the robot in 3D with a marker at every joint that sticks or slides."""

from __future__ import annotations

import html as html_escaping
import os
import sys
import tempfile
from pathlib import Path

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult, StickInterval
from pinfric.dynamics.simulation.motion import Motion
from pinfric.errors import StateError
from pinfric.model.described import described, quantity
from pinfric.model.files import write_file
from pinfric.model.scene import Scene, expect_scene
from pinfric.motions.log.judged import JudgedLog
from pinfric.motions.trajectory import Trajectory
from pinfric.retiming.limits import LimitsLike
from pinfric.show.replay.page import replay_html
from pinfric.show.timeline.frames import RATE, make_frames
from pinfric.show.timeline.motion import check_same_scene, with_drives


@described
class Replay:
    """A replay as a page that needs no network; a notebook shows it by itself.

    Attributes:
        page: the HTML.
    """

    page: str
    html: Path | None = quantity("the page; none: none was written")
    duration: float = quantity("of the motion", "s")
    frames: int = quantity("that are drawn")
    stick_intervals: tuple[StickInterval, ...] = quantity("that are marked")

    def save(self, path: str | Path) -> Path:
        """Write the page to a file.

        Raises:
            PinfricError: the file cannot be written.
        """
        return write_file(path, self.page)

    def open(self) -> bool:
        """Show the page (`open_page`)."""
        return self.html is not None and open_page(self.html)

    def __repr__(self) -> str:
        where = f" in {self.html}" if self.html else ""
        return f"<replay of {self.duration:.4g} s, {self.frames} frames{where}>"

    def _repr_html_(self) -> str:
        page = html_escaping.escape(self.page)
        return (
            f'<iframe srcdoc="{page}" style="width: 100%; height: 600px; border: 1px solid '
            '#dfe4ea; border-radius: 6px"></iframe>'
        )


def replay(
    scene: Scene,
    motion: InverseResult | Motion | Trajectory,
    html: str | Path | None = None,
    open_browser: bool = False,
    *,
    title: str | None = None,
    rate: float = RATE,
    log: JudgedLog | None = None,
    limits: LimitsLike = None,
) -> Replay:
    """Return a page that plays a motion: robot, joints that stick or slide, forces, intervals.

    At each friction site a ring shows by its colour whether the joint slides, sticks, is about to
    break away, reverses, or is jammed; arcs show its friction (at rest its limits), arrows the
    force of the parent on the child.

    Args:
        scene: the robot the motion is of.
        motion: a result of `inverse_dynamics` with times, a simulated motion, or a trajectory,
            whose inverse dynamics is computed.
        html: file to write; None writes none, unless a browser needs one.
        open_browser: show it at once; without a display `html` of the result says where it is.
        title: heading; None takes the scene's name.
        rate: frames per second; samples at which sticking begins or ends are always frames.
        log: of the motion; where its efforts differ from the computed ones is marked.
        limits: of the drives, as `retime` takes them; the one that limits the motion is marked.

    Raises:
        StateError: the motion has no times, or is of another scene; limits of a simulated motion.
        RetimeError: impossible limits.
        PinfricError: the file cannot be written.
    """
    expect_scene(scene, "replay")
    if isinstance(motion, Trajectory):
        motion = inverse_dynamics(scene, motion)
    if not isinstance(motion, InverseResult | Motion):
        raise StateError(
            f"replay: the motion is a {type(motion).__name__}; give a trajectory, or a result of "
            "pf.inverse_dynamics or pf.simulate"
        )
    check_same_scene(scene, motion)
    drive_limits = None
    if limits is not None:
        scene, motion, drive_limits = with_drives(scene, motion, limits)
    frames = make_frames(scene, motion, rate, log, drive_limits)
    page = replay_html(scene, frames, title or Path(scene.source).stem)
    if html is None and open_browser:
        html = Path(tempfile.mkdtemp(prefix="pinfric-")) / "replay.html"
    file = None if html is None else Path(html)
    done = Replay(page, file, frames.duration, len(frames.t), frames.stick_intervals)
    if done.html is not None:
        done.save(done.html)
        if open_browser:
            done.open()
    return done


def replay_lines(shown: Replay, opened: bool | None) -> list[str]:
    """Return the lines that `pinfric replay` prints.

    Args:
        shown: the replay.
        opened: whether a browser shows it; None: not asked for.
    """
    sticks = len(shown.stick_intervals)
    intervals = "no stiction" if sticks == 0 else f"{sticks} stiction interval{'s' * (sticks > 1)}"
    lines = [f"{shown.duration:.4g} s, {shown.frames} frames, {intervals}: {shown.html}"]
    if opened is False:
        lines.append("no display or no browser here: open the file on another machine")
    return lines


def open_page(page: str | Path) -> bool:
    """Show a file or an address in a browser; return False without one or without a display."""
    import webbrowser

    graphical = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in graphical):
        return False  # webbrowser would start a text browser in the terminal
    address = page if isinstance(page, str) and "://" in page else Path(page).absolute().as_uri()
    try:
        return webbrowser.open(str(address))
    except webbrowser.Error:
        return False
