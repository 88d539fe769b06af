"""A bearing kind and a friction term that only this file defines, from scene file to simulation.

The collar carries c = weight |F_a| + |M|, the drag is coefficient |v|^exponent. On a turntable
(axis z, mass m at the lever r, inertia I about the axis) F_a = m g, M_b = m g r and M_a = I a.
"""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import yaml
from cases import turning_four_bar
from judges.verdict import judge
from mechanisms import pin_friction
from numpy.testing import assert_allclose
from tables import table

import pinfric as pf
from pinfric.errors import SceneError
from pinfric.model.bearings import FZ, KINDS, MX, MY, MZ, Bearing, LoadTerms, bearing_kind, norm_of
from pinfric.model.effects import effects, with_effects
from pinfric.model.entry import NonNegative, Positive
from pinfric.model.friction_terms import (
    TERMS,
    FrictionTerm,
    Row,
    Shape,
    Strength,
    Stribeck,
    friction_term,
)
from pinfric.model.transmission import (
    GEAR_KINDS,
    LoadLoss,
    OwnTransmission,
    Transmission,
    gear_kind,
)


@pytest.fixture(scope="module", autouse=True)
def added():
    """The two classes, known while the tests of this file run."""

    @bearing_kind
    class Collar(Bearing):
        fits = ("turning joint",)

        kind: Literal["collar"]
        weight: NonNegative

        def terms(self) -> LoadTerms:
            return LoadTerms([self.weight * norm_of(FZ), norm_of(MX, MY, MZ)])

    @friction_term("power_drag")
    class PowerDrag(FrictionTerm):
        coefficient: NonNegative
        exponent: Positive

        def rows(self, stribeck: Stribeck | None) -> tuple[Row, ...]:
            both_ways = Strength(0.0, self.coefficient, self.coefficient)
            return ((Shape(power=self.exponent), both_ways),)

    @gear_kind
    class Worm(OwnTransmission):
        kind: Literal["worm"]
        lead: Positive
        rubs: Positive

        def load_losses(self) -> tuple[LoadLoss, LoadLoss]:
            turned, held = np.tan(self.lead + self.rubs), np.tan(self.lead - self.rubs)
            driving, driven = turned / np.tan(self.lead) - 1, 1 - held / np.tan(self.lead)
            return LoadLoss((0.0,), (0.0,), (driving,)), LoadLoss((0.0,), (0.0,), (driven,))

    yield
    del KINDS["collar"], TERMS["power_drag"], GEAR_KINDS["worm"]


def test_a_name_that_exists_is_refused():
    """Else all scenes would use the new class; a cell of a notebook may be run again."""

    def define(kind):
        class Other(KINDS[kind]):
            pass

        return bearing_kind(Other)

    before = KINDS["pin"]
    with pytest.raises(SceneError, match=r"Other: 'pin' is the name of pinfric.*Pin, .*another"):
        define("pin")
    assert KINDS["pin"] is before
    with pytest.raises(SceneError, match="'power_drag' is the name of"):
        friction_term("power_drag")(type("Other", (FrictionTerm,), {}))
    bearing_kind(KINDS["collar"])


NO_LOADS = [
    (1.0, r"should return LoadTerms of maps \(3, 6\)"),
    ([norm_of(FZ)], r"should return LoadTerms of maps \(3, 6\)"),
    (LoadTerms([FZ]), r"should return LoadTerms of maps \(3, 6\)"),
    (LoadTerms([np.nan * norm_of(FZ)]), "maps should be finite"),
    (LoadTerms([norm_of(FZ)], constant=-1.0), "`constant` not negative"),
]


@pytest.mark.parametrize(("terms", "says"), NO_LOADS)
def test_terms_that_are_no_load_are_refused_by_the_classes_name(terms, says, monkeypatch):
    monkeypatch.setattr(KINDS["collar"], "terms", lambda _: terms)
    friction = {
        "joint_1": {
            "bearing": {"kind": "collar", "weight": 2.0},
            "mu": {"static": 0.1, "kinetic": 0.1},
        }
    }
    with pytest.raises(SceneError, match=f"^Collar.terms: .*{says}"):
        pf.Solver(pf.load_scene("pendulum").with_(friction=friction))


