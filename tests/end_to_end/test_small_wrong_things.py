"""Small things that were wrong without a word: an input each, what came out before, what does now.

`before` is what the code gave when the row was written, as measured; a row fails where that is
what it gives again. The parts have tests of their own in their folders.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from builders import block, plane_friction, random_friction, random_states, random_tree
from cases import turning_four_bar
from mechanisms import pin_friction
from sizing_cases import hour_with_a_stall, one_drive, turntable

import pinfric as pf
from pinfric.study.sizing.catalog import Thermal
from pinfric.study.sizing.thermal import winding_cycle


class Row(NamedTuple):
    """What is asked, a function that runs it, and its outcome before and now."""

    what: str
    run: Callable[[], Any]
    before: Any
    now: Any


def intervals_among_random_states() -> float:
    """Share of samples with an interval among states at random speeds, none at rest."""
    model = random_tree(4)
    scene = pf.Scene(model=model, friction=random_friction(model, 4))
    result = pf.inverse_dynamics(scene, *random_states(model, 4, 1000))
    return float((result.effort_lower < result.effort_upper).mean())


def shuffled(chunks: int | None) -> float:
    """Largest change of an effort when the same states come in another order."""
    model = random_tree(4)
    scene = pf.Scene(model=model, friction=random_friction(model, 4))
    states = random_states(model, 4, 100)
    order = np.random.default_rng(0).permutation(100)

    def upper(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        parts = pf.inverse_dynamics(scene, q, v, a, chunks=chunks or 100)
        return np.concatenate([part.effort_upper for part in parts])

    change = upper(*states)[order] - upper(*(x[order] for x in states))
    return float(np.abs(change).max())


def four_bar_to_and_fro() -> int:
    """Intervals of a four-bar's states whose neighbour turns the other way."""
    case = turning_four_bar(40)
    sign = np.where(np.arange(40) % 2, -1.0, 1.0)[:, None]  # a v v' stays: the loop still closes
    result = pf.inverse_dynamics(case.scene, case.q, sign * case.v, case.a)
    return int((result.effort_lower < result.effort_upper).sum())


def step_at_the_stick_velocity() -> float:
    """By how much the effort just above a wide stick velocity leaves the interval just below."""
    friction = {"coulomb": {"static": 2.0, "kinetic": 2.0}, "viscous": 30.0, "stick_velocity": 0.1}
    scene = pf.Scene(model=block(), friction={"slide": friction})
    v = np.array([[0.1], [np.nextafter(0.1, 1.0)]])
    effort = pf.inverse_dynamics(scene, 0 * v, v, 0 * v).effort_upper[:, 0]
    return float(max(effort[1] - effort[0], 0.0))


def step_in_a_loop() -> float:
    """The same for a four-bar's crank: its states with and without a wide stick velocity."""
    entry = pin_friction(0.2, 0.02) | {"viscous": 0.5}
    cases = [
        turning_four_bar(24, rate=0.2, friction=entry | {"stick_velocity": stick})
        for stick in (1e-6, 10.0)
    ]
    slides, creeps = (pf.inverse_dynamics(c.scene, c.q, c.v, c.a).effort_upper for c in cases)
    return float(np.maximum(slides - creeps, 0.0).max())


def changed_gravity() -> str:
    """The gravities in one result, after `scene.model`'s was changed to the moon's."""
    model = block()
    model.addFrame(pin.Frame("tray", 1, pin.SE3.Identity(), pin.FrameType.BODY))
    box = {"link": "tray", "mass": 1.0, "com": [0.0, 0.0, 0.0], "attached": False}
    scene = pf.Scene(
        model=model, friction={"slide": plane_friction(0.5, 0.5)}, payloads={"box": box}
    )
    zero, one = np.zeros((1, 1)), np.zeros((2, 1))
    pf.inverse_dynamics(scene, zero, zero, zero)
    scene.model.gravity.linear = np.array([0.0, 0.0, -1.62])
    try:
        result = pf.inverse_dynamics(scene, one, one, one, attached=[[False], [True]])
    except pf.PinfricError as problem:
        return type(problem).__name__
    found = result.effort_upper[:, 0] / (0.5 * np.array([2.0, 3.0]))
    return " and ".join(f"{g:.3g}" for g in found)


