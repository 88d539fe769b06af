"""The replay as one HTML file: meshcat's viewer, its animation, the friction, and our controls.

It plays from a disk without a network. (Meshcat's own `static_html` needs its server, does not
compress, and sends the animation before the objects.)
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
from pinfric.model.brief import counted
from pinfric.model.described import effort_where
from pinfric.model.scene import Scene
from pinfric.show.replay import markers, stage
from pinfric.show.replay.stage import Stage
from pinfric.show.report.names import affixes, without
from pinfric.show.report.values import json_for_script
from pinfric.show.timeline.frames import Frames


class RecordingWindow:
    """Keeps the commands that a `meshcat.Visualizer(window=...)` sends, in msgpack.

    Attributes:
        commands: for `viewer.handle_command_bytearray` of meshcat's JavaScript.
    """

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep one command."""
        import umsgpack  # type: ignore[import-untyped]

        self.commands.append(umsgpack.packb(command.lower()))


def replay_html(scene: Scene, frames: Frames, title: str) -> str:
    """Return the page; `title` is its heading."""
    import meshcat

    window = RecordingWindow()
    viewed = meshcat.Visualizer(window=window)
    staged = stage.set_stage(viewed, scene, frames.placement)
    stage.animate(viewed, staged, frames)
    # equal shapes beside each other pack to a fraction; the animation needs all of them
    drawing = [*sorted(window.commands[:-1], key=len), window.commands[-1]]
    viewer = Path(meshcat.__file__).parent / "viewer/dist/main.min.js"
    # The frames as the script takes them: t in double precision, the rest in single
    balls = frames.slip[:, [site.ball for site in scene.sites]]
    tracks = frames.friction_lower, frames.friction_upper, frames.use, frames.force, balls
    arrays = [np.asarray(frames.t, dtype="<f8"), *(np.asarray(a, dtype="<f4") for a in tracks)]
    return _fill(
        _template("replay.html"),
        version=__version__,
        title=html.escape(title),
        heading=re.sub(r"([_/-]+)", r"\1<wbr>", html.escape(title)),  # may break there
        style=_template("replay.css"),
        meshcat=_packed(viewer.read_bytes()),
        data=json_for_script(_data(scene, frames, staged)),
        commands=_packed(b"".join(struct.pack("<I", len(c)) + c for c in drawing)),
        frames=_packed(b"".join(array.tobytes() for array in arrays)),
        script=_fill(_template("replay.js"), timeline=_template("replay_timeline.js")),
    )


def _data(scene: Scene, frames: Frames, staged: Stage) -> dict[str, Any]:
    rows = _rows(frames)
    names = [*scene.site_names, *(row["name"] for row in rows)]
    labels = without(names, *affixes(names))
    short = labels[: len(scene.sites)]
    for row, label in zip(rows, labels[len(scene.sites) :], strict=True):
        row["label"] = label
    return {
        "about": _about(scene, frames),
        "frames": len(frames.t),
        "sites": [
            {
                "name": site.name,
                "label": label,
                "path": path,
                "unit": effort_where(site.sliding),
                "sliding": site.sliding,
                "ball": site.ball,
                "turn": pin.Quaternion(marker.turn).coeffs(),
                "arc_radius": stage.ARC_REACH * marker.radius,
                "times": vars(times),
            }
            for site, label, path, marker, times in zip(
                scene.sites, short, staged.site_paths, staged.markers, frames.sites, strict=True
            )
        ],
        "rows": rows,
        "colors": markers.COLORS,
        "legend": _legend(scene, frames),
        "middle": staged.middle,
        "distance": staged.distance,
        "view": stage.VIEW,
        "size": staged.size,
        "arrow": stage.ARROW * staged.size,
        "head": {kind: length * staged.size for kind, length in stage.HEADS.items()},
        "arc": {"angle": markers.ARC, "segments": stage.SEGMENTS, "sides": stage.SIDES},
        "most": _most(scene, frames),
    }


