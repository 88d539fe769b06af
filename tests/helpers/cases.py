"""Hard cases as named functions: a scene, a motion, and what is known of the answer.

Forward dynamics and simulation use the same scenes; `tests/judges/test_cases_inverse.py` judges
inverse dynamics.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin
from builders import dry, lump
from judges.planar_newton_euler import FourBar, bar_angles, bar_rates
from mechanisms import add_link, bar, four_bar, grounded_model, pin_friction, shifted

import pinfric as pf
from pinfric.dynamics.samples.closure import complete_configurations, consistent_motion


@dataclass(frozen=True)
class Case:
    """A scene, the samples of a motion, and what is known of the answer."""

    scene: pf.Scene
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    t: np.ndarray | None = None
    known: dict[str, Any] = field(default_factory=dict)

    def inverse(self, **more):
        return pf.inverse_dynamics(self.scene, self.q, self.v, self.a, t=self.t, **more)


# ---------------------------------------------------------------- drawers


def drawer_scene(mu, static=None, length=0.3, offset=0.3, mass=4.0):
    """A drawer on two pads `length` apart, pushed `offset` beside its middle."""
    model = grounded_model((0.0, 0.0, -9.81))
    body = lump(mass, moment=0.05)
    add_link(model, 0, pin.JointModelPX(), pin.SE3.Identity(), "drawer", body)
    friction = {
        "bearing": {"kind": "guide", "length": length},
        "mu": {"static": mu if static is None else static, "kinetic": mu},
    }
    push = {"name": "push", "link": "drawer", "xyz": [0, offset, 0], "direction": [1, 0, 0]}
    return pf.Scene(model=model, friction={"drawer": friction}, actuators=[{"force": push}])


def drawer_forces(mu, acceleration, length=0.3, offset=0.3, mass=4.0, g=9.81):
    """Every push that moves the drawer forward: F = m a + mu sqrt((m g)^2 + (2 F e / L)^2)."""
    k = 2 * mu * offset / length
    ma, weight = mass * acceleration, mu * mass * g
    roots = np.roots([1 - k**2, -2 * ma, ma**2 - weight**2])
    roots = roots[np.isreal(roots)].real
    return np.unique(roots[roots >= ma])  # friction opposes the motion


def jamming_drawer(mu, acceleration=1.0):
    """Critical mu = length / (2 offset) = 0.5: beyond it no push moves the drawer forward."""
    one = np.ones((1, 1))
    known = {"critical_mu": 0.5, "forces": drawer_forces(mu, acceleration)}
    return Case(drawer_scene(mu), 0 * one, one, acceleration * one, known=known)


def decelerating_drawer():
    """Braked beyond its critical mu, the drawer has two solutions, -5.5 and 141.9 N."""
    return jamming_drawer(0.6, -7.5)


# ---------------------------------------------------------------- four-bars


def crank_motion(joints, angles, rate=6.28, acceleration=3.0, mechanism=FourBar()):  # noqa: B008
    """(q, v, a) of the bars at each crank angle."""
    of_bars = np.array([bar_angles(mechanism, angle) for angle in angles])
    rates = np.array([bar_rates(mechanism, bars, rate, acceleration) for bars in of_bars])
    return joints(of_bars), joints(rates[:, 0]), joints(rates[:, 1])


def turning_four_bar(samples=120, cut="B", kind="planar_pin", rate=6.28, acceleration=3.0, **more):
    """A four-bar over one turn; 0 and pi left out, where a pin reverses."""
    scene, joints = four_bar(cut, kind, **more)
    angles = 0.01 + np.linspace(0, 2 * np.pi, samples, endpoint=False)
    q, v, a = crank_motion(joints, angles, rate, acceleration)
    t = angles / abs(rate) if rate else None
    return Case(scene, q, v, a, t, known={"angles": angles})


def resting_four_bar(samples=7, **more):
    """The same at rest: every pin sticks."""
    case = turning_four_bar(samples, **more)
    return Case(case.scene, case.q, 0 * case.v, 0 * case.a, known=case.known)


def rocker_driven_four_bar(offsets, mu=0.3, radius=0.03):
    """Driven at its rocker near the toggle where crank and coupler lie in line.

    There the rocker's torque cannot turn the crank; with friction it locks before.

    Args:
        offsets: crank angles beyond the toggle (rad).
    """
    scene, joints = four_bar(friction=pin_friction(mu, radius))
    scene = pf.Scene(
        model=scene.model, friction=scene.friction, loops=scene.loops, actuators=[{"joint": "C"}]
    )
    toggle = np.arccos((0.3**2 + 0.45**2 - 0.25**2) / (2 * 0.3 * 0.45))  # O-B = crank + coupler
    q, v, a = crank_motion(joints, toggle + np.asarray(offsets), 1.0, 0.0)
    return Case(scene, q, v, a, known={"toggle": toggle})


def four_bars_in_a_row(samples=5, mu=0.3, radius=0.01):
    """Three parallelogram-like four-bars, each rocker the next one's crank: ten pins, one freedom.

    At rest all ten stick at once.
    """
    model, loops, friction = grounded_model((0.4, -9.81, 0.0)), [], {}
    ids = {"ground": 0}

    def link(parent, name, at, mass, length):
        ids[name] = add_link(
            model, ids[parent], pin.JointModelRZ(), shifted(at), name, bar(mass, length)
        )
        friction[name] = pin_friction(mu, radius)

    link("ground", "crank", 0.0, 0.5, 0.1)
    for n in (1, 2, 3):
        before = "crank" if n == 1 else f"rocker_{n - 1}"
        link(before, f"coupler_{n}", 0.1 if n == 1 else 0.18, 0.8, 0.35)
        link("ground", f"rocker_{n}", 0.3 * n, 0.6, 0.2)
        loop = {
            "name": f"pin_{n}",
            "kind": "planar_pin",
            "a": {"link": f"coupler_{n}", "xyz": [0.35, 0, 0]},
            "b": {"link": f"rocker_{n}", "xyz": [0.2, 0, 0]},
        }
        loops.append(loop)
        friction[f"pin_{n}"] = pin_friction(mu, radius)
    scene = pf.Scene(model=model, friction=friction, loops=loops, actuators=[{"joint": "crank"}])
    guess = np.array([1.2, -0.8, 1.2, -0.9, 1.3, -1.0, 1.4])
    guesses = guess + np.outer(np.linspace(0, 0.3, samples), np.eye(7)[0])
    q = np.array([scene.close(near, ["crank"]) for near in guesses])
    zero = np.zeros((samples, 7))
    return Case(scene, q, zero, zero)


def four_bar_of_masses(ratio):
    """The four-bar with bars of 1, ratio and ratio^2 kg."""
    scene, joints = four_bar()
    model = scene.model.copy()
    for joint, factor in ((2, ratio), (3, ratio**2)):
        body = model.inertias[joint]
        model.inertias[joint] = pin.Inertia(body.mass * factor, body.lever, body.inertia * factor)
    scene = pf.Scene(
        model=model, friction=scene.friction, loops=scene.loops, actuators=scene.actuators
    )
    q, v, a = crank_motion(joints, np.linspace(0.2, 6.0, 12))
    return Case(scene, q, v, a)


def measured_four_bar(samples=400, noise=1e-3, seed=0):
    """A crank angle as an encoder gives it: noise of 1 mrad, velocities from differences."""
    scene, _ = four_bar()
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2.0, samples)
    crank = 0.5 + 3.0 * t + noise * rng.normal(size=samples)
    q = np.zeros((samples, 3))
    q[:, 0] = crank
    guess = np.array([0.5, 0.4, 1.5])
    q = complete_configurations(scene, guess, ["O"], q)
    rate = np.gradient(crank, t)[:, None]
    v, a = consistent_motion(scene, q, ["O"], rate, np.gradient(rate[:, 0], t)[:, None])
    return Case(scene, q, v, a, t)


def shaking_four_bar(samples=200):
    """The crank's motion changes its direction every millisecond."""
    scene, joints = four_bar()
    t = 1e-3 * (np.arange(samples) + 0.5)
    sign = np.where(np.arange(samples) % 2 == 0, 1.0, -1.0)
    bars = np.tile(bar_angles(FourBar(), 0.9), (samples, 1))
    rates = np.array([bar_rates(FourBar(), bars[0], 0.05 * s, 0.0) for s in sign])
    return Case(scene, joints(bars), joints(rates[:, 0]), joints(rates[:, 1]), t)


