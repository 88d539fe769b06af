"""Logs of robots that no candidate law describes, which intervals must not hide.

Each case alters the UR5 of identify_cases.py, or its measurement, in one way; coefficients keep
their true values, so coverage is counted as without the change.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from identify_cases import (
    BACK_EFFICIENCY,
    COULOMB,
    EFFICIENCY,
    MU,
    NAMES,
    RATIO,
    ROTOR,
    VISCOUS,
    Motion,
    excitation,
    guess,
    logged,
    motor_effort,
    truth,
    with_static,
)
from scipy.signal import lfilter

import pinfric as pf
from pinfric.identification.identify import Identified
from pinfric.identification.laws import Law

#: A motion as encoders show it, and what the motors deliver, (T, 6) N m.
Simulated = tuple[Motion, np.ndarray]

#: Static friction over kinetic, and rad/s at which 1/e of the difference is left.
STATIC, FALL = 1.5, 0.2
#: Share of Coulomb friction that changes with the angle.
POSITION = 0.2
#: Hz of a filter of first order in the drive; rad of play; share of Coulomb friction; kg.
FILTER, PLAY, OFFSET, PAYLOAD = 5.0, 4e-3, 0.3, 3.0


@cache
def stribeck_truth(velocity: float = FALL, exponent: float = 2.0) -> pf.Scene:
    """The robot with friction that falls from rest to motion."""
    return with_static(STATIC, stribeck={"velocity": velocity, "exponent": exponent})


@cache
def falling_truth() -> pf.Scene:
    """The robot with gears at lift and elbow that lose 30 % at rest and 5 % in motion."""
    friction, drive = dict(truth().friction), {"ratio": RATIO, "rotor_inertia": ROTOR[1]}
    for name in NAMES[1:3]:
        own = {key: x for key, x in friction[name] if key in ("coulomb", "viscous")}
        own |= {"bearing": {"kind": "gear"}, "mu": {"static": 0.3, "kinetic": 0.05}}
        friction[name] = own | {"stribeck": {"velocity": FALL}}
    lift = [{"joint": NAMES[1], "transmission": drive}]
    others = [one for one in truth().actuators if one.joint != NAMES[1]]
    return truth().with_(friction=friction, actuators=others + lift)


def coulomb(v: np.ndarray) -> np.ndarray:
    """Coulomb friction of the truth against a motion, (T, 6)."""
    up, down = np.array(COULOMB).T
    return np.where(v > 0.0, up, -down * (v < 0.0))


def _stribeck(seed: int, motion: Motion) -> Simulated:
    return motion, motor_effort(stribeck_truth(), motion)


def _slow_stribeck(seed: int, motion: Motion) -> Simulated:
    """Friction that falls as exp(-|v|/v_s)."""
    return motion, motor_effort(stribeck_truth(exponent=1.0), motion)


def _falling_load(seed: int, motion: Motion) -> Simulated:
    """Gears that lose a larger share of the torque at rest than in motion."""
    return motion, motor_effort(falling_truth(), motion)


def _warm_up(seed: int, motion: Motion) -> Simulated:
    """Friction that falls by a share while the robot warms up; its mean over time is the truth."""
    cooling = np.exp(-3.0 * motion.t / motion.t[-1])
    share = WARM_UP * (cooling - cooling.mean())[:, None]
    change = share * (coulomb(motion.v) + motion.v * VISCOUS)
    return motion, motor_effort(truth(), motion) + change


def _late(seed: int, motion: Motion) -> Simulated:
    """Efforts that lag behind by more than usual."""
    effort = motor_effort(truth(), motion)
    late = [np.interp(motion.t - LATE, motion.t, y) for y in effort.T]
    return motion, np.column_stack(late)


def _by_angle(seed: int, motion: Motion) -> Simulated:
    """Coulomb friction that changes once per turn of the joint."""
    phase = np.random.default_rng(6000 + seed).uniform(0.0, 2.0 * np.pi, 6)
    change = POSITION * coulomb(motion.v) * np.sin(motion.q + phase)
    return motion, motor_effort(truth(), motion) + change


def _by_motor_turn(seed: int, motion: Motion) -> Simulated:
    """A ripple once per turn of the motor."""
    ripple = POSITION * np.mean(COULOMB, axis=1) * np.sin(RATIO * motion.q)
    return motion, motor_effort(truth(), motion) + ripple


def _filtered(seed: int, motion: Motion) -> Simulated:
    """Efforts behind a first-order low pass."""
    effort = motor_effort(truth(), motion)
    keep = np.exp(-2.0 * np.pi * FILTER * (motion.t[1] - motion.t[0]))
    slow, _ = lfilter([1.0 - keep], [1.0, -keep], effort, axis=0, zi=keep * effort[:1])
    return motion, slow


def _play(seed: int, motion: Motion) -> Simulated:
    """Angles of the motors, which lead the joints by the play on either side."""
    effort = motor_effort(truth(), motion)
    side = np.sign(effort)
    keep = np.exp(-(motion.t[1] - motion.t[0]) / 0.01)  # the play is crossed in some 10 ms
    side, _ = lfilter([1.0 - keep], [1.0, -keep], side, axis=0, zi=keep * side[:1])
    moved = Motion(motion.t, motion.q + 0.5 * PLAY * side, motion.v, motion.a)
    return moved, effort


def _offset(seed: int, motion: Motion) -> Simulated:
    """Sensors whose zeros are off by a share of Coulomb friction."""
    sign = np.random.default_rng(7000 + seed).choice([-1.0, 1.0], 6)
    offset = OFFSET * sign * np.mean(COULOMB, axis=1)
    return motion, motor_effort(truth(), motion) + offset


def _dahl(motion: Motion) -> np.ndarray:
    """Friction that builds up over a way after each reversal (Dahl), as shares (T, 6).

    dz/dx = (sign v - z) / d, so z - sign v falls as exp(-x/d) between reversals.
    """
    z = np.empty_like(motion.v)
    for j, (q, v) in enumerate(zip(motion.q.T, motion.v.T, strict=True)):
        last = 0.0
        for part in np.split(np.arange(v.size), np.flatnonzero(np.diff(np.sign(v))) + 1):
            sign = np.sign(v[part[0]])
            z[part, j] = sign + (last - sign) * np.exp(-np.abs(q[part] - q[part[0]]) / WAY)
            last = z[part[-1], j]
    return z


def _presliding(seed: int, motion: Motion) -> Simulated:
    """Coulomb friction that builds up over some way after a reversal."""
    z, (up, down) = _dahl(motion), np.array(COULOMB).T
    effort = motor_effort(truth(), motion) - coulomb(motion.v)
    return motion, effort + np.where(z > 0.0, up, down) * z


def _lugre(seed: int, motion: Motion) -> Simulated:
    """The same, larger by half at rest than in motion: LuGre's bristles in slow motion."""
    z, (up, down) = _dahl(motion), np.array(COULOMB).T
    effort = motor_effort(truth(), motion) - coulomb(motion.v)
    more = 1.0 + EXCESS * np.exp(-((motion.v / EXCESS_FALL) ** 2))
    return motion, effort + np.where(z > 0.0, up, down) * z * more


