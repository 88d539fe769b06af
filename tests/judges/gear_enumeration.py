"""Is every refusal of forward dynamics with gears a true one? Random states, and an enumeration.

    python tests/judges/gear_enumeration.py arms 20000
    python tests/judges/gear_enumeration.py locking 1000
    python tests/judges/gear_enumeration.py ur10 50000

No code is shared with pinfric's solvers: for every choice of stick and slip at rest, and of the
driving and the driven line of every moving gear, accelerations follow from one linear system, and
loads of bearings, by RNEA, are repeated until they stay. Kept is what obeys its signs and limits.
"""

import sys
from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin

if __name__ == "__main__":
    TESTS = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(TESTS), str(TESTS / "helpers")]
from builders import geared_arm
from judges.plain_laws import plain_normal_load

import pinfric as pf
from pinfric.errors import AmbiguousAcceleration, GearJam, NoConsistentAcceleration

#: What rounding leaves of a sign or of a limit, of the forces and of the accelerations there.
ROUNDING = 1e-9


class Arm:
    """An open chain of one-degree joints as plain numbers, one row each."""

    def __init__(self, scene, attached=()):
        self.model = scene.loaded_model(attached)
        self.data, n = self.model.createData(), self.model.nv
        self.sites = {site.velocity_index: site for site in scene.sites}
        self.mu, self.coulomb, self.no_load = np.zeros((3, 2, n))  # kinetic, static
        self.viscous, self.ratio, self.rotor, self.drag = np.zeros((4, n))
        self.forth, self.back = np.ones((2, n))
        for j, site in self.sites.items():
            law = site.friction
            for kept, given in ((self.mu, law.mu), (self.coulomb, law.coulomb)):
                if given is not None:
                    kept[:, j] = given.kinetic, given.static
            self.viscous[j] = law.viscous.coefficient if law.viscous else 0.0
        for drive in scene.drives:
            j, gear = drive.velocity_index, drive.transmission
            size = self.ratio[j] = gear.ratio
            self.rotor[j] = size**2 * gear.rotor_inertia
            self.forth[j], self.back[j] = gear.efficiency, gear.back_efficiency
            self.drag[j] = size**2 * gear.motor_viscous.coefficient if gear.motor_viscous else 0.0
            if gear.no_load_torque is not None:
                term = gear.no_load_torque
                rows = term.rows(None)[0][1].forward, term.at_rest().forward
                self.no_load[:, j] = np.abs(size) * np.array(rows)
        self.inertia = np.diag(self.mass_matrix(pin.neutral(self.model))).max()
        self.loses = (self.forth < 1.0) | (self.back < 1.0) | self.no_load.any(axis=0)
        self.dry = self.loses | self.mu.any(axis=0) | self.coulomb.any(axis=0)

    def mass_matrix(self, q):
        """M (n, n) by RNEA: Pinocchio's CRBA assumes that joints are numbered depth first."""
        still = np.zeros(self.model.nv)
        h = pin.rnea(self.model, self.data, q, still, still).copy()
        columns = [pin.rnea(self.model, self.data, q, still, a) - h for a in np.eye(len(h))]
        return np.transpose(columns)

    def loads(self, q, v, a):
        """(n,) normal loads at accelerations, and the generalized efforts."""
        effort = pin.rnea(self.model, self.data, q, v, a)
        load = np.zeros(len(v))
        for j in np.flatnonzero(self.mu.any(axis=0)):
            wrench = self.data.f[int(j) + 1].vector.copy()
            load[j] = plain_normal_load(self.sites[int(j)], wrench, 0.0)
        return load, effort.copy()

    def holds(self, u, effort, limit, slack):
        """(n,) bool: whether gears at rest hold an effort t that bearings leave them.

        At rest F_-(t) <= u <= F_+(t), lines below and above the t axis. A gear that locks itself
        holds u = 0 at any t, so one such t counts; it is farthest from zero at an end of what
        bearings leave.
        """
        low, high = u - self.no_load[1], u + self.no_load[1]
        least = np.where(low > 0.0, low * self.forth, low / self.back)
        most = np.where(high > 0.0, high / self.back, high * self.forth)
        held = (least - limit - slack <= effort) & (effort <= most + limit + slack)
        ends = np.array([effort - limit, effort + limit])
        forward = np.maximum(ends / self.forth, self.back * ends).max(axis=0) + self.no_load[1]
        backward = np.minimum(ends / self.forth, self.back * ends).min(axis=0) - self.no_load[1]
        locked = np.where(u >= 0.0, u <= forward + slack, u >= backward - slack)
        return np.where(self.back < 0.0, locked, held)

    def accelerations(self, q, v, torque, stick_velocity=1e-6):
        """Every (number that slips from rest, a) that obeys the laws."""
        n, found = len(v), []
        M = self.mass_matrix(q)
        h = pin.rnea(self.model, self.data, q, v, np.zeros(n)).copy()
        u = self.ratio * torque
        resting = np.flatnonzero(self.dry & (np.abs(v) <= stick_velocity))
        sides = [(1.0, -1.0) if each else (1.0,) for each in self.loses]
        every = sorted(product((0.0, 1.0, -1.0), repeat=len(resting)), key=np.count_nonzero)
        for ways in every:
            slipping = int(np.count_nonzero(ways))
            if found and slipping > found[-1][0]:
                break  # what slips more is not asked for
            sign = np.sign(v) * self.dry
            sign[resting] = ways
            stuck = np.isin(np.arange(n), resting) & (sign == 0.0)
            lines = [(1.0,) if still else side for still, side in zip(stuck, sides, strict=True)]
            for side in product(*lines):
                a = self._on_lines(q, v, u, M, h, sign, stuck, np.array(side))
                if a is not None:
                    found.append((slipping, a))
        return found

    def _on_lines(self, q, v, u, M, h, sign, stuck, side):
        """The acceleration (n,) in given modes and lines, None where it breaks their laws."""
        slope = np.where(self.loses, np.where(side > 0.0, 1.0 / self.forth, self.back), 1.0)
        push = u - self.drag * v - sign * self.no_load[0]
        moves, load = np.flatnonzero(~stuck), np.zeros(len(v))
        A = (M + np.diag(self.rotor / slope))[np.ix_(moves, moves)]
        size = (np.abs(u) + np.abs(h)).max()
        for passes in range(100):
            friction = -sign * (self.mu[0] * load + self.coulomb[0]) - self.viscous * v
            a = np.zeros(len(v))
            a[moves] = np.linalg.solve(A, (push / slope + friction - h)[moves])
            before, (load, effort) = load, self.loads(q, v, a)
            gap = np.abs(load - before).max()
            if passes == 2 and not self._obeys(
                u, a, effort, load, sign, stuck, slope, push, v, 10.0 * gap + 1e-3 * size
            ):
                return None  # far from it already
            if gap <= 1e-14 * np.abs(load).max():
                break
        slack = ROUNDING * (size + (np.abs(M) @ np.abs(a)).max())
        return a if self._obeys(u, a, effort, load, sign, stuck, slope, push, v, slack) else None

    def _obeys(self, u, a, effort, load, sign, stuck, slope, push, v, slack):
        """Whether gears are on their lines, slipping joints slip, and sticking ones hold."""
        t = (push - self.rotor * a) / slope
        drives = np.where(slope > 1.0, 1.0, -1.0)
        rests = np.abs(v) <= 1e-6
        held = self.holds(u, effort, self.mu[1] * load + self.coulomb[1], slack)
        return bool(
            not (self.loses & ~stuck & (drives * sign * t < -slack)).any()
            and not (rests & (sign * a * self.inertia < -slack)).any()
            and held[stuck].all()
        )


