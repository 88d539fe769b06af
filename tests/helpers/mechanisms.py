"""Closed mechanisms built in Python, every number in sight; `cases.py` makes scenes of them."""

import numpy as np
import pinocchio as pin
from builders import random_inertia

import pinfric as pf
from pinfric.model.closure import closure_jacobian, full_pivot
from pinfric.model.loops import make_linkage
from pinfric.model.schema import Loop
from pinfric.model.twin import make_twin

#: Pin -> (parent bar, child bar, place on the parent, place on the child); bars lie along their x.
FOUR_BAR = {
    "O": ("ground", "crank"),
    "A": ("crank", "coupler"),
    "B": ("coupler", "rocker"),
    "C": ("ground", "rocker"),
}
LENGTHS = {"crank": 0.1, "coupler": 0.35, "rocker": 0.25}
MASSES = {"crank": 0.5, "coupler": 1.2, "rocker": 0.9}
GROUND = 0.3
#: Where each pin lies on each bar, from the bar's own start, along its x.
_PLACE = {
    ("O", "ground"): 0.0,
    ("C", "ground"): GROUND,
    ("O", "crank"): 0.0,
    ("A", "crank"): 0.1,
    ("A", "coupler"): 0.0,
    ("B", "coupler"): 0.35,
    ("B", "rocker"): 0.25,
    ("C", "rocker"): 0.0,
}


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


def shifted(x, z=0.0):
    """Placement at x and z of the parent."""
    return pin.SE3(np.eye(3), np.array([x, 0.0, z]))


def pin_friction(mu, radius=0.01, static=None, **more):
    """Friction of a pin without length."""
    return {
        "bearing": {"kind": "pin", "radius": radius, **more},
        "mu": {"static": mu if static is None else static, "kinetic": mu},
    }


def ring_of_bars(pins, place, masses, cut, kind, gravity, level=None):
    """Bars pinned to each other and, the first and last, to the ground; cut at one of the pins.

    Args:
        pins: pin -> (bar, next bar), from the ground to the ground; they name the joints.
        place: (pin, bar) -> where the pin lies on the bar, from its start, along its x.
        masses: of the bars; each reaches from 0 to the farther of its two pins.
        cut, kind: which pin is the loop, and the loop's kind.
        level: bar -> its height along the pins' axes, else 0.

    Returns:
        model, loop, and a function from the bars' angles (..., n) to q or their rates to v.
    """
    model, names = grounded_model(gravity), list(pins)
    at = names.index(cut)
    order = names[:at] + names[:at:-1]
    ids, origin, parent_of = {"ground": 0}, {"ground": 0.0}, {}
    z = {"ground": 0.0, **dict.fromkeys(masses, 0.0), **(level or {})}
    for name in order:
        first, second = pins[name]
        parent, child = (first, second) if first in ids else (second, first)
        parent_of[name] = parent, child
        placement = shifted(place[name, parent] - origin[parent], z[child] - z[parent])
        joint = model.addJoint(ids[parent], pin.JointModelRZ(), placement, name)
        origin[child] = place[name, child]  # the child's frame sits at this pin
        length = max(x for (_, bar_), x in place.items() if bar_ == child)
        body = bar(masses[child], length, -origin[child])
        model.appendBodyToJoint(joint, body, pin.SE3.Identity())
        model.addFrame(pin.Frame(child, joint, pin.SE3.Identity(), pin.FrameType.BODY))
        ids[child] = joint
    loop = {"name": cut, "kind": kind}
    for side, link in zip("ab", pins[cut], strict=True):
        # the frames of both sides meet at the height of the second bar
        height = z[pins[cut][1]] - z[link]
        loop[side] = {"link": link, "xyz": [place[cut, link] - origin[link], 0.0, height]}
    bars = list(masses)
    column = {name: model.joints[model.getJointId(name)].idx_v for name in order}

    def joints(of_bars):
        of_bars = np.asarray(of_bars, dtype=float)
        out = np.zeros(of_bars.shape)
        for name, (parent, child) in parent_of.items():
            out[..., column[name]] = of_bars[..., bars.index(child)]
            if parent != "ground":
                out[..., column[name]] -= of_bars[..., bars.index(parent)]
        return out

    return model, loop, joints


