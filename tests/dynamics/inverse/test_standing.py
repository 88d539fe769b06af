"""Standing without known forces: the range of each effort, and the least forces.

Judges: random forces inside the true cones, and a program in another form (halfspaces of forces at
points that this file places with Pinocchio) by another method.
"""

from io import StringIO

import numpy as np
import pinocchio as pin
import pytest
from rich.console import Console
from scipy.optimize import linprog, minimize
from standing_cases import FEET, biped, squat

import pinfric as pf
from pinfric.dynamics.inverse.standing import SIDES, needs_forces, stand
from pinfric.errors import SceneError, StateError
from pinfric.model.described import in_json
from pinfric.show.inverse_summary import inverse_summary
from pinfric.show.report.inverse import inverse_report

pytestmark = pytest.mark.filterwarnings("ignore::pinfric.errors.PinfricWarning")
MU, LENGTH, WIDE = 0.5, 0.2, 0.1
SOLES = f"{{mu: {MU}, length: {LENGTH}, width: {WIDE}}}"
MORE = f"feet: {{left_foot: {SOLES}, right_foot: {SOLES}}}\n"


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    scene = pf.load_scene(biped(tmp_path_factory.mktemp("stand"), more=MORE))
    motion = squat(scene, count=21).motion
    return scene, motion, stand(scene, motion)


def corners(model, q):
    """Jacobians (24, nv) in the world's axes of the eight corners of the soles."""
    data, rows = model.createData(), []
    pin.computeJointJacobians(model, data, q)
    pin.framesForwardKinematics(model, data, q)
    for foot in FEET:
        frame = model.frames[model.getFrameId(foot)]
        for x in (-LENGTH / 2, LENGTH / 2):
            for y in (-WIDE / 2, WIDE / 2):
                place = data.oMf[model.getFrameId(foot)].act(np.array([x, y, 0.0]))
                J = pin.getJointJacobian(model, data, frame.parentJoint, pin.WORLD)
                rows.append(J[:3] - pin.skew(place) @ J[3:])
    return np.vstack(rows)


def in_cones(f):
    """Whether forces (n, 8, 3) are inside the cones of friction."""
    return (np.hypot(f[..., 0], f[..., 1]) <= MU * f[..., 2] + 1e-9).all(axis=-1)


def random_forces(J, needed, start, count, rng):
    """Forces (count, 24) inside the cones that balance the base: hit and run from `start`."""
    free = np.linalg.svd(J[:, :6].T)[2][6:]
    found, f = [], start.copy()
    while len(found) < count:
        way = rng.normal(size=len(free)) @ free
        steps = np.linspace(-600, 600, 2401) / np.linalg.norm(way)
        inside = steps[in_cones((f + steps[:, None] * way).reshape(-1, 8, 3))]
        f = f + rng.choice(inside) * way
        found.append(f)
    found = np.array(found)
    np.testing.assert_allclose(found @ J[:, :6], np.tile(needed, (count, 1)), atol=1e-8)
    return found


def inner_start(J, needed):
    """Forces well inside the cones: the largest least margin of the vertical ones, by SciPy."""
    rows = np.zeros((9 * 8, 25))
    for p in range(8):
        for k in range(9):
            angle = 2 * np.pi * k / 9
            rows[9 * p + k, 3 * p : 3 * p + 3] = np.cos(angle), np.sin(angle), -0.9 * MU
            rows[9 * p + k, 24] = 1.0
    equal = np.hstack([J[:, :6].T, np.zeros((6, 1))])
    found = linprog(
        -np.eye(25)[24], rows, np.zeros(72), equal, needed, [(None, None)] * 25, method="highs-ds"
    )
    return found.x[:24]


@pytest.mark.parametrize("sample", [0, 7])
def test_the_range_holds_a_thousand_forces_inside_the_cones(case, sample):
    scene, motion, standing = case
    q, v, a = motion.q[sample], motion.v[sample], motion.a[sample]
    tau, J = pin.rnea(scene.model, scene.model.createData(), q, v, a), corners(scene.model, q)
    rng = np.random.default_rng(sample)
    forces = random_forces(J, tau[:6], inner_start(J, tau[:6]), 1000, rng)
    efforts = (tau - forces @ J)[:, 6:]
    low, high = standing.frictionless_lower[sample], standing.frictionless_upper[sample]
    assert (efforts >= low - 1e-9).all()
    assert (efforts <= high + 1e-9).all()
    assert (np.ptp(efforts, axis=0) > 0.2 * (high - low)).all()  # they wander through the range