def holding_four_bar(hours=100_000.0 / 3600.0, samples=5000):
    """1e5 s of holding still, at growing steps."""
    scene, joints = four_bar(static=0.35)
    bars = np.tile(bar_angles(FourBar(), 0.9), (samples, 1))
    t = np.linspace(0, 1, samples) ** 2 * hours * 3600.0
    zero = np.zeros((samples, 3))
    return Case(scene, joints(bars), zero, zero, t)


# ---------------------------------------------------------------- others


def hinged_weight(line=0.0):
    """A bar held by a cylinder whose line misses the pin by `line` (m); at 0 it cannot hold."""
    model = grounded_model((0.0, -9.81, 0.0))
    add_link(model, 0, pin.JointModelRZ(), pin.SE3.Identity(), "bar", bar(2.0, 0.6))
    cylinder = {
        "name": "ram",
        "a": {"link": "ground", "xyz": [-0.2, line, 0]},
        "b": {"link": "bar", "xyz": [0.3, line, 0]},
    }
    scene = pf.Scene(
        model=model, friction={"bar": pin_friction(0.2, 0.02)}, actuators=[{"cylinder": cylinder}]
    )
    one = np.ones((1, 1))
    return Case(scene, 0 * one, 0.5 * one, 0 * one, known={"moment": 2.0 * 9.81 * 0.3})


