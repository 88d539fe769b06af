"""A robot as files that can be rewritten: renamed, mounted elsewhere, scaled, in wrong units."""

import json
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import yaml

import pinfric as pf

ROBOTS = Path(__file__).parents[2] / "robots"
#: Keys of a scene that are lengths.
LENGTHS = {"radius", "length", "thrust_radius", "radial", "axial", "width", "pitch", "xyz", "com"}


@dataclass
class RobotFiles:
    """The contents of a robot's URDF, scene and way-points.

    Attributes:
        joints: names, in the model's order.
        slides: joints that slide.
    """

    name: str
    urdf: ElementTree.Element
    scene: dict
    motion: dict

    @classmethod
    def of(cls, name, folder=ROBOTS):
        """Read a robot whose files have one name; YAML's aliases become objects of their own."""
        folder = Path(folder)
        urdf = ElementTree.parse(folder / f"{name}.urdf").getroot()
        scene, motion = (
            json.loads(json.dumps(yaml.safe_load((folder / f"{name}{end}").read_text())))
            for end in (".yaml", ".waypoints.yaml")
        )
        scene.pop("simulation", None) if "loops" not in scene else None
        if "joints" not in motion:
            motion["joints"] = list(pf.load_scene(folder / f"{name}.yaml").joint_names)
        return cls(name, urdf, scene, motion)

    def copy(self):
        """Return one that may be changed."""
        return deepcopy(self)

    @property
    def slides(self):
        """The joints that slide."""
        return {j.get("name") for j in self.urdf.iter("joint") if j.get("type") == "prismatic"}

    @property
    def root(self):
        """The link that is no joint's child."""
        children = {child.get("link") for child in self.urdf.iter("child")}
        return next(
            x.get("name") for x in self.urdf.findall("link") if x.get("name") not in children
        )

    def write(self, folder):
        """Write its files and return those of scene and way-points."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        self.scene["robot"]["urdf"] = f"{self.name}.urdf"
        ElementTree.ElementTree(self.urdf).write(folder / f"{self.name}.urdf")
        files = folder / f"{self.name}.yaml", folder / f"{self.name}.waypoints.yaml"
        for file, content in zip(files, (self.scene, self.motion), strict=True):
            file.write_text(yaml.safe_dump(content, sort_keys=False))
        return files

    def load(self, folder):
        """Write it and return its scene and trajectory."""
        scene_file, motion_file = self.write(folder)
        scene = pf.load_scene(scene_file)
        return scene, pf.load_trajectory(motion_file, scene)


def renamed(robot):
    """Return the robot with other names, in the other alphabetical order, and the old names."""
    robot = robot.copy()
    names = sorted({x.get("name") for x in robot.urdf if x.tag in ("link", "joint")})
    new = {name: f"n{len(names) - k:03d}_{name[::-1]}" for k, name in enumerate(names)}

    def said(x):
        if isinstance(x, dict):
            return {new.get(key, key): said(value) for key, value in x.items()}
        if isinstance(x, list):
            return [said(value) for value in x]
        return new.get(x, x) if isinstance(x, str) else x

    for element in robot.urdf.iter():
        for key in ("name", "link", "joint"):
            if element.tag in ("link", "joint", "parent", "child", "mimic") and element.get(key):
                element.set(key, new[element.get(key)])
    robot.scene, robot.motion = said(robot.scene), said(robot.motion)
    return robot, {value: key for key, value in new.items()}


def with_bystander(robot):
    """Return the robot beside a swinging mass that stands on its base, and does not move."""
    robot = robot.copy()
    text = f"""<robot><link name="aa_mass"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="aa_swing" type="revolute"><parent link="{robot.root}"/><child link="aa_mass"/>
      <origin xyz="1 1 0"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="50" velocity="3"/></joint></robot>"""
    robot.urdf.extend(ElementTree.fromstring(text))
    robot.scene["friction"]["aa_swing"] = {"coulomb": {"static": 0.5, "kinetic": 0.4}}
    robot.scene["actuators"].append({"joint": "aa_swing"})
    robot.motion["joints"].append("aa_swing")
    for point in robot.motion["points"]:
        point["q"].append(0.2)
    return robot


def mounted(robot, rpy=(0.7, -0.4, 1.1)):
    """Return the robot turned as a whole, its base and gravity alike."""
    robot = robot.copy()
    text = f"""<robot><link name="new_ground"/><joint name="new_mount" type="fixed">
      <parent link="new_ground"/><child link="{robot.root}"/>
      <origin xyz="0.3 -0.2 0.5" rpy="{rpy[0]} {rpy[1]} {rpy[2]}"/></joint></robot>"""
    robot.urdf.extend(ElementTree.fromstring(text))
    gravity = robot.scene["robot"].get("gravity", [0.0, 0.0, -9.81])
    turned = pin.rpy.rpyToMatrix(*rpy) @ np.array(gravity)
    robot.scene["robot"]["gravity"] = turned.tolist()
    return robot


def _times(element, key, factor):
    """Multiply the numbers of an attribute, where it is."""
    if element is not None and element.get(key):
        numbers = [factor * float(x) for x in element.get(key).split()]
        element.set(key, " ".join(f"{x:.17g}" for x in numbers))


def _scaled_keys(x, key, effort, length, mass):
    """Multiply all numbers of a part of a scene by what their keys say; `effort`: of its joint."""
    if isinstance(x, dict):
        inside = {own: own if key != "coulomb" else key for own in x}
        return {
            own: _scaled_keys(value, inside[own], effort, length, mass) for own, value in x.items()
        }
    if isinstance(x, list):
        return [_scaled_keys(value, key, effort, length, mass) for value in x]
    if not isinstance(x, int | float) or isinstance(x, bool):
        return x
    time = np.sqrt(length)
    inertia = mass * length**2
    by = dict.fromkeys(LENGTHS, length) | {
        **{"mass": mass, "inertia": inertia, "rotor_inertia": inertia},
        **{"coulomb": effort, "no_load_torque": effort},
        "viscous": effort / time if effort == mass else effort * time,
    }
    return float(by.get(key, 1.0) * x)


def scaled(robot, length=2.0, mass=3.0):
    """Return the robot with other lengths and masses under the same gravity.

    Times are sqrt(length) times as long, torques mass x length, and forces mass times as large.
    """
    robot = robot.copy()
    time, slides = np.sqrt(length), robot.slides

    for origin in robot.urdf.iter("origin"):
        _times(origin, "xyz", length)
    for element in robot.urdf.iter("mass"):
        _times(element, "value", mass)
    for element in robot.urdf.iter("inertia"):
        for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"):
            _times(element, key, mass * length**2)
    for joint in robot.urdf.iter("joint"):
        slide, limit = joint.get("name") in slides, joint.find("limit")
        for key in ("lower", "upper"):
            _times(limit, key, length if slide else 1.0)
        _times(limit, "velocity", (length if slide else 1.0) / time)
        _times(limit, "effort", mass if slide else mass * length)

    friction = robot.scene["friction"]
    for name, entry in friction.items():
        friction[name] = _scaled_keys(
            entry, "", mass if name in slides else mass * length, length, mass
        )
    for key in ("loops", "actuators"):
        if key in robot.scene:
            robot.scene[key] = _scaled_keys(robot.scene[key], "", mass * length, length, mass)
    payloads = robot.scene["robot"].get("payloads", {})
    robot.scene["robot"]["payloads"] = _scaled_keys(payloads, "", mass, length, mass)
    robot.motion["sample_rate"] /= float(time)
    for point in robot.motion["points"]:
        for key in ("hold", "duration"):
            if key in point:
                point[key] *= float(time)
        point["q"] = [
            float(length) * x if name in slides else x
            for name, x in zip(robot.motion["joints"], point["q"], strict=True)
        ]
    return robot


def _limits(factor, of):
    """Multiply the position limits of joints of one kind."""

    def change(robot):
        for joint in robot.urdf.iter("joint"):
            limit = joint.find("limit")
            if limit is not None and joint.get("type") == of:
                for key in ("lower", "upper"):
                    limit.set(key, str(factor * float(limit.get(key))))

    return change


def _numbers(tag, keys, factor, first=False):
    """Multiply attributes of all elements of one name, or of the first."""

    def change(robot):
        for element in robot.urdf.iter(tag):
            for key in keys:
                if element.get(key):
                    numbers = [factor * float(x) for x in element.get(key).split()]
                    element.set(key, " ".join(map(str, numbers)))
            if first:
                return

    return change


def _center_outside(robot):
    """Put the last link's centre of mass 1.4 m from its joint."""
    last = [link for link in robot.urdf.findall("link") if link.find("inertial") is not None][-1]
    inertial = last.find("inertial")
    if inertial.find("origin") is None:
        ElementTree.SubElement(inertial, "origin")
    inertial.find("origin").set("xyz", "1.4 0 0")


INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
#: Mistake -> a function that makes it in a robot's files.
MISTAKES = {
    "limits in degrees": _limits(180.0 / np.pi, "revolute"),
    "slides in mm": _limits(1e3, "prismatic"),
    "masses in g": _numbers("mass", ("value",), 1e3),
    "one mass in g": _numbers("mass", ("value",), 1e3, first=True),
    "masses in t": _numbers("mass", ("value",), 1e-3),
    "inertias in g mm^2": _numbers("inertia", INERTIA, 1e9),
    "inertias in kg mm^2": _numbers("inertia", INERTIA, 1e6),
    "inertias in g m^2": _numbers("inertia", INERTIA, 1e3),
    "lengths in mm": _numbers("origin", ("xyz",), 1e3),
    "lengths in cm": _numbers("origin", ("xyz",), 1e2),
    "efforts in N mm": _numbers("limit", ("effort",), 1e3),
    "velocities in deg/s": _numbers("limit", ("velocity",), 180.0 / np.pi),
    "a centre of mass outside": _center_outside,
}
