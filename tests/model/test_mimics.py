"""Mimic joints against a projection of the robot without them, and locked joints."""

import itertools
import re
import warnings

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from robot_cases import INERTIA, joint, link, urdf

from pinfric.errors import PinfricWarning, RobotError
from pinfric.model.mimics import fix_joint
from pinfric.model.robot import mass_matrix, read_robot
from pinfric.model.urdf_file import read_xml

AXES = ("1 0 0", "0 0.6 0.8", "0 0 2")


def hinge(name, parent, child, kind, axis, mimic=""):
    place = f'<origin xyz="0.3 {0.1 * len(name)} -0.2" rpy="0.3 -1.1 0.7"/>'
    limit = '<limit lower="-3" upper="3" effort="9" velocity="2"/>'
    limit = limit if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'{place}<axis xyz="{axis}"/>{limit}{mimic}</joint>'
    )


def random_mimics(seed):
    """A random tree whose joints follow one another in chains; each joint's leader, k and o."""
    rng = np.random.default_rng(seed)
    names = [str(name) for name in rng.permutation(list("abcdefgh"))]
    parts, laws, links = [], {}, ["base"]
    for row, name in enumerate(names):
        mimic = ""
        leads = [n for n in names[:row] if rng.random() < 0.5]
        if leads:
            k = float(rng.choice([-2.0, -0.5, 0.0, 0.05, 3.0], p=[0.3, 0.2, 0.1, 0.2, 0.2]))
            laws[name] = (leads[0], k, float(rng.choice([0.0, 0.4])))
            mimic = '<mimic joint="{}" multiplier="{}" offset="{}"/>'.format(*laws[name])
        kind = str(
            rng.choice(["revolute", "continuous", "prismatic", "fixed"], p=[0.4, 0.3, 0.2, 0.1])
        )
        parent = str(rng.choice(links))
        parts += [
            link(f"l_{name}"),
            hinge(name, parent, f"l_{name}", kind, rng.choice(AXES), mimic),
        ]
        links.append(f"l_{name}")
        if kind == "fixed":
            laws.pop(name, None)
    # the order of the file says nothing: a leader may stand on a branch that is visited later
    return [parts[i] for i in rng.permutation(len(parts))], laws, rng


@pytest.mark.parametrize("seed", range(60))
def test_mimics_are_a_projection_of_the_robot_without_them(tmp_path, seed):
    """q = K q_leaders + o: effort K^T rnea(q, K v, K a), mass matrix K^T M K."""
    parts, laws, rng = random_mimics(seed)
    file = urdf(tmp_path, *parts)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PinfricWarning)
        try:
            model = read_robot(file, {}).model
        except RobotError as problem:
            reason = str(problem)
            assert re.search("carry leaders|which .* carries|no joint of this robot", reason)
            return
    plain = re.sub("<mimic[^>]*/>", "", file.read_text()).replace('"continuous"', '"revolute"')
    plain = re.sub(r"(<axis [^>]*/>)(?!<limit)", r'\1<limit effort="9" velocity="2"/>', plain)
    full = pin.buildModelFromXML(plain)
    moving = list(full.names)[1:]

    # Each joint's place and rate by the leaders' numbers.
    leaders = [n for n in list(model.names)[1:] if n not in laws]
    K, o = np.zeros((len(moving), model.nv)), np.zeros(len(moving))
    places = {name: (K[row], row) for row, name in enumerate(moving)}
    for name in leaders:
        places[name][0][model.joints[model.getJointId(name)].idx_v] = 1.0
    for name, (leader, k, offset) in sorted(laws.items(), key=lambda law: len(chain(law[0], laws))):
        row = places[name][1]
        if leader in places:
            K[row], o[row] = k * K[places[leader][1]], k * o[places[leader][1]] + offset
        else:  # fixed: it stands at 0
            o[row] = offset
    angle, v, a = rng.uniform(-1, 1, (3, model.nv))
    q = pin.integrate(model, pin.neutral(model), angle)
    moved = K @ angle + o
    effort = K.T @ pin.rnea(full, full.createData(), moved, K @ v, K @ a)
    assert_allclose(pin.rnea(model, model.createData(), q, v, a), effort, atol=1e-10)
    M = pin.crba(full, full.createData(), moved)
    M = np.triu(M) + np.triu(M, 1).T
    assert_allclose(mass_matrix(model, q), K.T @ M @ K, atol=1e-10)


def chain(name, laws):
    return [name, *chain(laws[name][0], laws)] if name in laws else [name]


