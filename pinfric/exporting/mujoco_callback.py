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
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from pinfric.errors import PinfricError
from pinfric.exporting.cpp import Bounds, cpp_files, template
from pinfric.model.scene import Scene

#: The sensor, and how many numbers it keeps for each joint (`Last` in the C++ text).
_SENSOR, _LAST = "pinfric_friction", 13
#: A custom number of a model: which friction is in it, so that alike robots are told apart.
_MARK, _marks = "pinfric_friction", count(1)
_COMPILERS = ("g++", "clang++", "c++")
_FLAGS = ("-std=c++17", "-O2", "-ffp-contract=off", "-shared", "-fPIC")


def with_memory(mujoco: Any, spec: Any, sizes: Mapping[str, int]) -> Any:
    """Return the compiled model of an MjSpec, with sensors in which friction keeps its data.

    Args:
        mujoco: the module. spec: is not changed.
        sizes: prefix of a scene's joints -> number of its drives.
    """
    kind, stage, spec = mujoco.mjtSensor.mjSENS_USER, mujoco.mjtStage.mjSTAGE_ACC, spec.copy()
    for prefix, joints in sizes.items():
        if spec.sensor(_SENSOR + prefix) is None:
            dim = 1 + _LAST * joints
            spec.add_sensor(name=_SENSOR + prefix, type=kind, needstage=stage, dim=dim)
    if spec.numeric(_MARK) is None:
        spec.add_numeric(name=_MARK, data=[0.0])
    return spec.compile()


def mark(mujoco: Any, model: Any) -> float:
    """Mark a model as that of one friction, and return the mark; 0: it has no place for it."""
    k = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, _MARK)
    if k < 0:
        return 0.0
    model.numeric_data[model.numeric_adr[k]] = found = float(next(_marks))
    return found


class Callback:
    """The compiled friction of scenes, for models of one robot.

    Args:
        mujoco: the module. scenes: see `MujocoFriction`.
        constants: of the law, by their names in the C++ text.

    Raises:
        PinfricError: no compiler, or it fails.
    """

    def __init__(
        self, mujoco: Any, scenes: Mapping[str, Scene], constants: dict[str, float]
    ) -> None:
        self._mujoco, self._scenes = mujoco, list(scenes.values())
        self.library = _compiled(mujoco, self._scenes, constants)

    @contextmanager
    def installed(
        self, model: Any, mark: float, places: Mapping[str, tuple[np.ndarray, ...]]
    ) -> Iterator[None]:
        """Set the callbacks, and remove them at the end; frictions of other models may be set, too.

        Args:
            model, mark: the model and what `mark` returned of it.
            places: of each scene, (na,) each: joints of the model, rows of their bodies, armature
                of the links, M/(M + J), whether the joint counts; of the joints that follow a drive
                (n, 3) their joint, row, drive and (n, 2) ratio, armature; (ns,) factors on the
                friction of joints.

        Raises:
            PinfricError: the model has no sensor of the friction; actuation or sensors are
                disabled; else see `MujocoFriction.installed`.
        """
        mujoco, bits, library = self._mujoco, self._mujoco.mjtDisableBit, self.library
        memory = [_memory(mujoco, model, prefix, len(of[0])) for prefix, of in places.items()]
        for bit, name in ((bits.mjDSBL_ACTUATION, "actuation"), (bits.mjDSBL_SENSOR, "sensor")):
            if model.opt.disableflags & bit:
                raise PinfricError(
                    f"mujoco_friction: the model's flag {name} is disabled, so MuJoCo does not "
                    "call friction; enable it"
                )
        _INSTALLED.check(mujoco, mark)
        place = model.numeric_adr[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, _MARK)]
        address = ctypes.c_void_p(model._address)
        for k, of in enumerate(places.values()):
            arrays = [x.astype(float if x.dtype == float else np.int32) for x in of]
            given = (a.ctypes.data_as(ctypes.c_void_p) for a in arrays)
            number, at = ctypes.c_double(mark), int(place)
            library[f"pinfric_set_{k}"](address, number, at, *given, len(of[-2]), memory[k])
        _INSTALLED.add(mujoco, library, mark)
        try:
            yield
        finally:
            strange = library.pinfric_strange()
            _INSTALLED.remove(mujoco, library, mark)
            removed = [
                library[f"pinfric_remove_{k}"](ctypes.c_double(mark)) for k in range(len(places))
            ]
        for scene, failed in zip(self._scenes, removed, strict=True):
            if failed == -2:
                raise PinfricError(
                    "mujoco_friction: the time step was changed while friction was installed, or "
                    "the integrator to RK4, a flag that friction needs, armature or damping: make "
                    "the friction anew for another one"
                )
            if failed >= 0:
                raise jams(scene, failed, "in a step with the callback")
        if strange:
            raise PinfricError(
                "mujoco_friction: a model of another friction ran, which was not installed: its "
                "constants did not change; install all at once, one `with` for each"
            )


