"""Closed mechanisms built in Python, every number in sight; `cases.py` makes scenes of them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import pinfric as pf

#: Pin -> (parent bar, child bar, place on the parent, place on the child); bars lie along their x.
FOUR_BAR = {"O": ("ground", "crank"), "A": ("crank", "coupler"), "B": ("coupler", "rocker"),
            "C": ("ground", "rocker")}  # fmt: skip
LENGTHS = {"crank": 0.1, "coupler": 0.35, "rocker": 0.25}
MASSES = {"crank": 0.5, "coupler": 1.2, "rocker": 0.9}
GROUND = 0.3
#: Where each pin lies on each bar, from the bar's own start, along its x.
_PLACE = {
    ("O", "ground"): 0.0, ("C", "ground"): GROUND, ("O", "crank"): 0.0, ("A", "crank"): 0.1,
    ("A", "coupler"): 0.0, ("B", "coupler"): 0.35, ("B", "rocker"): 0.25, ("C", "rocker"): 0.0,
}  # fmt: skip


def add_link(model, parent, kind, placement, name, inertia=None):
    """Add a joint and its link, both called `name`; return the joint's id."""
    joint = model.addJoint(parent, kind, placement, name)
    if inertia is not None:
        model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame(name, joint, pin.SE3.Identity(), pin.FrameType.BODY))
    return joint


def grounded_model(gravity=(0.0, -9.81, 0.0)):
    """An empty model with a link `ground`."""
    model = pin.Model()
    model.gravity.linear = np.array(gravity, dtype=float)
    model.addFrame(pin.Frame("ground", 0, pin.SE3.Identity(), pin.FrameType.BODY))
    return model


def bar(mass, length, start=0.0, width=0.02):
    """A uniform bar along x that begins at `start`; slender but for its thickness."""
    moment = mass * length**2 / 12
    inertia = np.diag([mass * width**2 / 6, moment, moment])
    return pin.Inertia(mass, np.array([start + length / 2, 0.0, 0.0]), inertia)


def shifted(x):
    """Placement at x on the parent's x axis."""
    return pin.SE3(np.eye(3), np.array([x, 0.0, 0.0]))


def pin_friction(mu, radius=0.01, static=None, **more):
    """Friction of a pin without length."""
    return {"bearing": {"kind": "pin", "radius": radius, **more},
            "mu": {"static": mu if static is None else static, "kinetic": mu}}  # fmt: skip


def four_bar(cut="B", kind="planar_pin", mu=0.3, gravity=(0.0, -9.81, 0.0), static=None,
             friction=None, **more):  # fmt: skip
    """The issue's four-bar, cut at one of its pins; joints are called by their pins O, A, B, C.

    Returns:
        scene, and a function from the bars' angles (..., 3) to q or their rates to v.
    """
    model = grounded_model(gravity)
    order = {"A": ["O", "C", "B"], "B": ["O", "A", "C"], "C": ["O", "A", "B"],
             "O": ["C", "B", "A"]}[cut]  # fmt: skip
    ids, origin, parent_of = {"ground": 0}, {"ground": 0.0}, {}
    for name in order:
        first, second = FOUR_BAR[name]
        parent, child = (first, second) if first in ids else (second, first)
        parent_of[name] = parent, child
        placement = shifted(_PLACE[name, parent] - origin[parent])
        joint = model.addJoint(ids[parent], pin.JointModelRZ(), placement, name)
        origin[child] = _PLACE[name, child]  # the child's frame sits at this pin
        body = bar(MASSES[child], LENGTHS[child], -origin[child])
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        model.addFrame(pin.Frame(child, joint, pin.SE3.Identity(), pin.FrameType.BODY))
        ids[child] = joint
    a, b = FOUR_BAR[cut]
    loop = {"name": cut, "kind": kind}
    for side, link in (("a", a), ("b", b)):
        loop[side] = {"link": link, "xyz": [_PLACE[cut, link] - origin[link], 0.0, 0.0]}
    entry = pin_friction(mu, static=static) if friction is None else friction
    scene = pf.Scene(
        model=model,
        friction=dict.fromkeys("OABC", entry) if entry else {},
        actuators=[{"joint": "O"}],
        loops=[loop],
        **more,
    )
    bars = ("crank", "coupler", "rocker")
    column = {name: model.joints[model.getJointId(name)].idx_v for name in order}

    def joints(of_bars):
        of_bars = np.asarray(of_bars, dtype=float)
        out = np.zeros(of_bars.shape)
        for name, (parent, child) in parent_of.items():
            out[..., column[name]] = of_bars[..., bars.index(child)]
            if parent != "ground":
                out[..., column[name]] -= of_bars[..., bars.index(parent)]
        return out

    return scene, joints