@pytest.mark.parametrize("sample", [0, 7, 20])
def test_both_ends_are_those_of_another_program(case, sample):
    scene, motion, standing = case
    q, v, a = motion.q[sample], motion.v[sample], motion.a[sample]
    tau, J = pin.rnea(scene.model, scene.model.createData(), q, v, a), corners(scene.model, q)
    faces = np.zeros((SIDES * 8, 24))
    for p in range(8):  # each face of a pyramid around the cone touches it, between two edges
        for k in range(SIDES):
            angle = 2 * np.pi * (k + 0.5) / SIDES
            faces[SIDES * p + k, 3 * p : 3 * p + 3] = np.cos(angle), np.sin(angle), -MU
    for d in range(6):
        for sign, ends in (1, standing.frictionless_lower), (-1, standing.frictionless_upper):
            found = linprog(
                -sign * J[:, 6 + d],
                faces,
                np.zeros(len(faces)),
                J[:, :6].T,
                tau[:6],
                [(None, None)] * 24,
                method="highs-ipm",
            )
            assert found.success
            assert ends[sample, d] == pytest.approx(tau[6 + d] + sign * found.fun, abs=1e-5)


def test_the_ends_are_attained_by_forces_that_balance(case):
    scene, motion, standing = case
    for d in range(6):
        for forces, name in (standing.lower_forces, "lower"), (standing.upper_forces, "upper"):
            on = {foot: wrench[:, d] for foot, wrench in forces.items()}
            result = pf.inverse_dynamics(scene, motion, external=on)
            assert np.abs(result.base_residual).max() < 1e-6
            end = getattr(standing, f"frictionless_{name}")[:, d]
            np.testing.assert_allclose(result.effort_frictionless[:, d], end, atol=1e-6)
            np.testing.assert_allclose(
                getattr(result, f"effort_{name}")[:, d],
                getattr(standing, f"effort_{name}")[:, d],
                atol=1e-9,
            )


def test_the_least_forces_are_the_least(case):
    """By SciPy's SLSQP on forces in halfspaces; the soles' wrenches are sums over their corners."""
    scene, motion, standing = case
    q, v, a = motion.q[7], motion.v[7], motion.a[7]
    needed = pin.rnea(scene.model, scene.model.createData(), q, v, a)[:6]
    J = corners(scene.model, q)
    inside = {"type": "ineq", "fun": lambda f: MU * f[2::3] - np.hypot(f[::3], f[1::3])}
    balance = {"type": "eq", "fun": lambda f: f @ J[:, :6] - needed}
    start = inner_start(J, needed)
    own = minimize(
        lambda f: f @ f / 1e3, start, constraints=[inside, balance], options={"maxiter": 500}
    ).x
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, q)
    for i, foot in enumerate(FEET):
        R = data.oMf[scene.model.getFrameId(foot)].rotation
        force = R.T @ own.reshape(8, 3)[4 * i : 4 * i + 4].sum(axis=0)
        np.testing.assert_allclose(standing.external[foot][7, :3], force, atol=0.05)
    assert standing.result.balance.share < 1e-9


def test_the_choice_is_labelled_on_the_first_screen(case):
    scene, motion, standing = case
    assert needs_forces(scene, motion) == (not motion.external)
    summary = inverse_summary(standing.result, "squat", standing=standing)
    console = Console(file=StringIO(), width=120)
    console.print(*inverse_report(standing.result, summary), sep="\n")
    said = console.file.getvalue()
    assert "over all forces at the feet within friction" in said
    assert "no forces at the feet are given: the first table is of those with the least sum" in said
    knee = in_json(summary)["standing"][1]
    assert knee["least"] == standing.effort_lower[:, 1].min()
    assert knee["greatest"] == standing.effort_upper[:, 1].max()


@pytest.mark.parametrize(
    ("old", "new", "kind", "says"),
    [
        (MORE, "", SceneError, "write under `feet` on which links the robot stands"),
        ("left_foot:", "left_shank:", StateError, "left_shank is tilted, by|m above"),
        (f"mu: {MU}", "mu: 1e-9", StateError, "no forces within friction at left_foot, right_foot"),
        ("left_foot:", "left_fot:", SceneError, "there is no link 'left_fot'"),
        ("floating: true", "floating: false", SceneError, "the base is fixed"),
    ],
)
def test_what_cannot_stand_is_one_line(tmp_path, old, new, kind, says):
    file = biped(tmp_path, more=MORE)
    file.write_text(file.read_text().replace(old, new))

    def attempt():
        scene = pf.load_scene(file)
        motion = squat(scene, count=11).motion
        if "1e-9" in new:  # a squat needs no friction; a push to the front does
            a = motion.a.copy()
            a[:, 0] += 1.0
            motion = pf.Trajectory.from_arrays(scene, motion.t, motion.q, motion.v, a)
        stand(scene, motion)

    with pytest.raises(kind, match=says) as refused:
        attempt()
    assert "\n" not in str(refused.value)
