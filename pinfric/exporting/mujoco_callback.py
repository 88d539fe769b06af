"""Callbacks of MuJoCo compiled from C++: the friction of `mujoco_bridge` in `mujoco.rollout`.

MuJoCo calls a control callback between positions and velocities and the solver, and user sensors
after it. The sensor's data keep what the next step needs, in each mjData.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import PinfricError
from pinfric.exporting.cpp import Bounds, cpp_files, template
from pinfric.model.scene import Scene

#: The sensor, and how many numbers it keeps for each joint (`Last` in the C++ text).
_SENSOR, _LAST = "pinfric_friction", 13
_COMPILERS = ("g++", "clang++", "c++")
_FLAGS = ("-std=c++17", "-O2", "-ffp-contract=off", "-shared", "-fPIC")


def with_memory(mujoco: Any, spec: Any, sizes: Mapping[str, int]) -> Any:
    """Return the compiled model of an MjSpec, with sensors in which friction keeps its data.

    Args:
        mujoco: the module. spec: gets the missing sensors.
        sizes: prefix of a scene's joints -> number of its drives.
    """
    kind, stage = mujoco.mjtSensor.mjSENS_USER, mujoco.mjtStage.mjSTAGE_ACC
    for prefix, joints in sizes.items():
        if spec.sensor(_SENSOR + prefix) is None:
            dim = 1 + _LAST * joints
            spec.add_sensor(name=_SENSOR + prefix, type=kind, needstage=stage, dim=dim)
    return spec.compile()


class Callback:
    """The compiled friction of scenes in one model.

    Args:
        mujoco: the module. scenes, model: see `MujocoFriction`.
        places: of each scene, (na,) each: joints of the model, rows of their bodies, armature of
            the links, M/(M + J), whether the joint counts; of the joints that follow a drive
            (n, 3) their joint, row, drive and (n, 2) ratio, armature.
        constants: of the law, by their names in the C++ text.

    Raises:
        PinfricError: no compiler, or it fails; the model has no sensor of the friction.
    """

    def __init__(
        self,
        mujoco: Any,
        scenes: Mapping[str, Scene],
        model: Any,
        places: Mapping[str, tuple[np.ndarray, ...]],
        constants: dict[str, float],
    ) -> None:
        self._mujoco, self._model, self._scenes = mujoco, model, list(scenes.values())
        self._places = [
            tuple(x.astype(float if x.dtype == float else np.int32) for x in of)
            for of in places.values()
        ]
        sizes = [(prefix, len(of[0])) for prefix, of in places.items()]
        self._memory = [_memory(mujoco, model, *size) for size in sizes]
        self._library = _compiled(mujoco, self._scenes, constants)

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Set the callbacks, and remove them at the end.

        Raises:
            PinfricError: actuation or sensors are disabled; else see `MujocoFriction.installed`.
        """
        mujoco, bits = self._mujoco, self._mujoco.mjtDisableBit
        for name in ("control", "sensor"):
            if getattr(mujoco, f"get_mjcb_{name}")() is not None:
                raise PinfricError(
                    f"mujoco_friction: another mjcb_{name} is set, and MuJoCo has one for all "
                    f"models; take it away first: mujoco.set_mjcb_{name}(None)"
                )
        for bit, name in ((bits.mjDSBL_ACTUATION, "actuation"), (bits.mjDSBL_SENSOR, "sensor")):
            if self._model.opt.disableflags & bit:
                raise PinfricError(
                    f"mujoco_friction: the model's flag {name} is disabled, so MuJoCo does not "
                    "call friction; enable it"
                )
        address = ctypes.c_void_p(self._model._address)
        for k, (of, memory) in enumerate(zip(self._places, self._memory, strict=True)):
            arrays = (a.ctypes.data_as(ctypes.c_void_p) for a in of)
            self._library[f"pinfric_set_{k}"](address, *arrays, len(of[-1]), memory)
        mujoco.set_mjcb_control(self._library.pinfric_control)
        mujoco.set_mjcb_sensor(self._library.pinfric_sensor)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(None)
            mujoco.set_mjcb_sensor(None)
        for k, scene in enumerate(self._scenes):
            failed = self._library[f"pinfric_failed_{k}"]()
            if failed == -2:
                raise PinfricError(
                    "mujoco_friction: the time step was changed while friction was installed, or "
                    "the integrator to RK4, or a flag that friction needs: make the friction anew "
                    "for another one"
                )
            if failed >= 0:
                raise jams(scene, failed, "in a step with the callback")