def _power(seed: int, motion: Motion) -> Simulated:
    """Friction that grows as a power of the speed, with the coefficients of viscous friction."""
    more = VISCOUS * (np.sign(motion.v) * np.abs(motion.v) ** POWER - motion.v)
    return motion, motor_effort(truth(), motion) + more


def _payload(seed: int, motion: Motion) -> Simulated:
    """An unnamed payload at the last link."""
    box = {"link": "tool0", "mass": PAYLOAD, "com": (0.0, 0.0, 0.1)}
    scene = truth().with_(payloads={"box": box})
    found = pf.inverse_dynamics(
        scene,
        motion.q,
        motion.v,
        motion.a,
        t=motion.t,
        attached=np.ones((motion.t.size, 1), dtype=bool),
    )
    effort = 0.5 * RATIO * (found.motor_torque_lower + found.motor_torque_upper)
    return motion, effort


#: Share of friction that is lost as a robot warms up; s of a further delay; rad over which friction
#: builds up after a reversal; exponent of the speed.
WARM_UP, LATE, WAY, POWER = 0.2, 0.02, 5e-3, 0.67
#: Share of Coulomb friction that is more at rest, and rad/s over which it falls.
EXCESS, EXCESS_FALL = 0.5, 0.2

#: Name -> what a seed makes of a motion.
CASES: dict[str, Callable[[int, Motion], Simulated]] = {
    "true": lambda seed, motion: (motion, motor_effort(truth(), motion)),
    "stribeck": _stribeck,
    "stribeck 1": _slow_stribeck,
    "falling load": _falling_load,
    "position": _by_angle,
    "motor turn": _by_motor_turn,
    "filter": _filtered,
    "play": _play,
    "offset": _offset,
    "payload": _payload,
    "presliding": _presliding,
    "lugre": _lugre,
    "power": _power,
    "warm-up": _warm_up,
    "delay": _late,
}


def wrong_log(case: str, seed: int, duration: float = 60.0, rate: float = 250.0) -> pf.Log:
    """Return a case's log, made at 1 kHz so that values between samples are right."""
    return logged(
        seed, *CASES[case](seed, excitation(seed, duration, 1000.0)), every=round(1000.0 / rate)
    )


@cache
def found(case: str, stribeck: bool = False, seed: int = 21) -> Identified:
    """A log of a case, with the truth's own laws."""
    loads = {1: "gear", 2: "bearing"}
    laws = {name: Law(load=loads.get(j, ""), stribeck=stribeck) for j, name in enumerate(NAMES)}
    scene = guess(seed)
    if case == "payload":  # with masses wrong as well it would be refused
        scene = scene.with_(model=truth().model)
    duration = 30.0 if case in ("true", "position", "offset") else 60.0
    rate = 250.0 if stribeck else 125.0  # where friction falls, a reversal takes 50 ms
    gain = dict.fromkeys(NAMES if case == "payload" else (), 1.0)
    return pf.identify(scene, wrong_log(case, seed, duration, rate), laws=laws, gain=gain)


def hits(one: Identified, stribeck: bool = False) -> dict[str, bool]:
    """Key -> whether its interval holds the true value."""
    known = {
        f"friction.{NAMES[2]}.mu": (MU, MU),
        f"transmission.{NAMES[1]}.efficiency_product": (EFFICIENCY * BACK_EFFICIENCY,) * 2,
    }
    for name, ways, viscous in zip(NAMES, COULOMB, VISCOUS, strict=True):
        known[f"friction.{name}.viscous"] = viscous, viscous
        for way, value in zip(("positive", "negative"), ways, strict=True):
            known[f"friction.{name}.coulomb.{way}"] = value, value
            if stribeck:
                known[f"friction.{name}.coulomb.{way}.static"] = STATIC * value, STATIC * value
        if stribeck:
            known[f"friction.{name}.stribeck.velocity"] = FALL, FALL
    return {
        p.key: p.low <= known[p.key][1] and p.high >= known[p.key][0]
        for p in one.parameters
        if p.key in known
    }