def four_bar(
    cut="B",
    kind="planar_pin",
    mu=0.3,
    gravity=(0.0, -9.81, 0.0),
    static=None,
    friction=None,
    level=None,
    **more,
):
    """A four-bar, cut at one of its pins; joints are called by their pins O, A, B, C.

    Args:
        level: see `ring_of_bars`.
        friction: of every pin, else that of `mu` and `static`; or a mapping by pin.

    Returns:
        scene, and a function from the bars' angles (..., 3) to q or their rates to v.
    """
    model, loop, joints = ring_of_bars(FOUR_BAR, _PLACE, MASSES, cut, kind, gravity, level)
    entry = pin_friction(mu, static=static) if friction is None else friction
    each = entry if set(entry) <= set("OABC") else dict.fromkeys("OABC", entry)
    scene = pf.Scene(model=model, friction=each, actuators=[{"joint": "O"}], loops=[loop], **more)
    return scene, joints


def six_bar(mu=0.2):
    """Watt's six-bar in the plane, friction in seven pins, driven at its crank; scene and q."""
    model, turns = grounded_model(), pin.JointModelRZ
    crank = add_link(model, 0, turns(), shifted(0.0), "crank", bar(0.3, 0.1))
    add_link(model, crank, turns(), shifted(0.1), "coupler", bar(0.6, 0.35))
    rocker = add_link(model, 0, turns(), shifted(0.35), "rocker", bar(0.8, 0.4))
    add_link(model, rocker, turns(), shifted(0.4), "rod", bar(0.5, 0.4))
    add_link(model, 0, turns(), shifted(0.8), "lever", bar(0.6, 0.3))
    loops = [
        {
            "name": name,
            "kind": "planar_pin",
            "a": {"link": a, "xyz": [at_a, 0.0, 0.0]},
            "b": {"link": b, "xyz": [at_b, 0.0, 0.0]},
        }
        for name, a, at_a, b, at_b in (
            ("first", "coupler", 0.35, "rocker", 0.25),
            ("second", "rod", 0.4, "lever", 0.3),
        )
    ]
    names = ("crank", "coupler", "rocker", "rod", "lever", "first", "second")
    scene = pf.Scene(
        model=model,
        loops=loops,
        actuators=[{"joint": "crank"}],
        friction=dict.fromkeys(names, pin_friction(mu)),
    )
    return scene, scene.close(np.array([0.3, 0.2, 1.7, -1.4, 1.7]))


#: As `FOUR_BAR`; two freedoms.
FIVE_BAR = {
    "O": ("ground", "left"),
    "A": ("left", "upper_left"),
    "B": ("upper_left", "upper_right"),
    "C": ("upper_right", "right"),
    "D": ("ground", "right"),
}
_FIVE_PLACE = {
    ("O", "ground"): 0.0,
    ("D", "ground"): 0.2,
    ("O", "left"): 0.0,
    ("A", "left"): 0.2,
    ("A", "upper_left"): 0.0,
    ("B", "upper_left"): 0.25,
    ("B", "upper_right"): 0.25,
    ("C", "upper_right"): 0.0,
    ("C", "right"): 0.2,
    ("D", "right"): 0.0,
}


def five_bar(cut, friction, kind="planar_pin", gravity=(0.0, -9.81, 0.0)):
    """Two arms whose forearms meet in pin B, cut at one of its pins; driven at O and at D.

    Args:
        cut, kind: which pin is the loop, and the loop's kind. friction: by pin O, A, B, C, D.

    Returns:
        scene, and a symmetric q at which its loop closes.
    """
    masses = {"left": 0.6, "upper_left": 0.4, "upper_right": 0.5, "right": 0.7}
    model, loop, joints = ring_of_bars(FIVE_BAR, _FIVE_PLACE, masses, cut, kind, gravity)
    scene = pf.Scene(
        model=model, friction=friction, loops=[loop], actuators=[{"joint": "O"}, {"joint": "D"}]
    )
    elbow = 0.2 * np.cos(2.0) - 0.1  # from the middle, of the left one
    reach = np.arccos(-elbow / 0.25)
    return scene, joints([2.0, reach, np.pi - reach, np.pi - 2.0])


CRANK, ROD = 0.05, 0.15


