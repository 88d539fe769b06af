"""Sweeps that draw whole rows of a table."""

import numpy as np
import pytest

import pinfric as pf
from pinfric.errors import SweepError
from pinfric.study.sweep.file import load_sweep
from pinfric.study.sweep.parameters import apply, draw, resolve

SCENE = pf.load_scene("panda_pick_and_place")
JOINT = "panda_joint2"


def swept(tmp_path, text: str, **more):
    (tmp_path / "rows.csv").write_text(text)
    content = {"pinfric_sweep": 1, "samples": 50, "table": str(tmp_path / "rows.csv"), **more}
    entries, source = load_sweep(content)
    targets = resolve(SCENE, entries, source)
    return targets, draw(targets, entries)


def test_rows_stay_together_beside_what_is_drawn_alone(tmp_path):
    text = (
        f"friction.{JOINT}.mu,friction.{JOINT}.viscous\n"
        if SCENE.friction[JOINT].viscous
        else (f"friction.{JOINT}.mu,friction.panda_joint1.mu\n")
    )
    targets, values = swept(
        tmp_path,
        text + "0.5,5\n1,10\n2,20\n",
        parameters={"speed": {"uniform": {"low": 0.5, "high": 1.0}}},
    )
    assert targets[0].name == "speed"
    assert (values[:, 2] == 10.0 * values[:, 1]).all()
    assert set(values[:, 1]) == {0.5, 1.0, 2.0}
    assert np.abs(np.corrcoef(values[:, 0], values[:, 1])[0, 1]) < 0.5


def test_one_direction_and_efficiencies_are_set(tmp_path):
    both = {"static": 2.0, "kinetic": 1.0}
    gear = {
        "ratio": 100,
        "efficiency": 0.9,
        "back_efficiency": 0.8,
        "rotor_inertia": 1e-4,
        "no_load_torque": {"positive": both, "negative": both},
    }
    scene = SCENE.with_(
        friction={JOINT: {"coulomb": {"positive": both, "negative": both}}},
        actuators=[
            {"joint": n, "transmission": gear if n == JOINT else None} for n in SCENE.joint_names
        ],
    )
    names = [
        f"friction.{JOINT}.coulomb.positive",
        f"transmission.{JOINT}.efficiency",
        f"transmission.{JOINT}.no_load_torque.negative",
        f"transmission.{JOINT}.rotor_inertia",
    ]
    (tmp_path / "rows.csv").write_text(",".join(names) + "\n3,0.7,4,5\n")
    entries, source = load_sweep(
        {"pinfric_sweep": 1, "samples": 1, "table": str(tmp_path / "rows.csv")}
    )
    targets = resolve(scene, entries, source)
    changed, _ = apply(scene, None, targets, draw(targets, entries)[0])
    coulomb = changed.friction[JOINT].coulomb
    assert (coulomb.positive.static, coulomb.negative.static) == (6.0, 2.0)
    found = next(d for d in changed.drives if d.name == JOINT).transmission
    assert (found.efficiency, found.back_efficiency, found.rotor_inertia) == (0.7, 0.8, 5e-4)
    assert (found.no_load_torque.positive.kinetic, found.no_load_torque.negative.kinetic) == (1, 4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("friction.elbow.mu\n1\n", "friction.elbow.mu: there is no joint"),
        (f"friction.{JOINT}.mu\n1\nx\n", "row 2 has no finite number"),
        (f"friction.{JOINT}.mu\n-1\n", "must be 0 or more"),
        (f"transmission.{JOINT}.efficiency\n1.2\n", "at most 1"),
        (f"friction.{JOINT}.mu\n", "has no rows"),
        ("", "cannot be read"),
    ],
)
def test_tables_that_cannot_be_are_refused(tmp_path, text, said):
    with pytest.raises(SweepError, match=said):
        swept(tmp_path, text)


def test_a_table_is_no_design(tmp_path):
    with pytest.raises(SweepError, match="drawn at random"):
        swept(tmp_path, "speed\n1\n", sampling="sobol", samples=8)
    with pytest.raises(SweepError, match="`parameters` or `table` is missing"):
        load_sweep({"pinfric_sweep": 1, "samples": 3})
