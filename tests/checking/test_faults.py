"""Deliberate faults of every bundled robot: masses and inertias in other units, and by factors."""

from collections import Counter
from dataclasses import replace

import pytest

from pinfric.checking.findings import Severity
from pinfric.checking.links import link_findings
from pinfric.checking.robot import RobotFacts
from pinfric.errors import RobotError
from pinfric.model.robot import example_robot_data

#: Fault -> factors on masses and inertias, the kind of finding, the unit that is right, and how
#: many robots it is found in: of 60 with their shapes, of 61 without; how many are given another
#: unit, in both.
FAULTS = {
    "none": ((1, 1), "masses", "none", (0, 0), (0, 0)),
    "masses in g": ((1e3, 1e3), "masses", "in g:", (60, 60), (0, 0)),
    "masses in t": ((1e-3, 1e-3), "masses", "in t:", (60, 60), (0, 2)),
    "masses x 0.1": ((0.1, 0.1), "masses", "none", (56, 26), (0, 0)),
    "masses x 0.2": ((0.2, 0.2), "masses", "none", (32, 12), (0, 0)),
    "masses x 10": ((10, 10), "masses", "none", (52, 30), (0, 0)),
    "masses in lb": ((2.2046, 2.2046), "masses", "none", (0, 0), (0, 0)),
    "inertias in kg mm^2": ((1, 1e6), "large inertia", "in kg mm^2", (60, 61), (2, 0)),
    "inertias in g mm^2": ((1, 1e9), "large inertia", "in g mm^2", (60, 61), (0, 0)),
    "inertias in kg cm^2": ((1, 1e4), "large inertia", "in kg cm^2", (60, 56), (5, 0)),
}
#: What the robots have as they are: one drone, whose propellers are discs.
AS_THEY_ARE = {("iris", "masses")}
DOUBTS = {"no mass", "masses", "equal masses", "lengths"}


def faulty(facts, factors):
    changed = replace(facts)
    bodies = facts.bodies.items()
    changed.__dict__["bodies"] = {n: (factors[0] * m, factors[1] * J) for n, (m, J) in bodies}
    return list(link_findings(changed))


@pytest.fixture(scope="module")
def robots():
    found = []
    for file in sorted(example_robot_data().rglob("*.urdf")):
        try:
            facts = RobotFacts.of(file)
        except RobotError:
            continue
        found.append((facts, list(link_findings(facts))))
    return found


@pytest.mark.slow
def test_robots_as_they_are_are_believed(robots):
    found = {(facts.urdf.stem, f.kind) for facts, said in robots for f in said if f.kind in DOUBTS}
    assert found - {(name, "no mass") for name, _ in found} == AS_THEY_ARE


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_deliberate_faults_are_found_with_their_unit(robots, fault):
    """Of robots with three joints or more whose masses are not doubted as they are."""
    factors, kind, unit, found, misled = FAULTS[fault]
    counts = Counter()
    for facts, said in robots:
        moving = facts.moving_joints
        for shaped in (True, False):
            given = facts if shaped else replace(facts, extents={})
            own = said if shaped else list(link_findings(given))
            if moving < 3 or {finding.kind for finding in own} & DOUBTS:
                continue
            alike = [f for f in faulty(given, factors) if f.kind == kind]
            more = len(alike) > sum(f.kind == kind for f in own)
            counts[shaped, "robots"] += 1
            counts[shaped, "found"] += more
            counts[shaped, "misled"] += any(f.if_unit and unit not in f.if_unit for f in alike)
            if more and fault in ("masses in g", "masses in t") and shaped:
                assert {f.severity for f in alike} == {Severity.ERROR}
    assert (counts[True, "robots"], counts[False, "robots"]) == (60, 61)
    assert (counts[True, "found"], counts[False, "found"]) == found
    assert (counts[True, "misled"], counts[False, "misled"]) == misled