def cut_slider_crank(
    cut="W",
    kind="revolute",
    mu=0.1,
    gravity=(0.0, -9.81, 0.0),
    drive="O",
    static=None,
    turned=None,
    friction=True,
):
    """A slider-crank cut at one of its joints: O and A of the crank, W of the piston, G its guide.

    Args:
        cut, kind: which joint is the loop (the guide is prismatic); the kind of a cut pin.
        mu, static: of all joints. friction: False for none. drive: the driven joint.
        turned: None, or returns small rotations (3, 3) of every placement, as files round.

    Returns:
        scene, and a function from crank angles (n,) to q.
    """
    model, spin = grounded_model(gravity), turned or (lambda: np.eye(3))
    bodies = {"crank": (0.5, CRANK), "rod": (0.6, ROD)}
    # joint -> parent link, child link, where on both
    edges = {
        "O": ("ground", "crank", 0.0, 0.0),
        "A": ("crank", "rod", CRANK, 0.0),
        "W": ("rod", "piston", ROD, 0.0),
        "G": ("ground", "piston", 0.0, 0.0),
    }
    order = {"W": "OAG", "G": "OAW", "A": "OGW", "O": "GWA"}[cut]
    ids, origin, reversed_ = {"ground": 0}, {"ground": 0.0}, set()
    for name in order:
        parent, child, at, own = edges[name]
        if parent not in ids:
            parent, child, at, own = child, parent, own, at
            reversed_.add(name)
        place = shifted(at - origin[parent])
        place.rotation = spin()
        joint = pin.JointModelPX() if name == "G" else pin.JointModelRZ()
        ids[child] = model.addJoint(ids[parent], joint, place, name)
        origin[child] = own
        body = pin.Inertia(0.8, np.array([0.01, 0.0, 0.0]), 1e-3 * np.diag([1.0, 2.0, 3.0]))
        if child in bodies:
            body = bar(*bodies[child], -own)
        model.appendBodyToJoint(ids[child], body, pin.SE3.Identity())
        model.addFrame(pin.Frame(child, ids[child], pin.SE3.Identity(), pin.FrameType.BODY))
    a, b, *places = edges[cut]
    loop = {
        "name": cut,
        "kind": "prismatic" if cut == "G" else kind,
        "axis": [1, 0, 0] if cut == "G" else [0, 0, 1],
    }
    for side, link, at in (("a", a, places[0]), ("b", b, places[1])):
        loop[side] = {
            "link": link,
            "xyz": [at - origin[link], 0, 0],
            "rpy": pin.rpy.matrixToRpy(spin()).tolist(),
        }
    guide = {
        "bearing": {"kind": "guide", "length": 0.06, "width": 0.05, "offset": 0.02},
        "mu": {"static": mu if static is None else static, "kinetic": mu},
    }
    rubs = dict.fromkeys("OAW", pin_friction(mu, 0.01, static)) | {"G": guide}
    scene = pf.Scene(
        model=model, friction=rubs if friction else {}, loops=[loop], actuators=[{"joint": drive}]
    )

    def joints(crank):
        rod = -np.arcsin(CRANK * np.sin(crank) / ROD)
        angles = {
            "O": crank,
            "A": rod - crank,
            "W": -rod,
            "G": CRANK * np.cos(crank) + ROD * np.cos(rod),
        }
        signed = [-angles[n] if n in reversed_ else angles[n] for n in tuple(model.names)[1:]]
        return np.stack(signed, axis=-1)

    return scene, joints


def crank_rates(angles, rate, acceleration):
    """(n, 2) rates and accelerations of `cut_slider_crank`'s O and A."""
    rod = -np.arcsin(CRANK * np.sin(angles) / ROD)
    turn = -CRANK * np.cos(angles) * rate / (ROD * np.cos(rod))
    pull = CRANK * (np.sin(angles) * rate**2 - np.cos(angles) * acceleration)
    change = (pull + ROD * np.sin(rod) * turn**2) / (ROD * np.cos(rod))
    one = np.ones_like(angles)
    return (
        np.column_stack([rate * one, turn - rate]),
        np.column_stack([acceleration * one, change - acceleration]),
    )


