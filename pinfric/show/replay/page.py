"""The replay as one HTML file: meshcat's viewer, what it draws, the frames, and our controls.

Nothing is fetched: the file plays from a disk without a network. The drawing commands and the
frames are compressed; every browser since 2023 unpacks them by itself.
"""

from __future__ import annotations

import base64
import gzip
import html
import re
import struct
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pinfric import __version__
from pinfric.model.scene import Scene
from pinfric.show.replay import markers, stage, surfaces
from pinfric.show.replay.stage import Stage
from pinfric.show.report.values import json_for_script
from pinfric.study.timeline.frames import Frames


class RecordingWindow:
    """Keep the commands that a `meshcat.Visualizer(window=...)` sends, in msgpack.

    Attributes:
        commands: as `viewer.handle_command_bytearray` of meshcat's JavaScript takes them.
    """

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep one command."""
        import umsgpack  # type: ignore[import-untyped]

        self.commands.append(umsgpack.packb(command.lower()))


def replay_html(scene: Scene, frames: Frames, title: str) -> str:
    """Return the page.

    Args:
        scene: the robot.
        frames: its motion.
        title: heading of the page and its window.
    """
    import meshcat

    window = RecordingWindow()
    viewed = meshcat.Visualizer(window=window)
    staged = stage.set_stage(viewed, scene, frames.placement, frames.gears)
    viewer = Path(meshcat.__file__).parent / "viewer/dist/main.min.js"
    return _fill(
        _template("replay.html"),
        version=__version__,
        title=html.escape(title),
        heading=re.sub(r"([_/-]+)", r"\1<wbr>", html.escape(title)),  # may break there
        style=_template("replay.css"),
        meshcat=_in_script(viewer.read_text(encoding="utf-8")),
        data=json_for_script(_data(scene, frames, staged)),
        commands=_packed(b"".join(struct.pack("<I", len(c)) + c for c in window.commands)),
        frames=_packed(_arrays(scene, frames)),
        script=_in_script(_fill(_template("replay.js"), timeline=_template("replay_timeline.js"))),
    )


def _data(scene: Scene, frames: Frames, staged: Stage) -> dict[str, Any]:
    """What the page's script reads, apart from the frames."""
    sites = [
        {
            "name": site.name,
            "path": path,
            "sliding": site.sliding,
            "ball": site.ball,
            "turn": pin.Quaternion(marker.turn).coeffs(),
            "arc_radius": stage.ARC_REACH * marker.radius,
            "times": {
                "sticking": times.sticking,
                "near": times.near,
                "reversal": times.reversal,
                "jammed": times.jammed,
            },
        }
        for site, path, marker, times in zip(
            scene.sites, staged.site_paths, staged.markers, frames.sites, strict=True
        )
    ]
    return _drives(frames, staged) | {
        "simulated": frames.simulated,
        "about": _about(scene, frames),
        "frames": len(frames.t),
        "joints": staged.joint_paths,
        "sites": sites,
        "payloads": [
            {"name": name, "path": path, "spans": frames.carried[name]}
            for name, path in staged.payload_paths.items()
        ],
        "cylinders": [
            {"path": c.path, "a": [c.a[0] - 1, c.a[1]], "b": [c.b[0] - 1, c.b[1]]}
            for c in staged.cylinders
        ],
        "barrel": stage.BARREL,
        "colors": markers.COLORS,
        "meanings": markers.MEANINGS | (markers.SIMULATED if frames.simulated else {}),
        "force_color": markers.FORCE_COLOR,
        "payload_color": markers.PAYLOAD_COLOR,
        "drive_color": stage.DRIVE_COLOR,
        "drives": bool(staged.cylinders) or any(a.force for a in scene.actuators or ()),
        "points": _hull(staged.points),
        "floor": staged.floor,
        "size": staged.size,
        "arrow": stage.ARROW * staged.size,
        "head": {kind: length * staged.size for kind, length in stage.HEADS.items()},
        "arc": {"angle": markers.ARC, "segments": surfaces.SEGMENTS, "sides": surfaces.SIDES},
        "most": _most(scene, frames),
    }