def _rows(frames: Frames) -> list[dict[str, Any]]:
    """Return rows in time of what drives do: (colour, spans, words) each; later ones win."""
    rows = [
        ("⚙", name, "gear of", [(markers.GEAR_COLOR, spans, "holds by itself")])
        for name, spans in frames.gears.items()
    ]
    words = "differs from the log", "differs much from the log"
    for name, both in frames.off.items():
        parts = list(zip(markers.OFF_COLORS, both, words, strict=True))
        rows.append(("≠", name, "logged effort of", parts))
    near, over = markers.LIMIT_COLORS
    for name, kinds in frames.limiting.items():
        parts = [(near, spans, kind) for kind, (spans, _) in kinds.items()]
        parts += [(over, spans, f"{kind} exceeded") for kind, (_, spans) in kinds.items()]
        rows.append(("▲", name, "limits of", parts))
    return [{"mark": m, "name": name, "of": of, "parts": parts} for m, name, of, parts in rows]


def _legend(scene: Scene, frames: Frames) -> list[tuple[str, str, str]]:
    """Return (kind of mark or the mark itself, colour, meaning) of what the page shows."""
    meanings = markers.MEANINGS | (markers.SIMULATED if frames.simulated else {})
    entries = [
        ("ring" if state == "sliding" else "ring full", markers.COLORS[state], words)
        for state, words in meanings.items()
        if state in ("sliding", "sticking") or any(getattr(x, state) for x in frames.sites)
    ]
    at_rest = "with its share of the limit" if frames.simulated else "its limits in both directions"
    entries += [
        ("↻", "#46525f", f"friction of the parent on the child; at rest {at_rest}"),
        ("↑", markers.FORCE_COLOR, "force of the parent on the child"),
    ]
    entries = entries if scene.sites else [("", "", "no joint has friction")]
    stops = stage.tool_stops(scene, frames.placement)
    drives = any(a.cylinder or a.force for a in scene.actuators or ())
    springs = scene.twin().springs
    for there, mark, color, words in (
        (frames.gears, "⚙", markers.GEAR_COLOR, markers.GEAR_MEANING),
        (frames.off, "≠", markers.OFF_COLORS[1], markers.OFF_MEANING),
        (frames.limiting, "▲", markers.LIMIT_COLORS[0], markers.LIMIT_MEANING),
        (drives, "box", stage.DRIVE_COLOR, "cylinder or force that drives"),
        (springs and springs.lines, "box", stage.LINE_COLOR, "spring between links"),
        (len(stops), "●", stage.STOP_COLOR, f"where {scene.tool} stops"),
    ):
        if there:
            entries.append((mark, color, words))
    carried = [("box", markers.PAYLOAD_COLOR, f"{name}, while carried") for name in scene.payloads]
    return entries + carried


def _most(scene: Scene, frames: Frames) -> dict[str, float]:
    """Return the largest friction torque, friction force and reaction force, drawn longest."""
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


def _about(scene: Scene, frames: Frames) -> str:
    kind = "Simulated motion" if frames.simulated else "Inverse dynamics along a motion"
    joints = counted(len(scene.sites), "joint") if scene.sites else "no joint"
    gravity = np.array(scene.model.gravity.linear)
    turned = np.linalg.norm(gravity) > 0 and gravity[2] > -0.999 * np.linalg.norm(gravity)
    text = (
        f"{kind}, {frames.duration:.4g} s, friction in {joints}"
        f"{'; drawn with gravity downwards' if turned else ''}."
    )
    return f"{text} It ended early: {frames.ended}" if frames.ended else text


def _packed(content: bytes) -> str:
    return base64.b64encode(gzip.compress(content, mtime=0)).decode("ascii")


def _template(name: str) -> str:
    return (resources.files("pinfric.show.replay") / "templates" / name).read_text(encoding="utf-8")


def _fill(template: str, **parts: str) -> str:
    """Replace each {{name}} once; inserted text is not searched."""
    return re.sub(r"\{\{(\w+)\}\}", lambda name: parts[name[1]], template)