def spatial_loop(kind, seed, mu=0.0):
    """Two random chains in space whose ends one loop of any kind joins; one more joint than rows.

    Returns:
        scene, driven at joints that leave no other freedom; a closed q; the driven joints' names.
    """
    rng = np.random.default_rng(seed)
    model, tips = grounded_model(rng.normal(scale=6.0, size=3)), {}
    for side, count in (("a", 3), ("b", 4)):
        tips[side] = 0
        for k in range(count):
            axis = rng.normal(size=3)
            sort = (
                pin.JointModelPrismaticUnaligned
                if rng.random() < 0.25
                else (pin.JointModelRevoluteUnaligned)
            )
            place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.3, size=3))
            tips[side] = add_link(
                model,
                tips[side],
                sort(axis / np.linalg.norm(axis)),
                place,
                f"{side}{k}",
                random_inertia(rng),
            )
    q, data = rng.normal(size=model.nq), model.createData()
    pin.forwardKinematics(model, data, q)
    axis, second = rng.normal(size=(2, 3))
    axis, second = axis / np.linalg.norm(axis), second / np.linalg.norm(second)
    along, about = pin.SE3(np.eye(3), 0.3 * axis), pin.SE3(pin.exp3(0.7 * axis), np.zeros(3))
    normal = np.cross(axis, second) / np.linalg.norm(np.cross(axis, second))
    crossed = pin.Quaternion.FromTwoVectors(second, normal).toRotationMatrix()
    free = {
        "fixed": pin.SE3.Identity(),
        "revolute": about,
        "prismatic": along,
        "cylindrical": along * about,
        "universal": pin.SE3(crossed, np.zeros(3)),
        "spherical": pin.SE3(pin.exp3(rng.normal(size=3)), np.zeros(3)),
    }[kind]
    a = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.2, size=3))
    b = data.oMi[tips["b"]].actInv(data.oMi[tips["a"]] * a * free)
    loop = {"name": "loop", "kind": kind, "axis": axis.tolist()}
    if kind == "universal":
        loop["axis_b"] = second.tolist()
    for side, link, place in (("a", "a2", a), ("b", "b3", b)):
        loop[side] = {
            "link": link,
            "xyz": place.translation.tolist(),
            "rpy": pin.rpy.matrixToRpy(place.rotation).tolist(),
        }
    linkage = make_linkage(model, [Loop(**loop)], (), {}, "")
    rank, columns = full_pivot(closure_jacobian(make_twin(model), linkage, q[None])[0], 1.0)
    driven = [model.names[1 + v] for v in sorted(columns[rank:])]
    guide = {"kind": "guide", "length": 0.5, "width": 0.2}
    turning = {"kind": "pin", "radius": 0.01, "length": 0.1, "thrust_radius": 0.01}
    bearings = {
        name: guide if joint.shortname().startswith("JointModelP") else turning
        for name, joint in zip(tuple(model.names)[1:], list(model.joints)[1:], strict=True)
    } | {
        "prismatic": {"loop": guide},
        "revolute": {"loop": turning},
        "spherical": {"loop": {"kind": "ball", "radius": 0.01}},
    }.get(kind, {})
    friction = (
        {
            name: {"bearing": bearing, "mu": {"static": 1.2 * mu, "kinetic": mu}}
            for name, bearing in bearings.items()
        }
        if mu
        else {}
    )
    scene = pf.Scene(
        model=model, loops=[loop], friction=friction, actuators=[{"joint": name} for name in driven]
    )
    return scene, q, driven


def two_ball_loops(seed, counts=(3, 3, 2)):
    """Three random chains in space, joined by two balls: friction in eight sites, also the balls.

    Args:
        counts: joints of each chain; each above six in all is a driven freedom.

    Returns:
        scene, a closed q, and the generator of random numbers.
    """
    rng = np.random.default_rng(seed)
    model, tips, names = grounded_model(rng.normal(scale=6.0, size=3)), [], []
    for side, count in zip("abc", counts, strict=True):
        tip = 0
        for k in range(count):
            axis = rng.normal(size=3)
            place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(scale=0.3, size=3))
            joint = pin.JointModelRevoluteUnaligned(axis / np.linalg.norm(axis))
            names.append(f"{side}{k}")
            tip = add_link(model, tip, joint, place, names[-1], random_inertia(rng))
        tips.append((tip, names[-1]))
    q, data = rng.normal(size=model.nq), model.createData()
    pin.forwardKinematics(model, data, q)
    loops, friction = [], {}
    for n, sides in enumerate((tips[:2], tips[1:])):
        point = rng.normal(scale=0.3, size=3)
        loop = {"name": f"ball{n}", "kind": "spherical"}
        for side, (tip, link) in zip("ab", sides, strict=True):
            loop[side] = {"link": link, "xyz": data.oMi[tip].actInv(point).tolist()}
        loops.append(loop)
    turning = {"kind": "pin", "radius": 0.03, "length": 0.1, "thrust_radius": 0.03}
    for name in [*rng.permutation(names)[:6].tolist(), "ball0", "ball1"]:
        mu = rng.uniform(0.14, 0.46)
        bearing = {"kind": "ball", "radius": 0.03} if name.startswith("ball") else turning
        friction[name] = {"bearing": bearing, "mu": {"static": 1.2 * mu, "kinetic": mu}}
    driven = [{"joint": name} for name in names[: len(names) - 6]]
    return pf.Scene(model=model, loops=loops, friction=friction, actuators=driven), q, rng