MIMIC = '<mimic joint="{}" multiplier="{}" offset="{}"/>'.format
PAIR = (link("a"), link("b"))


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ([joint("p", "base", "a", more=MIMIC("p", 1, 0))], "'p' mimics itself; one of them must"),
        (
            [
                joint("p", "base", "a", more=MIMIC("q", 1, 0)),
                joint("q", "base", "b", more=MIMIC("p", 1, 0)),
            ],
            "'p' mimics 'q' mimics 'p': a ring; one of them must lead",
        ),
        (
            [joint("p", "base", "a", more=MIMIC("q", 2, 0)), joint("q", "a", "b")],
            "'p' mimics 'q', which 'p' carries: .*; let 'q' mimic 'p'",
        ),
        (
            [joint("p", "base", "a", "planar"), joint("q", "a", "b", more=MIMIC("p", 2, 0))],
            "'q' mimics 'p', and 'p' is planar",
        ),
    ],
)
def test_mimics_that_no_order_can_hold_are_refused(tmp_path, parts, says):
    links = [
        part
        for name, part in zip("ab", PAIR, strict=True)
        if f'child link="{name}"' in "".join(parts)
    ]
    with pytest.raises(RobotError, match=says) as caught:
        read_robot(urdf(tmp_path, *links, *parts), {})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("leader", "law", "where"),
    [("fixed", (3, 0.7), "'q' at 0.7"), ("revolute", (0, -0.2), "'q' at -0.2")],
)
def test_a_follower_of_what_stands_stands_at_its_offset(tmp_path, leader, law, where):
    parts = joint("p", "base", "a", leader), joint("q", "a", "b", more=MIMIC("p", *law))
    turning = link("c"), joint("r", "b", "c")
    with pytest.warns(PinfricWarning, match=where):
        model = read_robot(urdf(tmp_path, *PAIR, *parts, *turning), {}).model
    assert "q" not in list(model.names)
    placement = model.frames[model.getFrameId("b")].placement
    assert_allclose(placement.rotation, pin.rpy.rpyToMatrix(0, 0, law[1]), atol=1e-15)


@pytest.mark.parametrize("seed", range(8))
def test_locked_joints_are_those_of_a_reduced_model(tmp_path, seed):
    """Against `pin.buildReducedModel`, where joints become fixed elsewhere."""
    parts, _, rng = random_mimics(seed)
    file = urdf(tmp_path, *(re.sub("<mimic[^>]*/>", "", part) for part in parts))
    model = read_robot(file, {}).model
    names = list(model.names)[1:]
    locked = {str(n): float(rng.uniform(-3, 3)) for n in rng.permutation(names)[: len(names) - 1]}
    away = np.zeros(model.nv)
    away[[model.joints[model.getJointId(n)].idx_v for n in locked]] = list(locked.values())
    q = pin.integrate(model, pin.neutral(model), away)
    reduced = pin.buildReducedModel(model, [model.getJointId(n) for n in locked], q)
    found = read_robot(file, locked).model
    assert list(found.names) == list(reduced.names)
    assert {f.name for f in found.frames} == {f.name for f in reduced.frames}
    q, v, a = pin.randomConfiguration(reduced), *rng.normal(size=(2, reduced.nv))
    efforts = [pin.rnea(m, m.createData(), q, v, a) for m in (found, reduced)]
    assert_allclose(*efforts, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("locked", "says"),
    [
        ({"q": 0.3}, "locked.q: .* follow 'p', 2 x its position [+]0.1: lock 'p', and it"),
        ({"p": 0.1, "q": 0.4}, "locked.q"),
        ({"p": 0.1, "q": 0.3}, ""),
        ({"p": 0.1}, ""),
    ],
)
def test_a_follower_is_locked_by_its_leader(tmp_path, locked, says):
    parts = joint("p", "base", "a"), joint("q", "base", "b", more=MIMIC("p", 2, 0.1))
    free = (
        link("c"),
        joint("r", "base", "c"),
        link("d"),
        joint("s", "base", "d", more=MIMIC("r", 1, 0)),
    )
    file = urdf(tmp_path, *PAIR, *parts, *free)
    if says:
        with pytest.raises(RobotError, match=says):
            read_robot(file, locked)
        return
    model = read_robot(file, locked).model
    assert list(model.names)[1:] == ["r", "s"]  # the other pair still moves
    turned = model.frames[model.getFrameId("b")].placement.rotation
    assert_allclose(turned, pin.rpy.rpyToMatrix(0, 0, 0.3), atol=1e-15)


def test_fixing_keeps_a_pose_in_which_roll_and_yaw_are_one(tmp_path):
    for pitch, angle in itertools.product((np.pi / 2, -np.pi / 2, 1.570796), (0.0, 0.4, -2.9)):
        text = joint(axis="0.48 0.6 0.64").replace(
            "<axis", f'<origin xyz="1 2 3" rpy="0.3 {pitch!r} -1.2"/><axis'
        )
        root = read_xml(urdf(tmp_path, f'<link name="arm">{INERTIA}</link>', text))
        element = root.find("joint")
        fix_joint(element, angle)
        angles = np.array(element.find("origin").get("rpy").split(), dtype=float)
        expected = pin.rpy.rpyToMatrix(0.3, pitch, -1.2) @ pin.exp3(
            angle * np.array([0.48, 0.6, 0.64])
        )
        assert_allclose(pin.rpy.rpyToMatrix(*angles), expected, atol=1e-15)
