"""One state, asked in many ways: every public function must say the same of it."""

import numpy as np
import pinocchio as pin

import pinfric as pf

#: Fields that one state and a batch of states have.
FIELDS = (
    *("effort_lower", "effort_upper", "effort_frictionless", "normal_load"),
    *("joint_effort_lower", "joint_effort_upper", "motor_torque_lower", "motor_torque_upper"),
    *("friction_lower", "friction_upper", "wrench", "sticking"),
)
#: Speeds are above the 0.02 rad/s (m/s) within which a compensation changes direction.
SLOWEST, FASTEST = 0.15, 1.0
#: Step of central differences, and their error beside the largest derivative.
STEP, DIFFERENCE = 1e-6, 2e-5


def moving_states(scene, rng, count):
    """Return q, v, a in which every joint moves; loops are closed, along with their rates.

    Each loop's start configuration is closed; its drives' joints, if joints drive it, are free.
    """
    model = scene.model
    free = [name for name in scene.actuator_names if name in scene.joint_names]
    free = free if scene.loops else list(scene.joint_names)
    rates = rng.choice([-1.0, 1.0], (count, len(free))) * rng.uniform(
        SLOWEST, FASTEST, (count, len(free))
    )
    accelerations = rng.uniform(-2.0, 2.0, rates.shape)
    if scene.loops:
        q = np.tile(scene.close(scene.start_configuration), (count, 1))
        v, a = pf.consistent_motion(scene, q, free, rates, accelerations)
        return q, v, a
    low, high = (
        np.clip(x, -2.0, 2.0) for x in (model.lowerPositionLimit, model.upperPositionLimit)
    )
    q = np.array([low + rng.uniform(0.1, 0.9, model.nq) * (high - low) for _ in range(count)])
    return np.array([pin.normalize(model, x) for x in q]), rates, accelerations


def judge_states(name, ledger, _folder, count=4, seed=0):
    """Compare all that is said of a bundled scene's moving and resting states."""
    judge_scene(ledger, name, pf.load_scene(name), count, seed)


def judge_massless(ledger, _folder):
    """Compare what is said of a joint that moves no mass, behind one that does."""
    link = pin.Inertia(1.0, np.array([0.1, 0.0, 0.0]), 0.01 * np.eye(3))
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "arm")
    model.appendBodyToJoint(arm, link, pin.SE3.Identity())
    model.addJoint(arm, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.0])), "tip")
    scene = pf.Scene(model=model, friction={name: {"coulomb": 0.1} for name in ("arm", "tip")})
    solver, q, v, a = scene.solver(), np.zeros(2), np.array([0.5, 0.5]), np.zeros(2)
    found = solver.inverse_derivatives(q, v, a).effort_lower.dtau_da
    for j, unit in enumerate(np.eye(2)):
        ends = [solver.inverse(q, v, x).effort_lower.copy() for x in (a + unit, a)]
        where = f"a joint without mass, by the acceleration of {('arm', 'tip')[j]}"
        ledger.same(
            *("a joint without mass: derivatives", where),
            *(found[:, j], ends[0] - ends[1], 1e-9, 0.01),
        )


def judge_scene(ledger, name, scene, count=4, seed=0):
    """Compare all that is said of a scene's moving and resting states."""
    rng, solver = np.random.default_rng(seed), scene.solver()
    q, v, a = moving_states(scene, rng, count)
    batch = pf.inverse_dynamics(scene, q, v, a)
    _many_ways(ledger, name, scene, solver, (q, v, a), batch)
    _there_and_back(ledger, name, scene, solver, (q, v, a), batch)
    if _open(scene):
        _compensation(ledger, name, scene, solver, (q, v, a), batch)
        if not scene.springs:
            _derivatives(ledger, name, scene, solver, (q, v, a), batch)
    if _open(scene) or len(scene.drives) == 1:  # else intervals of drives are no box
        _rest(ledger, name, scene, solver, rng, q)


def _open(scene):
    """Whether it is an open chain whose drives are at its joints."""
    return not scene.loops and all(name in scene.joint_names for name in scene.actuator_names)