DRAG_OF_1 = ((Shape(power=2.0), Strength(0.0, 1.0, 1.0)),)
NO_FRICTION = [
    (None, Strength(), "rows: should return pairs"),
    (DRAG_OF_1[0], Strength(), "rows: should return pairs"),
    ((DRAG_OF_1[0][::-1],), Strength(), "rows: should return pairs"),
    (((Shape(power=-1.0), Strength()),), Strength(), "rows: .* not negative"),
    (((Shape(power=2.0), Strength(0.0, -1.0, 1.0)),), Strength(), "rows: .* not negative"),
    (((Shape(power=2.0), Strength(0.0, np.nan, 1.0)),), Strength(), "rows: .* finite"),
    (DRAG_OF_1, 3.0, "at_rest: should return a Strength"),
    (((Shape(), Strength(0.0, 1.0, 1.0)),), Strength(0.0, 1.0, 0.5), "at_rest: .* is less than"),
]


@pytest.mark.parametrize(("rows", "rest", "says"), NO_FRICTION)
def test_rows_that_are_no_friction_are_refused_by_the_classes_name(
    rows, rest, says, tmp_path, monkeypatch
):
    monkeypatch.setattr(TERMS["power_drag"], "rows", lambda *_: rows)
    monkeypatch.setattr(TERMS["power_drag"], "at_rest", lambda _: rest)
    with pytest.raises(SceneError, match=f"^PowerDrag.{says}"):
        pf.Solver(turntable(tmp_path, POWER_DRAG))


M, R, J, G = 2.0, 0.3, 0.05, 9.81
INERTIA = J + M * R * R
MU, WEIGHT, DRAG, POWER = 0.05, 2.0, 0.4, 0.6
COLLAR = "bearing: {kind: collar, weight: 2.0}, mu: {static: 0.05, kinetic: 0.05}"
POWER_DRAG = "power_drag: {coefficient: 0.4, exponent: 0.6}"
URDF = f"""<robot name="table"><link name="ground"/><link name="table"><inertial>
<origin xyz="{R} 0 0"/><mass value="{M}"/>
<inertia ixx="{J}" iyy="{J}" izz="{J}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="ground"/><child link="table"/>
<axis xyz="0 0 1"/>
<limit lower="-99" upper="99" effort="0" velocity="0"/></joint></robot>"""


def turntable(folder: Path, friction: str) -> pf.Scene:
    (folder / "table.urdf").write_text(URDF)
    file = folder / "scene.yaml"
    file.write_text(
        f"pinfric: 1\nrobot: {{urdf: table.urdf}}\nfriction: {{turn: {{{friction}}}}}\n"
    )
    return pf.load_scene(file)


def load_of(a):
    return WEIGHT * M * G + np.hypot(M * G * R, INERTIA * a)


def test_inverse_dynamics_have_the_closed_form(tmp_path):
    scene = turntable(tmp_path, f"{COLLAR}, {POWER_DRAG}, viscous: 0.1")
    v = np.array([2.0, -0.5, 0.0])
    a = np.array([1.0, 3.0, -2.0])
    result = pf.inverse_dynamics(scene, np.zeros((3, 1)), v[:, None], a[:, None])
    assert_allclose(result.normal_load[:, 0], load_of(a), rtol=1e-14)
    dry = MU * load_of(a)
    drag = np.sign(v) * DRAG * np.abs(v) ** POWER + 0.1 * v
    least = INERTIA * a + drag + np.where(v == 0, -dry, np.sign(v) * dry)
    most = INERTIA * a + drag + np.where(v == 0, dry, np.sign(v) * dry)
    assert_allclose(result.effort_lower[:, 0], least, rtol=1e-13)
    assert_allclose(result.effort_upper[:, 0], most, rtol=1e-13)
    assert judge(result).passed()


def test_creeping_adds_the_drag_to_what_standstill_admits(tmp_path):
    scene = turntable(tmp_path, f"{COLLAR}, {POWER_DRAG}, stick_velocity: 0.5")
    result = pf.inverse_dynamics(scene, [[0.0]], [[0.2]], [[0.0]])
    dry, drag = MU * load_of(0.0), DRAG * 0.2**POWER
    assert result.effort_lower[0, 0] == pytest.approx(-dry, rel=1e-13)
    assert result.effort_upper[0, 0] == pytest.approx(dry + drag, rel=1e-13)
    assert judge(result).passed()


