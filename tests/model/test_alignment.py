"""Mechanisms as files round them: which axes are aligned, what is refused, what stays the same."""

import pickle
import warnings

import numpy as np
import pinocchio as pin
import pytest
import yaml
from judges.verdict import judge
from mechanisms import FOUR_BAR, crank_rates, cut_slider_crank, four_bar, pin_friction
from numpy.testing import assert_allclose

import pinfric as pf
from pinfric.dynamics.samples.closure import complete_configurations, consistent_motion
from pinfric.errors import PinfricWarning, SceneError
from pinfric.model.closure import closure_jacobian

EXACT = {"half": "1.5707963267948966", "whole": "3.141592653589793"}
#: Digits as CAD exports and people write them -> how far axes are off.
ROUNDED = yaml.safe_load("""
ten digits: {half: '1.570796327', whole: '3.141592654'}
seven digits: {half: '1.570796', whole: '3.141593'}
five digits: {half: '1.5708', whole: '3.1416'}
""")
#: Links that lie in the plane y = 0 however their own frames are turned.
BODY = """<link name="{0}"><inertial><origin xyz="{1}"/><mass value="{2}"/>
<inertia ixx="0.003" iyy="0.003" izz="0.003" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
URDF = """<robot name="four_bar"><link name="ground"/>
{links}
<joint name="crank_pin" type="continuous"><parent link="ground"/><child link="crank"/>
  <origin rpy="{half} 0 0"/><axis xyz="0 0 1"/></joint>
<joint name="coupler_pin" type="continuous"><parent link="crank"/><child link="coupler"/>
  <origin xyz="0.1 0 0" rpy="0 -{half} 0"/><axis xyz="1 0 0"/></joint>
<joint name="ground_pin" type="continuous"><parent link="ground"/><child link="rocker"/>
  <origin xyz="0.3 0 0" rpy="{whole} 0 0"/><axis xyz="0 1 0"/></joint>
</robot>"""
SCENE = """pinfric: 1
robot: {{urdf: four_bar.urdf, gravity: [0, 0, -9.81]}}
friction: {{crank_pin: &pin {{bearing: {{kind: pin, radius: 0.01}},
    mu: {{static: 0.3, kinetic: 0.2}}}},
  coupler_pin: *pin, ground_pin: *pin, rocker_pin: *pin}}
loops:
  - name: rocker_pin
    kind: {kind}
    a: {{link: coupler, xyz: [0, 0, -0.35], rpy: [0, {half}, 0]}}
    b: {{link: rocker, xyz: [0.25, {offset}, 0], rpy: [-{half}, 0, 0]}}
actuators: [{{joint: crank_pin}}]
simulation: {{start: {{q: {{crank_pin: 0.5, coupler_pin: 0.4, ground_pin: 1.4}}}}, t_end: 1}}
{more}
"""


def written(folder, kind, digits, offset="0", more=""):
    """A four-bar whose links' frames are turned by right angles, from files."""
    bodies = (
        ("crank", "0.05 0 0", 0.5),
        ("coupler", "0 0 -0.175", 1.2),
        ("rocker", "0.125 0 0", 0.9),
    )
    links = "\n".join(BODY.format(*body) for body in bodies)
    (folder / "four_bar.urdf").write_text(URDF.format(links=links, **digits))
    scene = SCENE.format(kind=kind, offset=offset, more=more, **digits)
    (folder / "scene.yaml").write_text(scene)
    return pf.load_scene(folder / "scene.yaml")


def quietly(make, *args, **more):
    """The result, and the warnings raised."""
    with warnings.catch_warnings(record=True) as drawn:
        warnings.simplefilter("always")
        made = make(*args, **more)
    return made, [str(w.message) for w in drawn if w.category is PinfricWarning]


def motion(scene):
    """One turn of the crank: (q, v, a)."""
    n, model = 12, scene.model
    q, angles = np.tile(scene.start_configuration, (n, 1)), np.linspace(0.5, 6.5, n)
    first = model.joints[model.getJointId("crank_pin")].idx_q
    q[:, first], q[:, first + 1] = np.cos(angles), np.sin(angles)
    q = complete_configurations(scene, scene.start_configuration, ["crank_pin"], q)
    one = np.ones((n, 1))
    return q, *consistent_motion(scene, q, ["crank_pin"], 6.0 * one, 3.0 * one)