def _many_ways(ledger, name, scene, solver, states, batch):
    q, v, a = states
    ledger.holds("result.check()", name, batch.check().passed(1e-8), str(batch.check()))
    for field in FIELDS:
        whole = getattr(batch, field)
        if whole is None:
            continue
        parts = [getattr(part, field) for part in pf.inverse_dynamics(scene, q, v, a, chunks=2)]
        threaded = getattr(pf.inverse_dynamics(scene, q, v, a, threads=2), field)
        ledger.same("batch = chunks", f"{name} {field}", whole, np.concatenate(parts), 1e-12)
        ledger.same("batch = threads", f"{name} {field}", whole, threaded, 1e-12)
    for k in range(len(q)):
        one = solver.inverse(q[k], v[k], a[k])
        for field in FIELDS:
            ours, theirs = getattr(one, field), getattr(batch, field)
            if ours is not None and theirs is not None:
                where = f"{name} state {k} {field}"
                ledger.same("Solver.inverse = batch", where, ours, theirs[k], 1e-10)
    if _open(scene) and batch.wrench is not None:
        wrenches = pf.joint_wrenches(scene, q, v, a)
        places = [scene.joint_names.index(site) for site in scene.site_names]
        ledger.same("joint_wrenches = inverse", name, wrenches[:, places], batch.wrench, 1e-9)


def _there_and_back(ledger, name, scene, solver, states, batch):
    q, v, a = states
    for k in np.flatnonzero(batch.status == 0):
        where = f"{name} state {k}"
        effort = 0.5 * (batch.effort_lower[k] + batch.effort_upper[k])
        ledger.same(
            "a moving joint has one effort", where, batch.effort_lower[k], batch.effort_upper[k]
        )
        torque = 0.5 * (batch.motor_torque_lower[k] + batch.motor_torque_upper[k])
        named = dict(zip(scene.actuator_names, effort, strict=True))
        back = pf.forward_dynamics(scene, q[k], v[k], effort)
        ledger.same("forward of inverse = a", where, back.a, a[k], 1e-7)
        answers = {
            "Solver.forward = forward": solver.forward(q[k], v[k], effort),
            "efforts by name = in order": pf.forward_dynamics(scene, q[k], v[k], named),
        }
        if all(drive.transmission is not None for drive in scene.drives):
            answers["forward of motor torques = a"] = solver.forward(
                q[k], v[k], motor_torque=torque
            )
        for kind, answer in answers.items():
            ledger.same(kind, where, answer.a, a[k], 1e-7)
        if k < 2:
            motion = pf.simulate(scene, q[k], v[k], effort, 2e-3)
            ledger.same("simulate begins with forward's a", where, motion.a[0], a[k], 1e-6)
            along = pf.inverse_dynamics(scene, motion.q, motion.v, motion.a)
            ledger.same(
                "inverse along simulate = its efforts",
                where,
                0.5 * (along.effort_lower + along.effort_upper),
                motion.effort,
                1e-6,
            )


def _compensation(ledger, name, scene, solver, states, batch):
    """joint_effort = rigid + r^2 J a + friction, with friction = compensate."""
    q, v, a = states
    if not scene.one_drive_each:
        return
    for k in range(len(q)):
        whole = 0.5 * (batch.joint_effort_lower[k] + batch.joint_effort_upper[k])
        where = f"{name} state {k}"
        told = solver.joint_effort(q[k], v[k], a[k])
        ledger.same("Solver.joint_effort = inverse", where, told, whole, 1e-9)
        rotors = np.array(
            [
                0.0 if gear is None else gear.ratio**2 * (gear.rotor_inertia or 0.0)
                for gear in (drive.transmission for drive in scene.drives)
            ]
        )
        rigid = batch.effort_frictionless[k] + rotors * batch.actuator_acceleration[k]
        friction = solver.compensate(q[k], v[k], a[k], batch.actuator_velocity[k])
        ledger.same("compensate = inverse", where, rigid + friction, whole, 1e-9)


