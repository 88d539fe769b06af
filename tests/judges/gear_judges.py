"""Lossy gears with pencil and paper: nothing of pinfric is used.

One joint: t = M a + h leaves the gear (h resists forward motion), u - I a - k v enters it, with u =
ratio T_m, I = ratio^2 J_rotor, k = ratio^2 c_motor. Moving in the direction s,

    u - I a - k v = slope t + s n,    slope = 1/eta where s t > 0 (the motor drives), else eta_b,

n the no-load torque at the joint: Modelica's LossyGear with eta = eta_mf1, eta_b = eta_mf2, n =
tau_bfa, and Coulomb friction tau_bfb at the joint (Pelchen, Schweiger, Otter 2002).
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq


class Gear(NamedTuple):
    """Of one joint, all at the joint: n (N m), I (kg m^2), k (N m s/rad)."""

    eta: float
    eta_b: float
    n: float = 0.0
    inertia: float = 0.0
    drag: float = 0.0


class Stretch(NamedTuple):
    """m v' = A sin(w t) + b + c t - k v from q, v at `start`, until `end`."""

    start: float
    end: float
    q: float
    v: float
    m: float
    amplitude: float = 0.0
    w: float = 1.0
    b: float = 0.0
    c: float = 0.0
    k: float = 0.0

    def at(self, t):
        """q, v at times t: the particular solution, and e^(-k t/m) times the start's offset."""
        v0, q0 = self._particular(self.start)
        v1, q1 = self._particular(t)
        since, off = t - self.start, self.v - v0
        if self.k == 0.0:
            return self.q + q1 - q0 + off * since, v1 + off
        fade = np.expm1(-self.k * since / self.m)
        return self.q + q1 - q0 - off * self.m / self.k * fade, v1 + off * (1.0 + fade)

    def _particular(self, t):
        A, w, m, k = self.amplitude, self.w, self.m, self.k
        alpha, beta = np.array([k, -m * w]) * A / (k**2 + (m * w) ** 2)
        v = alpha * np.sin(w * t) + beta * np.cos(w * t)
        q = (beta * np.sin(w * t) - alpha * np.cos(w * t)) / w
        if k == 0.0:
            return v + self.b / m * t + self.c / m * t**2 / 2, (
                q + self.b / m * t**2 / 2 + self.c / m * t**3 / 6
            )
        rate = self.c / k
        level = (self.b - m * rate) / k
        return v + level + rate * t, q + level * t + rate * t**2 / 2


def follow(stretches, t):
    """q, v (2, n) along stretches at times t, at rest between them."""
    out = np.zeros((2, len(t)))
    for stretch in stretches:
        here = (t >= stretch.start) & (t <= stretch.end)
        out[:, here] = stretch.at(t[here])
        out[0, t > stretch.end] = stretch.at(stretch.end)[0]
        out[1, t > stretch.end] = 0.0
    return out


def sine_against_load(M, gear, amplitude, w, h0, h1, t_end):
    """Motion from rest under u = A sin(w t) against h = h0 + h1 t > 0, which t always is, too.

    Backward the load drives:  (I + eta_b M) a = u - eta_b h + n - k v,
    forward the motor:         (I + M/eta) a   = u - h/eta - n - k v;
    from rest it goes where the right side at v = 0 has that sign.
    """

    def push(direction, t, v=0.0):
        slope = 1.0 / gear.eta if direction > 0 else gear.eta_b
        u = amplitude * np.sin(w * t)
        return u - slope * (h0 + h1 * t) - direction * gear.n - gear.drag * v

    def go(direction, t, q):
        slope = 1.0 / gear.eta if direction > 0 else gear.eta_b
        bend = -slope * h0 - direction * gear.n
        path = Stretch(
            t, t_end, q, 0.0, gear.inertia + slope * M, amplitude, w, bend, -slope * h1, gear.drag
        )
        end = _first(lambda s: -direction * path.at(s)[1], t, t_end)
        return path._replace(end=end)

    t, q, found = 0.0, 0.0, []
    while t < t_end:
        starts = {d: _first(lambda s, d=d: d * push(d, s), t, t_end) for d in (1, -1)}
        if not found:  # it may go at once
            starts |= {d: 0.0 for d in starts if d * push(d, 0.0) > 0}
        direction = min(starts, key=starts.get)
        if starts[direction] >= t_end:
            break
        found.append(go(direction, starts[direction], q))
        t, q = found[-1].end, found[-1].at(found[-1].end)[0]
    return found