@pytest.mark.parametrize(
    "digits",
    [pytest.param(x, marks=[pytest.mark.slow] * (x != "seven digits")) for x in ROUNDED],
)
@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
def test_a_four_bar_with_rounded_angles_moves_as_the_exact_one(tmp_path, kind, digits):
    exact, none = quietly(written, tmp_path, kind, EXACT)
    rounded, said = quietly(written, tmp_path, kind, ROUNDED[digits])
    assert not none
    if digits == "ten digits":  # changes no digit that is printed
        assert not said
    else:
        assert len(said) == 1
        assert "'coupler_pin'" in said[0]
        assert "turned by up to" in said[0]
    results, ends = [], []
    for scene in (exact, rounded):
        q, v, a = motion(scene)
        results.append(pf.inverse_dynamics(scene, q, v, a))
        ends.append(pf.simulate(scene, q[0], v[0], np.zeros(1), 0.3))
        assert judge(results[-1]).equilibrium < 1e-11
    size = np.abs(results[0].effort_lower).max()
    for name in ("effort_lower", "effort_upper", "normal_load"):
        ours, theirs = (getattr(result, name) for result in results)
        assert_allclose(ours, theirs, atol=1e-5 * size)
    assert_allclose(ends[1].q[-1], ends[0].q[-1], atol=1e-5)
    again, said = quietly(pf.load_scene, tmp_path / "scene.yaml")
    same, said = quietly(rounded.with_, gravity=[0, 0, -9.0])
    assert not said  # once is enough
    assert same.loops == rounded.loops == again.loops == pickle.loads(pickle.dumps(rounded)).loops


@pytest.mark.parametrize("angle", [1e-9, 1e-7, 2e-6])
@pytest.mark.parametrize("cut", ["W", "G", "A", "O"])
def test_every_placement_off_by_a_little_is_still_the_mechanism(cut, angle):
    found = []
    for size in (0.0, angle):
        rng = np.random.default_rng(1)
        turned = lambda: pin.exp3(size * rng.uniform(-1, 1, size=3))  # noqa: B023, E731
        (scene, joints), _ = quietly(cut_slider_crank, cut, mu=0.05, turned=turned)
        angles = np.linspace(0.2, 6.1, 9)
        known = "A" if cut == "O" else "O"
        q = np.array([scene.close(x, [known]) for x in joints(angles)])
        rates = [
            (-1 if cut == "O" else 1) * x[:, ["OA".index(known)]]
            for x in crank_rates(angles, 10.0, 5.0)
        ]
        assert np.linalg.matrix_rank(closure_jacobian(scene.twin(), scene.linkage, q[:1])[0]) == 2
        result = pf.inverse_dynamics(scene, q, *consistent_motion(scene, q, [known], *rates))
        found.append((result.effort_lower, result.normal_load))
    for ours, theirs in zip(*found, strict=True):
        assert_allclose(ours, theirs, atol=20 * angle * np.abs(theirs).max())


def test_rounded_offsets_along_the_pins_are_shifted_away(tmp_path):
    exact, _ = quietly(written, tmp_path, "revolute", EXACT)
    # the pins are along the rocker's y: frame b lies 0.4 um beside frame a
    shifted, said = quietly(written, tmp_path, "revolute", EXACT, offset="0.0000004")
    assert len(said) == 1
    assert "frames b shifted by up to 4e-07 m (loop_tolerance.length)" in said[0]
    assert shifted.loops[0].b.xyz == pytest.approx((0.25, 0.0, 0.0), abs=1e-13)
    q, v, a = motion(shifted)
    ours, theirs = (pf.inverse_dynamics(scene, q, v, a).effort_lower for scene in (shifted, exact))
    assert_allclose(ours, theirs, rtol=1e-5)
    cannot = r"loops\[0\] \(rocker_pin\): cannot close: .* 0\.002 m.*loop_tol"
    with pytest.raises(SceneError, match=cannot):
        written(tmp_path, "revolute", EXACT, offset="0.002")


@pytest.mark.parametrize("kind", ["planar_pin", "revolute"])
def test_axes_beyond_the_tolerance_are_named(tmp_path, kind):
    digits = {"half": "1.571", "whole": "3.142"}
    with pytest.raises(SceneError) as error:
        written(tmp_path, kind, digits)
    for part in (
        "loops[0] (rocker_pin)",
        "'crank_pin' and joint 'ground_pin'",
        "0.000204 rad from",
        "parallel",
        "loop_tolerance.angle allows 1e-05",
    ):
        assert part in str(error.value)
    scene, said = quietly(written, tmp_path, kind, digits, more="loop_tolerance: {angle: 1.0e-3}")
    assert len(said) == 1
    assert len(scene.drives) == 1


def test_a_tolerance_of_zero_leaves_everything_as_it_is(tmp_path):
    more = "loop_tolerance: {angle: 0, length: 0}"
    with pytest.raises(SceneError, match=r"loops\[0\] \(rocker_pin\)"):
        written(tmp_path, "revolute", ROUNDED["seven digits"], more=more)


@pytest.mark.parametrize("cut", list(FOUR_BAR))
def test_exact_mechanisms_stay_exactly_as_they_are(cut):
    (scene, _), said = quietly(four_bar, cut, "revolute", friction=pin_friction(0.3))
    built, _ = four_bar(cut, "revolute")
    assert not said
    for joint in range(scene.model.njoints):
        given = scene.model.jointPlacements[joint]
        assert np.array_equal(given.rotation, np.eye(3))
    assert scene.loops == built.loops
    assert scene.loops[0].a.rpy == (0.0, 0.0, 0.0)
