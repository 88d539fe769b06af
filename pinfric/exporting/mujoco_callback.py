"""Callbacks of MuJoCo compiled from C++: the friction of `mujoco_bridge` in `mujoco.rollout`.

MuJoCo calls a control callback after positions and velocities are known and before it solves, and
user sensors after it has solved. The sensor's data keep what the next step needs, in each mjData.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
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


def with_memory(mujoco: Any, spec: Any, joints: int) -> Any:
    """Return the compiled model of an MjSpec, with the sensor in which the friction keeps its data.

    Args:
        mujoco: the module. spec: changed where the sensor is missing. joints: how many.
    """
    if spec.sensor(_SENSOR) is None:
        kind, stage = mujoco.mjtSensor.mjSENS_USER, mujoco.mjtStage.mjSTAGE_ACC
        spec.add_sensor(name=_SENSOR, type=kind, needstage=stage, dim=1 + _LAST * joints)
    return spec.compile()


class Callback:
    """The compiled friction of one scene in one model.

    Args:
        mujoco: the module. scene, model: see `mujoco_friction`.
        places: (nv,) each: joints of the model, armature of the links, M/(M + J).
        constants: of the law, by their names in the C++ text.

    Raises:
        PinfricError: no compiler, or it fails; the model has no sensor of the friction.
    """

    def __init__(
        self,
        mujoco: Any,
        scene: Scene,
        model: Any,
        places: tuple[np.ndarray, np.ndarray, np.ndarray],
        constants: dict[str, float],
    ) -> None:
        self._mujoco, self._scene, self._model = mujoco, scene, model
        joints, own, share = places
        self._joints, self._own, self._share = joints.astype(np.int32), own, share
        self._memory = _memory(mujoco, model, len(joints))
        self._library = _compiled(mujoco, scene, constants)

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Set the callbacks, and take them away at the end.

        Raises:
            PinfricError: another callback is set; actuation or sensors are disabled; at the end:
                a gear jammed, or the time step was changed.
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
        self._library.pinfric_set(
            ctypes.c_void_p(self._model._address),
            *(a.ctypes.data_as(ctypes.c_void_p) for a in (self._joints, self._own, self._share)),
            self._memory,
        )
        mujoco.set_mjcb_control(self._library.pinfric_control)
        mujoco.set_mjcb_sensor(self._library.pinfric_sensor)
        try:
            yield
        finally:
            mujoco.set_mjcb_control(None)
            mujoco.set_mjcb_sensor(None)
        failed = self._library.pinfric_failed()
        if failed == -2:
            raise PinfricError(
                "mujoco_friction: the time step was changed while friction was installed: make "
                "the friction anew for another one"
            )
        if failed >= 0:
            raise jams(self._scene, failed, "in a step with the callback")


def jams(scene: Scene, drive: int, when: str) -> PinfricError:
    """Return the error of a gear that jams."""
    return PinfricError(
        f"{scene.source}: the self-locking gear of {scene.drives[drive].name!r} jams {when}: the "
        "rotor is too light for friction to determine the motion; give it more rotor_inertia"
    )


def _memory(mujoco: Any, model: Any, joints: int) -> int:
    """Where the sensor's data begin."""
    s = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SENSOR, _SENSOR)
    if s < 0 or model.sensor_dim[s] != 1 + _LAST * joints:
        raise PinfricError(
            f"mujoco_friction: the model has no sensor {_SENSOR!r}, in which the callback keeps "
            "its data: give mujoco_friction a mujoco.MjSpec, and use its attribute `model`"
        )
    return int(model.sensor_adr[s])


def _compiled(mujoco: Any, scene: Scene, constants: dict[str, float]) -> ctypes.CDLL:
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise PinfricError(
            f"mujoco_friction: the callback needs a C++ compiler ({', '.join(_COMPILERS)}); "
            "`step` needs none"
        )
    bounds = Bounds.none(len(scene.drives))
    header = cpp_files(scene, (), bounds, [], ["friction in MuJoCo"], "pinfric_scene").header
    code = template("mujoco_callback.cpp")
    for name, value in {**constants, "LAST": _LAST}.items():
        code = code.replace(f"@@{name}", repr(value))
    home = Path(mujoco.__file__).parent
    engine = next(home.glob("libmujoco.*"), None)
    if engine is None:
        raise PinfricError(f"mujoco_friction: there is no libmujoco in {home}")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "pinfric_scene.hpp").write_text(header, encoding="utf-8")
        (source := Path(folder) / "callback.cpp").write_text(code, encoding="utf-8")
        made = Path(folder) / "callback.so"
        paths = f"-I{home / 'include'}", f"{source}", f"{engine}", f"-Wl,-rpath,{home}"
        command = [compiler, *_FLAGS, *paths, "-o", f"{made}"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            said = [line for line in done.stderr.splitlines() if "error" in line] or [done.stderr]
            raise PinfricError(
                f"mujoco_friction: {compiler} cannot compile the callback for MuJoCo "
                f"{mujoco.__version__}: {said[0].strip()}"
            )
        return ctypes.CDLL(str(made))