def _drives(frames: Frames, staged: Stage) -> dict[str, Any]:
    """What gears hold by themselves, logged efforts that miss the computed ones, limits."""
    return {
        "gears": [
            {"name": name, "path": staged.gear_paths.get(name, ""), "spans": spans}
            for name, spans in frames.gears.items()
        ],
        "strips": _strips(frames),
        "gear_color": markers.GEAR_COLOR,
        "gear_meaning": markers.GEAR_MEANING,
        "strip_meanings": [
            (mark, colors[1], meaning)
            for mark, colors, meaning, there in (
                ("≠", markers.OFF_COLORS, markers.OFF_MEANING, frames.off),
                ("▲", markers.LIMIT_COLORS[::-1], markers.LIMIT_MEANING, frames.limiting),
            )
            if there
        ],
    }


def _strips(frames: Frames) -> list[dict[str, Any]]:
    """Rows in time of what drives do: [colour, spans, words] each, of which later ones win."""
    off = [
        (
            "≠",
            name,
            "logged effort of",
            [
                (markers.OFF_COLORS[0], mild, "off the log"),
                (markers.OFF_COLORS[1], strong, "far off the log"),
            ],
        )
        for name, (mild, strong) in frames.off.items()
    ]
    near, over = markers.LIMIT_COLORS
    limiting = [
        (
            "▲",
            name,
            "limits of",
            [
                *((near, spans, kind) for kind, (spans, _) in kinds.items()),
                *((over, spans, f"{kind} exceeded") for kind, (_, spans) in kinds.items()),
            ],
        )
        for name, kinds in frames.limiting.items()
    ]
    return [
        {"mark": mark, "name": name, "of": of, "parts": parts}
        for mark, name, of, parts in off + limiting
    ]


def _most(scene: Scene, frames: Frames) -> dict[str, float]:
    """The largest friction torque, friction force and reaction force: what is drawn longest."""
    sliding = np.array([site.sliding for site in scene.sites], dtype=bool)
    friction = np.maximum(np.abs(frames.friction_lower), np.abs(frames.friction_upper))

    def largest(array: np.ndarray) -> float:
        finite = array[np.isfinite(array)]
        return float(finite.max()) if finite.size and finite.max() > 0 else 1.0

    return {
        "turn": largest(friction[:, ~sliding]),
        "push": largest(friction[:, sliding]),
        "force": largest(np.linalg.norm(frames.force, axis=-1)),
    }


def _hull(points: np.ndarray) -> np.ndarray:
    """The points that can limit a view: the farthest in many directions, to 4 digits."""
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    height = np.linspace(-1.0, 1.0, 9)[:, None]
    reach = np.sqrt(1.0 - height**2)
    directions = np.stack(
        (reach * np.cos(angle), reach * np.sin(angle), np.broadcast_to(height, (9, 24))), axis=-1
    ).reshape(-1, 3)
    farthest = np.unique(np.argmax(directions @ points.T, axis=1))
    return np.round(points[farthest], 4)


def _about(scene: Scene, frames: Frames) -> str:
    """One line below the title."""
    kind = "Simulated motion" if frames.simulated else "Inverse dynamics along a motion"
    count = len(scene.sites)
    joints = "no joint" if count == 0 else "1 joint" if count == 1 else f"{count} joints"
    gravity = np.array(scene.model.gravity.linear)
    turned = np.linalg.norm(gravity) > 0 and gravity[2] > -0.999 * np.linalg.norm(gravity)
    text = (
        f"{kind}, {frames.duration:.4g} s, friction in {joints}"
        f"{'; drawn with gravity downwards' if turned else ''}."
    )
    return f"{text} It ended early: {frames.ended}" if frames.ended else text


def _arrays(scene: Scene, frames: Frames) -> bytes:
    """The frames as the script takes them: t in double precision, the rest in single."""
    balls = frames.slip[:, [site.ball for site in scene.sites]]
    rest = (
        frames.placement,
        frames.friction_lower,
        frames.friction_upper,
        frames.use,
        frames.force,
        balls,
    )
    t = np.ascontiguousarray(frames.t, dtype="<f8")
    return b"".join([t.tobytes(), *(np.asarray(a, dtype="<f4").tobytes() for a in rest)])


def _packed(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, 6, mtime=0)).decode("ascii")


def _template(name: str) -> str:
    return (resources.files("pinfric.show.replay") / "templates" / name).read_text(encoding="utf-8")


def _in_script(text: str) -> str:
    """Text that cannot end the <script> it stands in."""
    return text.replace("</script", "<\\/script")


def _fill(template: str, **parts: str) -> str:
    """Replace each {{name}}; what is put in is not looked at again."""
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)