def fewest(found):
    """The accelerations with the fewest slips from rest, each once."""
    least = min((count for count, _ in found), default=0)
    kept = []
    for count, a in found:
        if count == least and not any(np.abs(a - b).max() <= 1e-6 * np.abs(a).max() for b in kept):
            kept.append(a)
    return kept


def judge(solver, arm, q, v, torque, compare=False):
    """What forward dynamics says, and whether it is true: (a or None, the error, true)."""
    try:
        a = solver.forward(q, v, motor_torque=torque).a.copy()
        answers = fewest(arm.accelerations(q, v, torque)) if compare else [a]
        same = len(answers) == 1 and np.allclose(a, answers[0], rtol=1e-7, atol=1e-9)
        return a, None, same
    except GearJam as error:  # by the inertia of its rotor alone, whatever the torques
        return None, error, True
    except (AmbiguousAcceleration, NoConsistentAcceleration) as error:
        several = isinstance(error, AmbiguousAcceleration)
        answers = fewest(arm.accelerations(q, v, torque))
        return None, error, several and len(answers) > 1


def random_arm(seed):
    """An arm whose gears do not lock themselves, a state of it and torques."""
    scene, rng = geared_arm(seed, locks=0.0)
    arm = Arm(scene)
    q = pin.integrate(arm.model, pin.neutral(arm.model), rng.normal(size=arm.model.nv))
    v = rng.normal(size=arm.model.nv) * (rng.random(arm.model.nv) < (0.0, 0.5, 1.0)[seed % 3])
    h = pin.rnea(arm.model, arm.data, q, v, np.zeros(len(v)))
    scale = 0.3 * np.abs(h).max() + 1.0
    return scene, arm, q, v, (h + scale * rng.normal(size=len(v))) / arm.ratio