class _Installed:
    """Libraries that MuJoCo calls now, one after the other, and the marks of their models."""

    def __init__(self) -> None:
        self._libraries: list[ctypes.CDLL] = []
        self._marks: list[float] = []
        self._set: tuple[Any, Any] = None, None

    def check(self, mujoco: Any, mark: float) -> None:
        """Refuse another control or sensor callback, and a friction that is installed."""
        for name, own in zip(("control", "sensor"), self._set, strict=True):
            if getattr(mujoco, f"get_mjcb_{name}")() is not own:
                raise PinfricError(
                    f"mujoco_friction: another mjcb_{name} is set, and MuJoCo has one for all "
                    f"models; take it away first: mujoco.set_mjcb_{name}(None)"
                )
        if mark in self._marks:
            raise PinfricError("mujoco_friction: this friction is installed already")

    def add(self, mujoco: Any, library: ctypes.CDLL, mark: float) -> None:
        """Let MuJoCo call a library for the model of that mark."""
        self._libraries.append(library)
        self._marks.append(mark)
        self._link(mujoco)

    def remove(self, mujoco: Any, library: ctypes.CDLL, mark: float) -> None:
        """Take it away."""
        k = self._marks.index(mark)
        del self._libraries[k], self._marks[k]
        self._link(mujoco)

    def _link(self, mujoco: Any) -> None:
        """Chain the libraries, the first set in MuJoCo; tell each which models are expected."""
        chain = list({library._handle: library for library in self._libraries}.values())
        marks = (ctypes.c_double * len(self._marks))(*self._marks)
        for library, after in zip(chain, [*chain[1:], None][: len(chain)], strict=True):
            following: list[Any] = [None, None]
            if after is not None:
                calls = after.pinfric_control, after.pinfric_sensor
                following = [ctypes.cast(call, ctypes.c_void_p) for call in calls]
            library.pinfric_link(*following, marks, len(marks))
        self._set = (chain[0].pinfric_control, chain[0].pinfric_sensor) if chain else (None, None)
        mujoco.set_mjcb_control(self._set[0])
        mujoco.set_mjcb_sensor(self._set[1])


_INSTALLED = _Installed()


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


#: What MuJoCo calls, of all scenes one after the other, then of the next library.
_ALL = """#include <mujoco/mujoco.h>
#include <algorithm>
#include <atomic>
#include <vector>
extern "C" {{
{declared}
}}
namespace {{
void (*next_control)(const mjModel*, mjData*) = nullptr;
void (*next_sensor)(const mjModel*, mjData*, int) = nullptr;
std::vector<double> expected;
std::atomic<bool> strange{{false}};
}}
extern "C" {{
void pinfric_link(void (*control)(const mjModel*, mjData*),
                  void (*sensor)(const mjModel*, mjData*, int), const double* marks, int count) {{
  next_control = control;
  next_sensor = sensor;
  expected.assign(marks, marks + count);
  if (count == 1) strange = false;
}}
// Whether a model of another friction ran, which is not installed.
int pinfric_strange() {{ return strange.exchange(false); }}
void pinfric_control(const mjModel* m, mjData* d) {{
  double mark;
  if (({alike}) && mark != 0.0 &&
      std::find(expected.begin(), expected.end(), mark) == expected.end())
    strange = true;
  {control}
  if (next_control) next_control(m, d);
}}
void pinfric_sensor(const mjModel* m, mjData* d, int stage) {{
  {sensor}
  if (next_sensor) next_sensor(m, d, stage);
}}
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
        f"void pinfric_sensor_{k}(const mjModel*, mjData*, int);\n"
        f"bool pinfric_alike_{k}(const mjModel*, double*);"
        for k in indices
    )
    control = " ".join(f"pinfric_control_{k}(m, d);" for k in indices)
    sensor = " ".join(f"pinfric_sensor_{k}(m, d, stage);" for k in indices)
    alike = " || ".join(f"pinfric_alike_{k}(m, &mark)" for k in indices)
    called = {"declared": declared, "control": control, "sensor": sensor, "alike": alike}
    texts = {"all.cpp": _ALL.format(**called)}
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