def beside(*scenes):
    """One scene of several that stand beside each other on the ground."""
    model, friction, actuators, loops = grounded_model(), {}, [], []
    model.gravity.linear = scenes[0].model.gravity.linear
    for n, scene in enumerate(scenes):
        names, ids = {"ground": "ground"}, [0]
        for j in range(1, scene.model.njoints):
            name, place = f"{scene.model.names[j]}_{n}", scene.model.jointPlacements[j]
            ids.append(
                model.addJoint(ids[scene.model.parents[j]], scene.model.joints[j], place, name)
            )
            model.appendBodyToJoint(ids[j], scene.model.inertias[j], pin.SE3.Identity())
        for frame in scene.model.frames:
            if frame.type == pin.FrameType.BODY and frame.name != "ground":
                names[frame.name] = f"{frame.name}_{n}"
                body = pin.Frame(
                    f"{frame.name}_{n}", ids[frame.parentJoint], frame.placement, frame.type
                )
                model.addFrame(body)
        friction |= {f"{name}_{n}": entry for name, entry in scene.friction.items()}
        drives = scene.actuators or [{"joint": name} for name in list(scene.model.names)[1:]]
        actuators += [dict(a) | {"joint": f"{dict(a)['joint']}_{n}"} for a in drives]
        for loop in scene.loops:
            sides = {s: getattr(loop, s) for s in "ab"}
            sides = {s: at.model_copy(update={"link": names[at.link]}) for s, at in sides.items()}
            loops.append(loop.model_copy(update={"name": f"{loop.name}_{n}", **sides}))
    return pf.Scene(model=model, friction=friction, actuators=actuators, loops=loops)


def three_rrs(mu, radius, static):
    """Three legs of two pins that carry a platform on balls: scene, and a configuration's guess."""
    model, friction, loops = grounded_model((0.0, 0.0, -9.81)), {}, []
    body = pin.Inertia(2.0, np.zeros(3), np.diag([0.02, 0.02, 0.04]))
    add_link(model, 0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "platform", body)
    ball = {
        "bearing": {"kind": "ball", "radius": radius},
        "mu": {"static": static * mu, "kinetic": mu},
    }
    for k in range(3):
        R = pin.rpy.rpyToMatrix(0.0, 0.0, 2.0 * np.pi * k / 3.0)
        place = pin.SE3(R, R @ np.array([0.25, 0.0, 0.0]))
        arm = add_link(model, 0, pin.JointModelRY(), place, f"arm{k}", bar(0.6, 0.2))
        add_link(model, arm, pin.JointModelRY(), shifted(0.2), f"knee{k}", bar(0.5, 0.3))
        friction |= dict.fromkeys((f"arm{k}", f"knee{k}"), pin_friction(0.1, static=0.1 * static))
        friction[f"ball{k}"] = ball
        sides = {
            "a": {"link": f"knee{k}", "xyz": [0.3, 0.0, 0.0]},
            "b": {"link": "platform", "xyz": (R @ np.array([0.15, 0.0, 0.0])).tolist()},
        }
        loops.append({"name": f"ball{k}", "kind": "spherical", **sides})
    drives = [{"joint": f"arm{k}"} for k in range(3)]
    scene = pf.Scene(model=model, friction=friction, actuators=drives, loops=loops)
    return scene, np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 1.0, *[-0.9, -1.3] * 3])