def long_chain(joints=60):
    """A hanging chain whose first joint is not driven: a force at its tip holds it instead."""
    model = grounded_model((0.0, -9.81, 0.0))
    parent, friction, drives = 0, {}, []
    for j in range(joints):
        name = f"link_{j:02d}"
        place = pin.SE3.Identity() if j == 0 else shifted(0.1)
        parent = add_link(model, parent, pin.JointModelRZ(), place, name, bar(0.2, 0.1))
        friction[name] = pin_friction(0.2, 0.005)
        if j:
            drives.append({"joint": name})
    tip = {"name": "pull", "link": name, "xyz": [0.1, 0, 0], "direction": [0, 1, 0]}
    scene = pf.Scene(model=model, friction=friction, actuators=[*drives, {"force": tip}])
    rng = np.random.default_rng(1)
    q = rng.uniform(-0.05, 0.05, (4, joints))
    q[:, 0] -= 0.3
    v = np.tile(rng.normal(size=joints), (4, 1))  # no joint reverses between the samples
    return Case(scene, q, v, rng.normal(size=(4, joints)))


def slider_crank(angles, mu=0.3, mass=0.8, rate=10.0, gravity=9.81):
    """A piston on a massless crank (0.05 m) and rod (0.15 m), friction at its guide only."""
    r, l = 0.05, 0.15  # noqa: E741
    model = grounded_model((0.0, -gravity, 0.0))
    crank = add_link(model, 0, pin.JointModelRZ(), pin.SE3.Identity(), "crank")
    add_link(model, crank, pin.JointModelRZ(), shifted(r), "rod")
    body = lump(mass, moment=1e-3)
    add_link(model, 0, pin.JointModelPX(), pin.SE3.Identity(), "piston", body)
    guide = {"bearing": {"kind": "guide", "length": 0.06}, "mu": {"static": mu, "kinetic": mu}}
    loop = {
        "name": "wrist",
        "kind": "planar_pin",
        "a": {"link": "rod", "xyz": [l, 0, 0]},
        "b": {"link": "piston"},
    }
    scene = pf.Scene(
        model=model, friction={"piston": guide}, loops=[loop], actuators=[{"joint": "crank"}]
    )
    theta = np.asarray(angles, dtype=float)
    phi = -np.arcsin(r * np.sin(theta) / l)  # the rod's angle from x
    q = np.column_stack([theta, phi - theta, r * np.cos(theta) + l * np.cos(phi)])
    one = np.ones((len(theta), 1))
    v, a = consistent_motion(scene, q, ["crank"], rate * one, 0 * one)
    # piston: m a = H + f, H tan(phi) is the rod's side force, N = |H tan(phi) - m g|
    speed, push = v[:, 2], mass * a[:, 2]
    torque = []
    for i in range(len(theta)):
        found = []
        for side in (1.0, -1.0):  # of the guide that carries
            k = -np.sign(speed[i]) * mu * side  # f = k (H tan(phi) - m g)
            H = (push[i] + k * mass * gravity) / (1 + k * np.tan(phi[i]))
            if side * (H * np.tan(phi[i]) - mass * gravity) >= 0:
                found.append(H * r * (np.sin(phi[i] - theta[i])) / np.cos(phi[i]))
        torque.append(found)
    return Case(scene, q, v, a, known={"torque": torque})