def locking_arm(seed):
    """An arm at rest, most of its gears self-locking, and torques, half of them with the load."""
    scene, rng = geared_arm(seed, locks=0.8)
    arm = Arm(scene)
    n = arm.model.nv
    q, still = pin.integrate(arm.model, pin.neutral(arm.model), rng.normal(size=n)), np.zeros(n)
    h = pin.rnea(arm.model, arm.data, q, still, still)
    push = rng.choice([-1.0, -0.2, 0.2, 1.0], size=n) * h
    push += 0.5 * (np.abs(h).max() + 1.0) * rng.normal(size=n)
    return scene, arm, q, still, push / arm.ratio


def random_state(arm, rng):
    """A state of the UR10, some of its joints at rest, and torques about those needed."""
    q = rng.uniform(-np.pi, np.pi, 6)
    v = rng.normal(size=6) * (rng.random(6) < rng.choice([0.0, 0.3, 0.6]))
    h = pin.rnea(arm.model, arm.data, q, v, np.zeros(6))
    needed = h + arm.viscous * v + np.sign(v) * arm.coulomb[0]
    return q, v, (needed + 1.5 * arm.coulomb[1] * rng.normal(size=6)) / arm.ratio


def study(kind, count, first=0):
    """(number of states, refusals, those that the enumeration does not confirm)."""
    refused, wrong = 0, []
    if kind == "ur10":
        root = Path(__file__).resolve().parents[2]
        scene = pf.load_scene(root / "robots" / "ur10_machine_tending.yaml")
        arm, solver = Arm(scene, ["blank"]), pf.Solver(scene, ["blank"])
    for seed in range(first, first + count):
        if kind == "ur10":
            q, v, torque = random_state(arm, np.random.default_rng(seed))
        else:
            scene, arm, q, v, torque = (random_arm if kind == "arms" else locking_arm)(seed)
            if kind == "locking" and len(q) > 6:
                continue  # the enumeration takes minutes
            solver = pf.Solver(scene)
        _, error, true = judge(solver, arm, q, v, torque, compare=kind == "locking")
        refused += error is not None
        if not true:
            wrong.append((seed, str(error)))
    return count, refused, wrong


if __name__ == "__main__":
    for start in range(0, int(sys.argv[2]), 500):
        print(start, *study(sys.argv[1], min(500, int(sys.argv[2]) - start), start), flush=True)
