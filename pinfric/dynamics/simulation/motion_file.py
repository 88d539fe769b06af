"""Read a motion from its file; refuse damaged files and motions of other scenes."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, FiniteFloat

from pinfric.dynamics.simulation.motion import ARRAYS, FORMAT, Event, Motion, scene_digests
from pinfric.errors import SimulationError, problems_line
from pinfric.model.entry import Entry, parse
from pinfric.model.magnitudes import impossible
from pinfric.model.scene import Scene, expect_scene
from pinfric.model.yamlfile import bounded, brief, brief_path

#: Bytes of a motion and of its arrays, 1 GiB.
_LARGEST = 2**30


class _About(Entry):
    """The contents of the file beside the arrays."""

    format: int
    method: Literal["event", "timestepping", "regularized"]
    status: Literal["finished", "interrupted", "failed"]
    message: str
    evaluations: Annotated[int, Field(ge=0)]
    scene: dict[str, str]
    source: str
    carried: tuple[str, ...] | None
    unproved: tuple[FiniteFloat, ...] = ()
    events: tuple[
        tuple[FiniteFloat, str, Literal["stick", "slip", "reversal", "limit"], Literal[-1, 0, 1]],
        ...,
    ]


def load_motion(path: str | Path, scene: Scene) -> Motion:
    """Read a motion that `Motion.save` wrote; its `sample` is refused.

    Args:
        path: the npz file.
        scene: the scene it was simulated with.

    Raises:
        SimulationError: the file cannot be read, is damaged, or is of another scene (says which
            parts differ).
    """
    expect_scene(scene, "load_motion")
    where = brief_path(path)
    content, arrays = _contents(Path(path), where)
    if isinstance(content, dict) and content.get("format", FORMAT) != FORMAT:
        found = brief(content["format"])
        raise SimulationError(f"{where}: format {found}; this pinfric reads {FORMAT}")
    what = f"{where}: is not a motion that pinfric saved"
    about = parse(_About, content, what, SimulationError)
    digests = scene_digests(scene, "motor_torque" if "motor_torque" in arrays else "effort")
    differ = [name for name, digest in digests.items() if about.scene.get(name) != digest]
    if differ:
        raise SimulationError(
            f"{where}: was simulated with another scene ({about.source}); {scene.source} differs "
            f"in {', '.join(differ)}"
        )
    problems = _problems(scene, about, arrays)
    if problems:
        raise SimulationError(problems_line(f"{where}: is not a motion of this scene", problems))
    return Motion(
        scene=scene,
        method=about.method,
        events=tuple(Event(*entry) for entry in about.events),
        status=about.status,
        message=about.message,
        evaluations=about.evaluations,
        carried=about.carried,
        unproved=about.unproved,
        **arrays,
    )


def _contents(path: Path, where: str) -> tuple[Any, dict[str, Any]]:
    try:
        content = bounded(path, SimulationError, _LARGEST)
    except OSError as problem:
        raise SimulationError(
            f"{where}: is not a motion that can be read: {problem.strerror or problem}"
        ) from None
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as parts:
            if sum(member.file_size for member in parts.infolist()) > _LARGEST:
                raise ValueError(f"more than {_LARGEST / 2**20:.0f} MiB")
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            wanted = [*ARRAYS, *(["motor_torque"] if "motor_torque" in file else [])]
            return about, {name: file[name] for name in wanted}
    except Exception as problem:  # zipfile, zlib, struct and numpy have a dozen for damaged files
        reason = brief(" ".join(f"{type(problem).__name__}: {problem}".split()))
        raise SimulationError(
            f"{where}: is not a motion that pinfric saved, or damaged ({reason}); simulate it again"
        ) from None


def _problems(scene: Scene, about: _About, arrays: dict[str, Any]) -> list[str]:
    """Shapes, values and names in the file that do not fit the scene."""
    model, sites = scene.model, len(scene.sites)
    samples, phases = len(np.atleast_1d(arrays["t"])), len(np.atleast_1d(arrays["phase_modes"]))
    widths = {
        "q": model.nq,
        "v": model.nv,
        "a": model.nv,
        "effort": len(scene.drives),
        "motor_torque": len(scene.drives),
    }
    shapes: dict[str, tuple[int, ...]] = {
        name: (samples, widths.get(name, sites)) for name in arrays
    }
    shapes |= {"t": (samples,), "phase_t": (phases + 1,), "phase_modes": (phases, sites)}
    problems = [
        f"{name} has shape {arrays[name].shape}; should be {shape}"
        for name, shape in shapes.items()
        if arrays[name].shape != shape
    ]
    problems += [
        f"{name} holds no real numbers ({array.dtype})"
        for name, array in arrays.items()
        if array.dtype.kind not in "fi"
    ]
    if problems:
        return problems
    if samples == 0 or phases == 0:
        return ["it has no samples"]
    problems += [
        f"{name} is not finite, or beyond any machine"
        for name, array in arrays.items()
        if impossible(array).any()
    ]
    problems += [
        f"{name} holds other modes than -1, 0, 1"
        for name in ("modes", "phase_modes")
        if not np.isin(arrays[name], (-1, 0, 1)).all()
    ]
    if (np.diff(arrays["t"]) <= 0).any() or (np.diff(arrays["phase_t"]) < 0).any():
        problems.append("its times do not increase")
    problems += [
        f"there is no payload {brief(name)}"
        for name in about.carried or ()
        if name not in scene.payloads
    ]
    named = {*scene.site_names, *scene.joint_names, *scene.actuator_names}
    problems += [
        f"an event names {brief(event[1])}, which is not there"
        for event in about.events
        if event[1] not in named
    ]
    return problems