def ball_tripod(mu=0.3, radius=0.02):
    """Two bars on ball joints, a spherical loop, all turning in space: friction as a vector."""
    model = grounded_model((0.0, 0.0, -9.81))
    tilt = pin.SE3(pin.rpy.rpyToMatrix(0.4, 0.2, 0.0), np.zeros(3))
    arm = add_link(model, 0, pin.JointModelRZ(), tilt, "arm", bar(1.0, 0.2))
    parent = arm
    for n, kind in enumerate((pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)):
        place = shifted(0.2) if n == 0 else pin.SE3.Identity()
        name = "rod" if n == 2 else f"cross_{n}"
        parent = add_link(model, parent, kind(), place, name, bar(0.7, 0.5) if n == 2 else None)
    place = pin.SE3(np.eye(3), np.array([0.45, 0.1, 0.0]))
    add_link(model, 0, pin.JointModelRY(), place, "rocker", bar(0.8, 0.3))
    ball = {
        "bearing": {"kind": "ball", "radius": radius},
        "mu": {"static": 1.2 * mu, "kinetic": mu},
    }
    loop = {
        "name": "ball",
        "kind": "spherical",
        "a": {"link": "rod", "xyz": [0.5, 0, 0]},
        "b": {"link": "rocker", "xyz": [0.3, 0, 0]},
    }
    scene = pf.Scene(
        model=model,
        loops=[loop],
        friction={"ball": ball, "rocker": pin_friction(mu, radius)},
        actuators=[{"joint": "arm"}, {"joint": "rod"}],
    )
    q = np.array(
        [
            scene.close(np.array([0.2, 0.1, -0.5, 0.3, -1.2]) + d, ["arm"])
            for d in 0.05 * np.arange(4)[:, None]
        ]
    )
    rng = np.random.default_rng(3)
    v, a = consistent_motion(
        scene, q, ["arm", "rod"], rng.normal(size=(4, 2)), rng.normal(size=(4, 2))
    )
    return Case(scene, q, v, a)


def reversing_ball(viscous):
    """The same place four times at rates 3, 1, -1, -2: of equal speeds the first marks the turn."""
    case = ball_tripod()
    ball = {**case.scene.friction["ball"].model_dump(exclude_none=True), "viscous": viscous}
    scene = case.scene.with_(friction={"ball": ball, "rocker": pin_friction(0.3, 0.02)})
    rates = np.array([3.0, 1.0, -1.0, -2.0])[:, None] * case.v[1, [0, 3]]
    q = np.tile(case.q[1], (4, 1))
    v, a = consistent_motion(scene, q, ["arm", "rod"], rates, np.ones((4, 2)))
    return Case(scene, q, v, a, np.arange(4.0))