def winding_temperature() -> float:
    """Of 3 A without end, as worst ends that change sides from sample to sample (deg C)."""
    thermal = Thermal(winding_housing=2.0, housing_ambient=3.0, winding_time=20, housing_time=300)
    current = np.where(np.arange(100) % 2, -3.0, 3.0)
    return winding_cycle(np.linspace(0, 7, 100), current, 0.8, thermal, 25.0).peak


def stalled_motor() -> str:
    """What `size` says of a motor stalled 5 minutes at 2.5 times its continuous torque."""
    scene, hour, drive = hour_with_a_stall()
    drive["motor"]["thermal"] = None  # no time constant is known
    with tempfile.TemporaryDirectory() as folder:
        catalog = one_drive(Path(folder), **drive)
    (joint,) = pf.size(scene, hour, catalog, on_miss="ignore").joints
    return "passes" if joint.choice else f"fails: {joint.assessments[0].failed[0].name}"


def open_cycle() -> str:
    """What `size` remarks about a cycle that ends 2 rad from where it began."""
    scene = turntable()
    t = np.linspace(0.0, 1.0, 51)[:, None]
    motion = pf.Trajectory.from_arrays(scene, t[:, 0], 2 * t, 2 + 0 * t, 0 * t)
    notes = pf.size(scene, motion).notes
    return notes[0].partition(".")[0] if notes else "nothing"


def said(**change: Any) -> str:
    """What inverse dynamics says of such arguments: an error's kind, or the effort it returns."""
    scene = pf.Scene(model=block())
    given = {"q": np.zeros((3, 1)), "v": np.zeros((3, 1)), "a": np.ones((3, 1))} | change
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NumPy's of imaginary parts
        try:
            result = pf.inverse_dynamics(scene, **given)
            parts = list(result) if "chunks" in change else [result]
        except Exception as problem:
            return type(problem).__name__
    return f"{float(parts[0].effort_upper[0, 0]):g}"


def said_forward() -> str:
    """What forward dynamics says of an imaginary force."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            effort = np.array([4 + 3j])
            return f"{pf.forward_dynamics(pf.Scene(model=block()), [0], [0], effort).a[0]:g}"
        except Exception as problem:
            return type(problem).__name__


def still_joint() -> int:
    """Warnings of a file in which a joint stands at 0.123 rad, at 1 kHz."""
    rows = [f"{0.001 * i:.3f},0.123\n" for i in range(200)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "still.csv"
        file.write_text("t,table\n" + "".join(rows))
        return len(pf.load_trajectory(file, turntable()).warnings)


ROWS = [
    Row("states in no order: share with an interval", intervals_among_random_states, 0.409, 0.0),
    Row("the same in another order: change of efforts (N m)", lambda: shuffled(None), 2411.58, 0.0),
    Row("the same in chunks (N m)", lambda: shuffled(7), 2411.58, 0.0),
    Row("states of a loop in no order: intervals", four_bar_to_and_fro, 40, 0),
    Row("step out of the interval at the stick velocity (N)", step_at_the_stick_velocity, 3.0, 0.0),
    Row("the same in a loop (N m)", step_in_a_loop, 0.3712, 0.0),
    Row("gravity of scene.model changed (m/s2)", changed_gravity, "9.81 and 1.62", "SceneError"),
    # T_a + r P/(1 - alpha r P), P = R i^2 = 7.2 W, r = 5 K/W
    Row("winding at +3 A and -3 A in turn (deg C)", winding_temperature, 37.59, 25 + 36 / 0.8596),
    Row(
        "a motor stalled 5 minutes at 2.5 times",
        stalled_motor,
        "passes",
        "fails: overloaded standstill",
    ),
    Row(
        "a cycle that ends elsewhere",
        open_cycle,
        "nothing",
        "The cycle does not close: table ends 2 rad from where it began",
    ),
    Row("a joint that stands still: warnings of noise", still_joint, 1, 0),
    Row("chunks=2.5", lambda: said(chunks=2.5), "TypeError", "StateError"),
    Row("complex accelerations", lambda: said(a=np.full((3, 1), 1 + 1j)), "2", "StateError"),
    Row("accelerations of text", lambda: said(a=[["1"], ["2"], ["3"]]), "2", "StateError"),
    Row("a complex effort", said_forward, "2", "StateError"),
]


@pytest.mark.parametrize("row", ROWS, ids=[row.what for row in ROWS])
def test_what_was_wrong_without_a_word(row):
    found = row.run()
    if isinstance(row.now, float):
        assert found == pytest.approx(row.now, rel=1e-6, abs=1e-12)
    else:
        assert found == row.now
    assert row.now != row.before