@pytest.mark.parametrize("v", [2.0, -0.5])
def test_forward_dynamics_have_the_closed_form(tmp_path, v):
    scene = turntable(tmp_path, f"{COLLAR}, {POWER_DRAG}, viscous: 0.1")
    for a in (-40.0, 0.5, 30.0):
        drag = np.sign(v) * (DRAG * abs(v) ** POWER + MU * load_of(a)) + 0.1 * v
        instant = pf.forward_dynamics(scene, [0.3], [v], [INERTIA * a + drag])
        assert instant.a[0] == pytest.approx(a, rel=1e-12)
        assert instant.normal_load[0] == pytest.approx(load_of(a), rel=1e-12)


METHODS = [("event", 1e-7), ("timestepping", 1e-3), ("regularized", 1e-4)]


@pytest.mark.parametrize(("method", "tolerance"), METHODS)
def test_simulated_drag_runs_out_as_its_closed_form_does(tmp_path, method, tolerance):
    """I dv/dt = -coefficient v^p, so v^(1-p) falls in proportion to the time."""
    scene = turntable(tmp_path, POWER_DRAG)
    stops = 2.0 ** (1 - POWER) * INERTIA / ((1 - POWER) * DRAG)
    motion = pf.simulate(scene, [0.0], [2.0], [0.0], 0.9 * stops, method)
    expected = 2.0 * (1 - motion.t / stops) ** (1 / (1 - POWER))
    assert_allclose(motion.v[:, 0], expected, rtol=0, atol=2.0 * tolerance)


@pytest.mark.parametrize(("method", "tolerance"), METHODS)
def test_simulated_collar_stops_as_its_closed_form_does(tmp_path, method, tolerance):
    """x = I |a| = mu (A + sqrt(B^2 + x^2)) with A = weight m g, B = m g r."""
    scene = turntable(tmp_path, COLLAR)
    A, B = WEIGHT * M * G, M * G * R
    x = (MU * A + np.sqrt((MU * A) ** 2 - (1 - MU**2) * MU**2 * (A**2 - B**2))) / (1 - MU**2)
    stops = 2.0 * INERTIA / x
    motion = pf.simulate(scene, [0.0], [2.0], [0.0], 1.2 * stops, method)
    expected = np.maximum(2.0 * (1 - motion.t / stops), 0.0)
    assert_allclose(motion.v[:, 0], expected, rtol=0, atol=4.0 * tolerance)
    if method != "regularized":
        assert motion.v[-1, 0] == 0.0


def test_loops_drag_too_and_their_judge_agrees():
    friction = {**pin_friction(0.3), "power_drag": {"coefficient": 0.2, "exponent": 0.6}}
    case = turning_four_bar(12, friction=friction)
    result = case.inverse()
    assert judge(result).passed()
    plain = turning_four_bar(12, friction=pin_friction(0.3)).inverse()
    assert (result.effort_lower > plain.effort_lower).all()
    single = np.flatnonzero(result.effort_upper[:, 0] - result.effort_lower[:, 0] < 1e-12)
    assert len(single) > 8  # a reversal beside the others leaves an interval
    for i in single:
        instant = pf.forward_dynamics(case.scene, case.q[i], case.v[i], result.effort_lower[i])
        assert_allclose(instant.a, case.a[i], rtol=0, atol=1e-8)


def test_they_are_effects_by_their_keys(tmp_path):
    scene = turntable(tmp_path, f"{COLLAR}, {POWER_DRAG}")
    found = {effect.name: effect for effect in effects(scene)}
    assert (found["power_drag"].on, found["power_drag"].why) == (True, "friction.turn.power_drag")
    left = with_effects(scene, without=["power_drag"])
    assert left.friction["turn"].bearing == scene.friction["turn"].bearing
    assert not {e.name: e for e in effects(left)}["power_drag"].on
    assert with_effects(scene, only=["viscous"]).site_names == ()


