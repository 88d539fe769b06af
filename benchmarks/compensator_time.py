"""The compensator's `motor_torque` beside Pinocchio's C++ `rnea`, compiled alike, timed in one run.

    python benchmarks/compensator_time.py [--eigen FOLDER]

Pinocchio's headers are those of the wheel `pin`; Eigen's come with the extra `bench` (cmeel-eigen)
or a system's package: FOLDER holds `Eigen/Core`. Batches of 500 states, medians of 41 rounds.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from pathlib import Path

import measure
import numpy as np
import pinocchio as pin

import pinfric as pf
from pinfric.exporting.cpp import Bounds, cpp_files, header_name
from pinfric.model.robot import example_robot_data

PREFIX = next(p for p in Path(pin.__file__).parents if p.name == "cmeel.prefix")
EIGEN = PREFIX / "include" / "eigen3"
#: Pinocchio's list of joints is longer than Boost's lists are by default; as its CMake target sets.
DEFINED = [
    *("-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30"),
    *("-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "-DBOOST_FUSION_INVOKE_MAX_ARITY=12"),
]
FLAGS = {"-O2": ["-O2"], "-O3 -march=native": ["-O3", "-march=native"]}


def arms():
    """Two arms with gears."""
    model = pin.buildModelFromUrdf(str(example_robot_data() / "panda_description/urdf/panda.urdf"))
    gear = {"ratio": 100.0, "efficiency": 0.8, "back_efficiency": 0.7, "rotor_inertia": 1e-4}
    names = list(model.names)[1:]
    hinges = [name for name in names if "finger" not in name]
    scene = pf.Scene(
        model,
        friction={n: measure.PIN | {"viscous": 1.0} for n in hinges},
        actuators=[{"joint": n, "transmission": gear if n in hinges else None} for n in names],
        source="panda_with_gears.yaml",
    )
    return [pf.load_scene("ur10_machine_tending"), scene]


def numbers(values):
    """Numbers as C++ writes them."""
    return ", ".join(repr(float(x)) for x in np.ravel(values))


def model_text(scene):
    """C++ that builds a scene's model, body by body."""
    model, lines = scene.loaded_model(), ["Eigen::Matrix3d R, I;"]
    for j in range(1, model.njoints):
        place, body, kind = model.jointPlacements[j], model.inertias[j], model.joints[j].shortname()
        axis = scene.twin().axis[j - 1].reshape(2, 3).sum(axis=0)
        made = f"{kind}(Eigen::Vector3d({numbers(axis)}))" if "Unaligned" in kind else f"{kind}()"
        lines += [
            f"R << {numbers(place.rotation)};",
            f"I << {numbers(body.inertia)};",
            f"model.addJoint({model.parents[j]}, pinocchio::{made}, "
            f"pinocchio::SE3(R, Eigen::Vector3d({numbers(place.translation)})), "
            f'"{model.names[j]}");',
            f"model.appendBodyToJoint({j}, pinocchio::Inertia({body.mass!r}, "
            f"Eigen::Vector3d({numbers(body.lever)}), I));",
        ]
    return "\n  ".join(lines)


def compiled(scene, folder, flags, eigen):
    """The program for one scene."""
    name = header_name(scene.source)
    files = cpp_files(scene, (), Bounds.none(len(scene.drives)), [], ["timed"])
    (folder / f"{name}.hpp").write_text(files.header)
    text = Path(__file__).with_suffix(".cpp").read_text()
    for old, new in (
        ("@@HEADER", f"{name}.hpp"),
        ("pinfric_scene", name),
        ("// @@MODEL", model_text(scene)),
    ):
        text = text.replace(old, new)
    (folder / "time.cpp").write_text(text)
    include, lib = PREFIX / "include", PREFIX / "lib"
    command = [
        "g++",
        "-std=c++17",
        *flags,
        *DEFINED,
        "-isystem",
        include,
        "-isystem",
        eigen,
        folder / "time.cpp",
        "-o",
        folder / "time",
        f"-L{lib}",
        f"-Wl,-rpath,{lib}",
        "-lpinocchio_default",
    ]
    subprocess.run(command, check=True)
    return folder / "time"


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--eigen", type=Path, default=EIGEN)
    eigen = parser.parse_args().eigen
    for label, flags in FLAGS.items():
        for scene in arms():
            with tempfile.TemporaryDirectory() as folder:
                program = compiled(scene, Path(folder), flags, eigen)
                found = subprocess.run([program], check=True, capture_output=True, text=True)
            print(f"{Path(scene.source).stem:24} {label:18} {found.stdout.strip()}", flush=True)


if __name__ == "__main__":
    main()
