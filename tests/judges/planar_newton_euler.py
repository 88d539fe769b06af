"""A four-bar by Newton and Euler in the plane, bar by bar: no pinfric, no Pinocchio.

Ground pins at O = (0, 0) and C = (ground, 0); crank O-A, coupler A-B, rocker C-B. Nine equations of
three bars give the eight components of the pin forces (on the bar named first in `PINS`) and the
crank's torque. The pins' friction mu R |F| is on the right side, repeated until nothing changes.
"""

from dataclasses import dataclass

import numpy as np

#: pin -> (bar it pushes on, bar or ground that pushes).
PINS = {
    "O": ("crank", None),
    "A": ("coupler", "crank"),
    "B": ("rocker", "coupler"),
    "C": ("rocker", None),
}
BARS = ("crank", "coupler", "rocker")


@dataclass(frozen=True)
class FourBar:
    """Lengths (m), masses (kg), gravity (m/s^2), and the friction of every pin."""

    lengths: tuple[float, float, float] = (0.1, 0.35, 0.25)
    ground: float = 0.3
    masses: tuple[float, float, float] = (0.5, 1.2, 0.9)
    gravity: tuple[float, float] = (0.0, -9.81)
    radius: float = 0.01
    mu: float = 0.3


def bar_angles(bar: FourBar, crank: float) -> np.ndarray:
    """(3,) angles of crank, coupler, rocker from +x, open assembly (B above the line A-C)."""
    r1, r2, r3 = bar.lengths
    A = r1 * np.array([np.cos(crank), np.sin(crank)])
    to_C = np.array([bar.ground, 0.0]) - A
    d = np.hypot(*to_C)
    at_A = np.arccos((r2**2 + d**2 - r3**2) / (2 * r2 * d))
    coupler = np.arctan2(to_C[1], to_C[0]) + at_A
    B = A + r2 * np.array([np.cos(coupler), np.sin(coupler)])
    rocker = np.arctan2(B[1], B[0] - bar.ground)
    return np.array([crank, coupler, rocker])


def bar_rates(bar: FourBar, angles: np.ndarray, rate: float, acceleration: float) -> np.ndarray:
    """(2, 3) angular velocities and accelerations of the bars from the crank's."""
    r1, r2, r3 = bar.lengths
    along = np.array([np.cos(angles), np.sin(angles)])
    across = np.array([-along[1], along[0]])
    K = np.column_stack([r2 * across[:, 1], -r3 * across[:, 2]])
    w = np.linalg.solve(K, -r1 * across[:, 0] * rate)
    rates = np.array([rate, *w])
    centripetal = r1 * along[:, 0] * rate**2 + r2 * along[:, 1] * w[0] ** 2
    centripetal -= r3 * along[:, 2] * w[1] ** 2
    a = np.linalg.solve(K, centripetal - r1 * across[:, 0] * acceleration)
    return np.array([rates, [acceleration, *a]])


def crank_torque(
    bar: FourBar, crank: float, rate: float, acceleration: float
) -> tuple[float, dict[str, np.ndarray], dict[str, float]]:
    """Torque of the ground on the crank (N m), pin forces (N) and pin friction torques (N m)."""
    angles = bar_angles(bar, crank)
    w, alpha = bar_rates(bar, angles, rate, acceleration)
    friction, (K, rhs) = dict.fromkeys(PINS, 0.0), _equations(bar, angles, w, alpha)
    torque, before = np.inf, dict[str, float]()
    for _ in range(10_000):
        earlier, before = before, dict(friction)
        torque, forces = _solve(K, rhs, friction)
        for pin, (on, by) in PINS.items():
            slip = w[BARS.index(on)] - (w[BARS.index(by)] if by else 0.0)
            friction[pin] = -np.sign(slip) * bar.mu * bar.radius * np.hypot(*forces[pin])
        change = max(abs(friction[pin] - before[pin]) for pin in PINS)
        if change < 1e-16 or friction == earlier:  # the same, or to and fro by a rounding
            break
    return torque, forces, friction


def _equations(
    bar: FourBar, angles: np.ndarray, w: np.ndarray, alpha: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """K (9, 9) and the right side (9,) without friction, of the pins' forces and the torque."""
    along = np.array([np.cos(angles), np.sin(angles)]).T  # (3 bars, 2)
    across = np.array([-along[:, 1], along[:, 0]]).T
    length = np.array(bar.lengths)[:, None]
    start = np.array([[0.0, 0.0], length[0] * along[0], [bar.ground, 0.0]])
    swing = length * (across * alpha[:, None] - along * w[:, None] ** 2)  # of a bar's end
    base = np.array([[0.0, 0.0], swing[0], [0.0, 0.0]])
    center, acceleration = start + 0.5 * length * along, base + 0.5 * swing
    where = {"O": start[0], "A": start[1], "C": start[2], "B": start[2] + length[2] * along[2]}
    K, rhs = np.zeros((9, 9)), np.zeros(9)
    for b, mass in enumerate(bar.masses):
        inertia = mass * bar.lengths[b] ** 2 / 12
        rhs[3 * b : 3 * b + 2] = mass * (acceleration[b] - np.array(bar.gravity))
        rhs[3 * b + 2] = inertia * alpha[b]
    for p, (pin, (on, by)) in enumerate(PINS.items()):
        for body, sign in ((on, 1.0), (by, -1.0)):
            if body is None:
                continue
            b = BARS.index(body)
            arm = where[pin] - center[b]
            K[3 * b, 2 * p] = K[3 * b + 1, 2 * p + 1] = sign
            K[3 * b + 2, 2 * p] -= sign * arm[1]
            K[3 * b + 2, 2 * p + 1] += sign * arm[0]
    K[2, 8] = 1.0  # the drive turns the crank
    return K, rhs


def _solve(
    K: np.ndarray, rhs: np.ndarray, friction: dict[str, float]
) -> tuple[float, dict[str, np.ndarray]]:
    rhs = rhs.copy()
    for pin, (on, by) in PINS.items():
        rhs[3 * BARS.index(on) + 2] -= friction[pin]
        if by is not None:
            rhs[3 * BARS.index(by) + 2] += friction[pin]
    x = np.linalg.solve(K, rhs)
    return float(x[8]), {pin: x[2 * p : 2 * p + 2] for p, pin in enumerate(PINS)}