def heat(stretches, gear):
    """Losses of gear and drag along stretches of `sine_against_load` (J): (slope - 1) t + n, k v.

    The load's side of the gear carries t = (u - k v - I a - s n)/slope.
    """
    total = 0.0
    for path in stretches:
        way = np.sign(path.at(0.5 * (path.start + path.end))[1])
        slope = 1.0 / gear.eta if way > 0 else gear.eta_b

        def power(t, path=path, way=way, slope=slope):
            v, u = path.at(t)[1], path.amplitude * np.sin(path.w * t)
            a = (u + path.b + path.c * t - path.k * v) / path.m
            carried = (u - gear.drag * v - gear.inertia * a - way * gear.n) / slope
            return ((slope - 1.0) * carried + way * gear.n + gear.drag * v) * v

        total += quad(power, path.start, path.end, epsabs=1e-15, epsrel=1e-13)[0]
    return total


def _first(f, start, end):
    """The first time after `start` at which f turns positive, else `end`."""
    grid = np.linspace(start, end, 4000)[1:]
    values = np.array([f(t) for t in grid])
    crossing = np.flatnonzero((values[:-1] <= 0) & (values[1:] > 0))
    if not len(crossing):
        return end
    return brentq(f, grid[crossing[0]], grid[crossing[0] + 1], xtol=1e-16, rtol=1e-15)


def spun_down(M, gear, v0):
    """A flywheel with the motor off: (I + eta_b M) v' = -n - k v, t = M v' < 0: the load drives."""
    m, k = gear.inertia + gear.eta_b * M, gear.drag
    end = m * v0 / gear.n if k == 0.0 else m / k * np.log1p(k * v0 / gear.n)
    return Stretch(0.0, end, 0.0, v0, m, b=-gear.n, k=gear.drag)


def mesh_reversal(M, gear, v0, u0, u1, t_end):
    """Forward under u = u0 - u1 t: t = M a has the sign of u - n, which it changes once.

    (I + M/eta) a = u - n before, (I + eta_b M) a = u - n after.
    """
    kink = (u0 - gear.n) / u1
    first = Stretch(0.0, kink, 0.0, v0, gear.inertia + M / gear.eta, b=u0 - gear.n, c=-u1)
    q, v = first.at(kink)
    after = Stretch(kink, t_end, q, v, gear.inertia + gear.eta_b * M, b=u0 - gear.n, c=-u1)
    return [first, after]


def break_away(h, gear):
    """(least, greatest) u at which a joint with load h stays at rest."""
    ends = h / gear.eta, gear.eta_b * h
    return min(ends) - gear.n, max(ends) + gear.n


def smoothed(M, h, u, gear, v0, t_end, width, times):
    """q, v (2, n) with s = tanh(v/width) for the direction: stiff, by SciPy, never quite at rest.

    Loss s (n + mu |t|), mu = 1/eta - 1 where s t > 0, 1 - eta_b where s t < 0.
    """

    def rates(t, state):
        s, slopes = np.tanh(state[1] / width), []
        for sign in (1.0, -1.0):
            mu = 1.0 / gear.eta - 1.0 if s * sign > 0 else 1.0 - gear.eta_b
            slopes.append(1.0 + s * sign * mu)
        force = u(t) - gear.drag * state[1] - s * gear.n
        load = h(t)
        # I a + slope (M a + h) = force, the slope by the sign of M a + h
        trial = [(force - slope * load) / (gear.inertia + slope * M) for slope in slopes]
        a = trial[0] if M * trial[0] + load >= 0 else trial[1]
        return [state[1], a]

    found = solve_ivp(
        rates,
        (0.0, t_end),
        [0.0, v0],
        method="Radau",
        rtol=1e-9,
        atol=1e-12,
        t_eval=times,
        max_step=t_end / 100,
    )
    return found.y


def accelerations(M, h, u, v, gears):
    """All a (n,) that obey moving gears on every joint, by trying which side drives in each.

        diag(slope) (M a + h) + I a = u - k v - sign(v) n, slope by the sign of v (M a + h)

    Args:
        M, h: (n, n), (n,) without rotors; h with all else that acts at the joints.
        u, v: (n,), v without zeros.
    """
    inertia, drag = np.diag([g.inertia for g in gears]), np.array([g.drag for g in gears])
    right = u - drag * v - np.sign(v) * [g.n for g in gears]
    found = []
    for drives in product((True, False), repeat=len(gears)):
        slope = np.array(
            [1.0 / g.eta if d else g.eta_b for g, d in zip(gears, drives, strict=True)]
        )
        a = np.linalg.solve(slope[:, None] * M + inertia, right - slope * h)
        if ((np.sign(v) * (M @ a + h) >= 0) == drives).all():
            found.append(a)
    return found


def locks(M, gears):
    """Least eigenvalue of E + I^1/2 M^-1 I^1/2, E = diag(eta_b): above 0, one answer for any u."""
    root = np.sqrt([g.inertia for g in gears])
    inner = root[:, None] * np.linalg.inv(M) * root
    return float(np.linalg.eigvalsh(np.diag([g.eta_b for g in gears]) + inner)[0])