MISTAKES = r"""
collar      weight         wieght      unknown key `friction.turn.bearing.wieght`
collar      weight         radius      bearing\.radius`; there are: kind, weight
collar      , weight: 2.0  NONE        `friction\.turn\.bearing\.weight` is missing
collar      2.0            -2          bearing\.weight`: .*at least 0
power_drag  0.4            -1          turn\.power_drag\.coefficient`: .*at least 0
power_drag  exponent       exponant    unknown key `friction\.turn\.power_drag\.exponant`
power_drag  power_drag     power_darg  unknown key `friction\.turn\.power_darg`
"""


@pytest.mark.parametrize(("which", "old", "new", "says"), table(MISTAKES))
def test_their_mistakes_are_named_like_those_of_the_others(tmp_path, which, old, new, says):
    text = {"collar": COLLAR, "power_drag": POWER_DRAG}[which]
    friction = text.replace(old, new.replace("NONE", ""))
    with pytest.raises(SceneError, match=says) as caught:
        turntable(tmp_path, friction)
    assert "\n" not in str(caught.value)


LEAD, RUBS, RATIO, ROTOR = 0.2, 0.05, 50.0, 1e-4
WORM = {"kind": "worm", "lead": LEAD, "rubs": RUBS, "ratio": RATIO, "rotor_inertia": ROTOR}


def with_gear(folder: Path, **changes) -> pf.Scene:
    gear = {k: v for k, v in (WORM | changes).items() if v is not None}
    return turntable(folder, "viscous: 0.1").with_(
        actuators=[{"joint": "turn", "transmission": gear}]
    )


def test_motor_torques_of_an_added_gear_have_the_closed_form(tmp_path):
    scene, v = with_gear(tmp_path), np.array([2.0, 2.0, -0.5])
    a = np.array([3.0, -8.0, -2.0])  # driving, braking, driving backward
    result = pf.inverse_dynamics(scene, np.zeros((3, 1)), v[:, None], a[:, None])
    effort = INERTIA * a + 0.1 * v
    driving = np.sign(effort * v) > 0
    eta = np.tan(LEAD) / np.tan(LEAD + RUBS)
    back = np.tan(LEAD - RUBS) / np.tan(LEAD)
    passed = np.where(driving, effort / eta, effort * back) / RATIO
    torque = passed + RATIO * ROTOR * a
    assert_allclose(result.motor_torque_lower[:, 0], torque, rtol=1e-12)
    assert judge(result).passed()
    moved = pf.forward_dynamics(scene, np.zeros((3, 1)), v[:, None], motor_torque=torque[:, None])
    assert_allclose(moved.a[:, 0], a, rtol=1e-10)


def test_an_added_gear_can_lose_more_or_nothing(tmp_path):
    """As the friction of stops, sweeps and effects varies it."""
    scene = with_gear(tmp_path)
    gear = scene.actuators[0].transmission
    plain = Transmission(
        ratio=RATIO,
        rotor_inertia=ROTOR,
        efficiency=np.tan(LEAD) / np.tan(LEAD + RUBS),
        back_efficiency=np.tan(LEAD - RUBS) / np.tan(LEAD),
    )
    for mine, other in zip(
        gear.with_losses(1.7).losses(), plain.with_losses(1.7).losses(), strict=True
    ):
        assert_allclose(mine.slopes, other.slopes, rtol=1e-12)
    unloaded = with_effects(scene, without=["gear"]).actuators[0].transmission
    assert [loss.slopes for loss in unloaded.losses()] == [(0.0,), (0.0,)]


CASES = r"""
{kind: wurm}       transmission`: there is no kind 'wurm'; did you mean 'worm'
{rubs: null}       transmission\.rubs` is missing
{rubs: -1}         transmission\.rubs`: .*greater than 0
{leed: 0.1}        unknown key `.*transmission\.leed`; there are: .*rotor_inertia
{efficiency: 0.7}  `efficiency` follows from its `kind`; leave it out
"""


@pytest.mark.parametrize(
    ("changes", "says"),
    table(CASES, yaml.safe_load, str),
)
def test_mistakes_in_an_added_gear_are_named(tmp_path, changes, says):
    with pytest.raises(SceneError, match=says):
        with_gear(tmp_path, **changes)


def test_nothing_else_knows_them():
    """One class each; the package names neither."""
    package = Path(pf.__file__).parent
    for file in package.rglob("*.py"):
        text = file.read_text(encoding="utf-8")
        assert "collar" not in text.lower()
        assert "power_drag" not in text