def jams(scene: Scene, drive: int, when: str) -> PinfricError:
    """Return the error of a gear that jams."""
    return PinfricError(
        f"{scene.source}: the self-locking gear of {scene.drives[drive].name!r} jams {when}: the "
        "rotor is too light for friction to determine the motion; give it more rotor_inertia"
    )


def _memory(mujoco: Any, model: Any, prefix: str, joints: int) -> int:
    s = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, _SENSOR + prefix)
    if s < 0 or model.sensor_dim[s] != 1 + _LAST * joints:
        raise PinfricError(
            f"mujoco_friction: the model has no sensor {_SENSOR + prefix!r}, in which the "
            "callback keeps its data: give mujoco_friction a mujoco.MjSpec, and use its attribute "
            "`model`"
        )
    return int(model.sensor_adr[s])


#: What MuJoCo calls, of all scenes one after the other.
_ALL = """#include <mujoco/mujoco.h>
extern "C" {{
{declared}
void pinfric_control(const mjModel* m, mjData* d) {{ {control} }}
void pinfric_sensor(const mjModel* m, mjData* d, int stage) {{ {sensor} }}
}}
"""


def _compiled(mujoco: Any, scenes: Sequence[Scene], constants: dict[str, float]) -> ctypes.CDLL:
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise PinfricError(
            f"mujoco_friction: the callback needs a C++ compiler ({', '.join(_COMPILERS)}); "
            "`step` needs none"
        )
    code = template("mujoco_callback.cpp")
    for name, value in {**constants, "LAST": _LAST}.items():
        code = code.replace(f"@@{name}", repr(value))
    indices = range(len(scenes))
    declared = "\n".join(
        f"void pinfric_control_{k}(const mjModel*, mjData*);\n"
        f"void pinfric_sensor_{k}(const mjModel*, mjData*, int);"
        for k in indices
    )
    control = " ".join(f"pinfric_control_{k}(m, d);" for k in indices)
    sensor = " ".join(f"pinfric_sensor_{k}(m, d, stage);" for k in indices)
    texts = {"all.cpp": _ALL.format(declared=declared, control=control, sensor=sensor)}
    for k, scene in enumerate(scenes):
        name, bounds = f"pinfric_scene_{k}", Bounds.none(len(scene.drives))
        texts[f"{name}.hpp"] = cpp_files(scene, (), bounds, [], ["in MuJoCo"], name).header
        texts[f"{name}.cpp"] = code.replace("pinfric_scene", name).replace("@@SCENE", str(k))
    home = Path(mujoco.__file__).parent
    engine = next(home.glob("libmujoco.*"), None)
    if engine is None:
        raise PinfricError(f"mujoco_friction: there is no libmujoco in {home}")
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        library = Path(folder) / "callback.so"
        sources = [str(Path(folder) / name) for name in texts if name.endswith(".cpp")]
        paths = f"-I{home / 'include'}", *sources, f"{engine}", f"-Wl,-rpath,{home}"
        command = [compiler, *_FLAGS, *paths, "-o", f"{library}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            said = [line for line in done.stderr.splitlines() if "error" in line] or [done.stderr]
            raise PinfricError(
                f"mujoco_friction: {compiler} cannot compile the callback for MuJoCo "
                f"{mujoco.__version__}: {said[0].strip()}"
            )
        return ctypes.CDLL(str(library))