def painleve_rod(mu, angle, mass=1.0, length=0.6, speed=1.0, g=9.81):
    """A uniform rod hinged to a massless slider on a rough guide, pushed along by it (Painleve).

    Slider along x; the rod hangs below it at `angle` from the guide (rad). Without friction the
    guide pushes with N_0 = free; with it N (1 - mu / mu_crit) = N_0, mu_crit = (1 + 3 cos^2 t) / (3
    sin t cos t) where the friction tilts the rod into the guide.
    """
    model = grounded_model((0.0, -g, 0.0))
    slider = add_link(model, 0, pin.JointModelPX(), pin.SE3.Identity(), "slider")
    rod = bar(mass, length, 0.0, 0.0)
    add_link(model, slider, pin.JointModelRZ(), pin.SE3.Identity(), "rod", rod)
    guide = {"bearing": {"kind": "guide", "length": 0.1}, "mu": {"static": mu, "kinetic": mu}}
    scene = pf.Scene(model=model, friction={"slider": guide})
    free = mass * g / (1 + 3 * np.cos(angle) ** 2)
    q, v = np.array([[0.0, -angle]]), np.array([[speed, 0.0]])
    return Case(scene, q, v, 0 * v, known={"free": free})


def boxer(cylinders=2, angle=0.0, rate=0.0, mu=0.1, brake=0.05):
    """Opposed pistons on one crank without gravity; both are at their dead centres at once.

    Args:
        cylinders: 1 leaves one piston out. angle, rate: of the crank (rad, rad/s).
        brake: constant friction of the crank (N m).
    """
    model = grounded_model((0.0, 0.0, 0.0))
    crank = add_link(model, 0, pin.JointModelRZ(), pin.SE3.Identity(), "crank", bar(1.0, 0.2, -0.1))
    friction = {"crank": dry(brake)}
    loops, guess = [], [angle]
    guide = {
        "bearing": {"kind": "guide", "length": 0.1, "width": 0.1},
        "mu": {"static": mu, "kinetic": mu},
    }
    tilt = -np.arcsin(0.1 / 0.3 * np.sin(angle))
    for k, side in ((1, 1.0), (2, -1.0))[:cylinders]:
        add_link(model, crank, pin.JointModelRZ(), shifted(side * 0.1), f"rod_{k}", bar(0.4, 0.3))
        turned = pin.SE3(pin.rpy.rpyToMatrix(0, 0, 0 if side > 0 else np.pi), np.zeros(3))
        body = lump(0.5, moment=1e-3)
        add_link(model, 0, pin.JointModelPX(), turned, f"piston_{k}", body)
        loops.append(
            {
                "name": f"wrist_{k}",
                "kind": "planar_pin",
                "a": {"link": f"rod_{k}", "xyz": [0.3, 0, 0]},
                "b": {"link": f"piston_{k}"},
            }
        )
        friction |= {
            f"rod_{k}": pin_friction(mu),
            f"piston_{k}": guide,
            f"wrist_{k}": pin_friction(mu),
        }
        guess += [
            tilt + (0.0 if side > 0 else np.pi) - angle,
            0.1 * np.cos(angle) + 0.3 * np.cos(tilt),
        ]
    scene = pf.Scene(model=model, friction=friction, loops=loops, actuators=[{"joint": "crank"}])
    q0 = pin.neutral(model)
    names = ["crank", *(f"{part}_{k}" for k in (1, 2)[:cylinders] for part in ("rod", "piston"))]
    for name, position in zip(names, guess, strict=True):
        q0[model.joints[model.getJointId(name)].idx_q] = position
    q = scene.close(q0, ["crank"])[None]
    v, a = consistent_motion(scene, q, ["crank"], np.array([[rate]]), np.zeros((1, 1)))
    return Case(scene, q, v, a)