def _derivatives(ledger, name, scene, solver, states, batch):
    model, nv = scene.model, scene.model.nv

    def differences(function, q, v, x):
        columns = []
        for block in range(3):
            for j in range(nv if block < 2 else len(x)):
                ends = []
                for step in (STEP, -STEP):
                    given = [q, v.copy(), x.copy()]
                    if block == 0:
                        given[0] = pin.integrate(model, q, step * np.eye(nv)[j])
                    else:
                        given[block][j] += step
                    ends.append(np.array(function(*given)))
                columns.append((ends[0] - ends[1]) / (2.0 * STEP))
        return np.array(columns).T

    for k in range(2):
        q, v, a = (x[k] for x in states)
        for field in ("effort_lower", "joint_effort_upper", "motor_torque_lower"):
            found = solver.inverse_derivatives(q, v, a)
            expected = differences(
                lambda *state, field=field: getattr(solver.inverse(*state), field), q, v, a
            )
            blocks = np.hstack([np.array(part) for part in getattr(found, field)])
            for j, (row, other) in enumerate(zip(blocks, expected, strict=True)):
                if not found.kink[j]:
                    where = f"{name} state {k} {field} drive {j}"
                    ledger.same("inverse_derivatives = differences", where, row, other, DIFFERENCE)
        effort = 0.5 * (batch.effort_lower[k] + batch.effort_upper[k])
        found = solver.forward_derivatives(q, v, effort)
        expected = differences(lambda *state: solver.forward(*state).a, q, v, effort)
        blocks = np.hstack([found.ddq_dq, found.ddq_dv, found.ddq_dtau])
        parts = np.split(np.arange(blocks.shape[1]), [nv, 2 * nv])
        for part, by in zip(parts, ("q", "v", "effort"), strict=True):
            if not found.kink:
                where = f"{name} state {k} by {by}"
                ledger.same(
                    *("forward_derivatives = differences", where),
                    *(blocks[:, part], expected[:, part], DIFFERENCE),
                )


def _rest(ledger, name, scene, solver, rng, q):
    """An interval of inverse dynamics is what `holds` and forward dynamics hold."""
    still = np.zeros((len(q), scene.model.nv))
    rest = pf.inverse_dynamics(scene, q, still, still)
    for k in np.flatnonzero(rest.interval_exact):
        lower, upper, where = rest.effort_lower[k], rest.effort_upper[k], f"{name} rest {k}"
        width = upper - lower
        inside = lower + rng.uniform(0.02, 0.98, width.size) * width
        held = pf.holds(scene, q[k], inside)
        ledger.holds("effort in its interval: holds", where, held.held, f"use {held.use}")
        for kind, answer in {
            "effort in its interval: forward rests": pf.forward_dynamics(
                scene, q[k], still[k], inside
            ),
            "effort in its interval: Solver rests": solver.forward(q[k], still[k], inside),
        }.items():
            ledger.holds(kind, where, np.abs(answer.a).max() < 1e-9, f"a {answer.a}")
        for j in np.flatnonzero(width > 1e-9 * max(np.abs(upper).max(), 1.0)):
            for side, sign in ((upper, 1.0), (lower, -1.0)):
                effort = 0.5 * (lower + upper)
                effort[j] = side[j] + sign * 0.01 * width[j]
                at = f"{where} drive {j} {'+' if sign > 0 else '-'}"
                beyond = pf.holds(scene, q[k], effort)
                ledger.holds("effort beyond it: does not hold", at, not beyond.held)
                moved = solver.forward(q[k], still[k], effort).a
                way = moved[scene.drives[j].velocity_index] * sign
                ledger.holds("effort beyond it: moves that way", at, way > 0.0, f"a {moved}")
                effort[j] = side[j]
                use = pf.holds(scene, q[k], effort).use
                ledger.same("effort at its end: use 1", at, use, 1.0, 1e-6)
        low, high = rest.motor_torque_lower[k], rest.motor_torque_upper[k]
        if all(drive.transmission is not None for drive in scene.drives):
            torque = low + rng.uniform(0.02, 0.98, low.size) * (high - low)
            answer = pf.holds(scene, q[k], motor_torque=torque)
            ledger.holds("motor torque in its interval: holds", where, answer.held)
            moved = pf.forward_dynamics(scene, q[k], still[k], motor_torque=torque).a
            ledger.holds(
                "motor torque in its interval: forward rests", where, np.abs(moved).max() < 1e-9
            )
