"""A motion's file that is damaged, or whose arrays do not fit, is one error and never a motion."""

import io
import json
import random
from functools import partial

import numpy as np
import pytest
from builders import block, plane_friction
from judges.test_gears import LOSSY, hoist
from numpy.testing import assert_array_equal
from simulation_cases import slope, swing
from tables import arguments, table

import pinfric as pf
from pinfric.dynamics.simulation.motion import ARRAYS
from pinfric.errors import SimulationError, StateError


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    scene = pf.load_scene("pendulum")
    motion = pf.simulate(scene, t_end=0.4)
    path = motion.save(tmp_path_factory.mktemp("motion") / "motion.npz")
    return scene, motion, path.read_bytes()


def reading(path, scene):
    """The motion that a file reads as, or its one-line error."""
    try:
        return pf.load_motion(path, scene)
    except SimulationError as problem:
        said = str(problem)
    assert len(said.splitlines()) == 1
    assert str(path) in said
    return said


def assert_same(motion, other):
    assert (motion.events, motion.method, motion.status) == (
        other.events,
        other.method,
        other.status,
    )
    for name in ARRAYS:
        assert_array_equal(getattr(motion, name), getattr(other, name))


@pytest.mark.slow
def test_flipped_bits_and_torn_ends_are_errors_or_nothing(saved, tmp_path):
    scene, motion, content = saved
    chance = random.Random(1)
    path, refused = tmp_path / "motion.npz", 0
    heads = list(range(40))  # of the first entry, and the directory at the end
    places = [*heads, *range(len(content) - 900, len(content))]
    places += [chance.randrange(len(content)) for _ in range(300)]
    for place in places:
        damaged = bytearray(content)
        damaged[place] ^= 1 << chance.randrange(8)
        path.write_bytes(damaged)
        found = reading(path, scene)
        if isinstance(found, str):
            refused += 1
        else:
            assert_same(found, motion)
    assert refused > 0.5 * len(places)
    for length in (0, 1, 20, 1000, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:length])
        assert "not a motion" in reading(path, scene)


def other(content, **changes):
    """The file with some of its entries changed, each with a right checksum."""
    with np.load(io.BytesIO(content)) as file:
        entries = {name: file[name] for name in file.files}
    for name, change in changes.items():
        if callable(change):
            entries[name] = change(entries[name])
        else:
            about = json.loads(str(entries["about"]))
            about[name] = change
            entries["about"] = np.array(json.dumps(about))
    made = io.BytesIO()
    np.savez(made, **entries)
    return made.getvalue()


def nowhere(array):
    changed = array.copy()
    changed[1] = np.nan
    return changed


CHANGES = """
q=lambda q: q[:-1]              q has shape
v=lambda v: np.tile(v, 2)       v has shape
effort=lambda u: u[:, :0]       effort has shape
t=lambda t: t[:, None]          t has shape
t=lambda t: t[::-1]             times do not increase
phase_t=lambda t: t[::-1] - 1   times do not increase
phase_t=lambda t: t[:-1]        phase_t has shape
modes=lambda m: m + 2           other modes than -1, 0, 1
friction=nowhere                friction is not finite
a=lambda a: a.astype(complex)   a holds no real numbers
a=lambda a: a.astype(str)       a holds no real numbers
method="guess"                  method
format=7                        format 7; this pinfric reads 1
format=None                     format None
evaluations=-1                  evaluations
scene=[]                        scene
carried=["ghost"]               there is no payload 'ghost'
events=[[0.1, "no_joint", "slip", 1]]       an event names 'no_joint'
events=[[float("nan"), "pivot", "slip", 1]]  events
events=[["pivot"]]              events
"""


@pytest.mark.parametrize(
    ("changes", "words"), table(CHANGES, partial(arguments, nowhere=nowhere), str)
)
def test_arrays_and_entries_that_do_not_fit_are_named(saved, changes, words, tmp_path):
    scene, _, content = saved
    path = tmp_path / "motion.npz"
    path.write_bytes(other(content))
    assert_same(reading(path, scene), saved[1])  # unchanged, it is read
    path.write_bytes(other(content, **changes))
    assert words in reading(path, scene)


def test_a_motion_is_written_as_a_whole_or_not_at_all(saved, tmp_path, monkeypatch):
    _, motion, content = saved
    path = tmp_path / "motion.npz"
    path.write_bytes(content)

    def full_disk(file, **_):
        file.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full_disk)
    with pytest.raises(SimulationError, match="No space left on device"):
        motion.save(path)
    assert path.read_bytes() == content
    assert [p.name for p in tmp_path.iterdir()] == ["motion.npz"]


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_a_motion_goes_to_a_file_and_back(method, tmp_path):
    motion = swing(method)
    path = motion.save(tmp_path / "swing")
    assert path == tmp_path / "swing.npz"
    back = pf.load_motion(path, slope())
    for name in ("t", "q", "v", "a", "effort", "modes", "friction", "normal_load"):
        assert_array_equal(getattr(back, name), getattr(motion, name))
    assert back.events == motion.events
    assert back.stick_intervals() == motion.stick_intervals()
    assert (back.method, back.status, back.evaluations) == (method, "finished", motion.evaluations)
    with pytest.raises(StateError, match="read from a file"):
        back.sample([0.5])
    assert back.energy().work == pytest.approx(motion.energy().work, rel=1e-3)
    frame = back.to_dataframe()
    assert list(frame.columns[:4]) == ["t", "slide.q", "slide.v", "slide.a"]
    assert "slide.friction" in frame


def test_names_with_dots_stay_whole(saved, tmp_path):
    """Two speeds of a sweep are two files."""
    _, motion, _ = saved
    for name in ("speed_0.5", "speed_0.25.npz"):
        assert motion.save(tmp_path / name).name == f"{name.removesuffix('.npz')}.npz"
    assert {p.name for p in tmp_path.iterdir()} == {"speed_0.5.npz", "speed_0.25.npz"}


def test_a_file_with_an_event_of_a_drive_is_read(tmp_path):
    """A gear on a joint without friction sticks; its event has the name of the drive."""
    scene = hoist(LOSSY)
    scene = scene.with_(actuators=[{**scene.actuators[0].model_dump(), "name": "winch"}])
    motion = pf.simulate(scene, [0.0], [0.1], t_end=0.3, motor_torque=[-2.0])
    assert {event.name for event in motion.events} == {"winch"}
    assert_same(pf.load_motion(motion.save(tmp_path / "hoist"), scene), motion)


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ({"model": block(mass=3.0)}, "inertias"),
        ({"friction": {"slide": plane_friction(0.2, 0.1)}}, "friction"),
        (
            {"model": block(0.1), "gravity": [0, 0, -1.62], "stick_velocity": 1e-3},
            "joints, gravity, stick velocity",
        ),
    ],
)
def test_a_file_of_another_scene_is_refused_and_the_difference_named(tmp_path, change, parts):
    path = swing().save(tmp_path / "swing.npz")
    with pytest.raises(SimulationError, match=f"differs in {parts}$"):
        pf.load_motion(path, slope().with_(**change))


def test_a_file_that_is_no_motion_is_refused(tmp_path):
    (tmp_path / "a.npz").write_text("nothing")
    np.savez(tmp_path / "b.npz", t=np.zeros(3))
    for name in ("a.npz", "b.npz", "c.npz"):
        with pytest.raises(SimulationError, match="not a motion"):
            pf.load_motion(tmp_path / name, slope())
