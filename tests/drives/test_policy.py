"""Figures that a drive must have, what fits what, and the defaults."""

import numpy as np
import pytest
import yaml
from sizing_cases import GEAR, MOTOR, one_drive, sized_cycle, turntable, write_catalog
from tables import table

from pinfric.drives.catalog import Brake, Gear, Motor
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status
from pinfric.drives.policy import (
    NEEDS,
    Conditions,
    kind_of,
    lacks,
)
from pinfric.errors import SizingError
from pinfric.retiming.limits import read_limits
from pinfric.sweeps.file import load_sweep
from pinfric.sweeps.motors import motors_on_trial

STRAIN = {**GEAR, "kind": "strain wave"}


def sized(tmp_path, motor=None, gear=None, **conditions):
    catalog = one_drive(tmp_path, motor, gear)
    report = sized_cycle(catalog, conditions=conditions, on_miss="ignore")
    return report.joints[0]


CASES = """
motor  rotor_inertia          rotor inertia
gear   stiffness              stiffness
gear   bearing                output bearing
gear   input_inertia          input inertia
gear   momentary_peak_torque  momentary peak torque
gear   average_input_speed    limit for average input speed
"""


@pytest.mark.parametrize(
    ("part", "figure", "asked"),
    table(CASES),
)
def test_a_drive_that_lacks_a_figure_cannot_be_signed(tmp_path, part, figure, asked):
    """The joint, the product, the figure: its maker is asked for it."""
    catalog = one_drive(tmp_path, **{part: {figure: None}}, **{})
    gears = {"G": {k: v for k, v in STRAIN.items() if part != "gear" or k != figure}}
    motors = {"M": {k: v for k, v in MOTOR.items() if part != "motor" or k != figure}}
    catalog = load_catalog(write_catalog(tmp_path / "catalog.yaml", motors, gears))
    report = sized_cycle(catalog, on_miss="ignore")
    (joint,) = report.joints
    assert joint.choice is None
    assert joint.assessments[0].lacks == (asked,)
    if joint.nearest is not None:  # it would fit
        asks = f"can be signed; M + G is provisional: ask its maker for {asked}"
        assert joint.no_fit == f"table: none of 1 candidate {asks}"
        return
    product = "M" if part == "motor" else "G"
    assert f"table: none of 1 candidate fits; {product} cannot be signed" in joint.no_fit
    assert f"{asked} (its other figures: invented)" in joint.no_fit


def test_a_gear_that_fails_by_what_is_known_is_not_asked_for(tmp_path):
    """A turntable's weight rests on the gear: of two that lack the stiffness one bears it."""
    unknown = {k: v for k, v in GEAR.items() if k != "stiffness"} | {"mass": 0.5}
    weak = {**unknown, "bearing": {**GEAR["bearing"], "max_axial": 0.1}}
    gears = {"known": GEAR, "unknown": unknown, "weak": weak}
    catalog = load_catalog(write_catalog(tmp_path / "catalog.yaml", gears=gears))
    (joint,) = sized_cycle(catalog, on_miss="ignore").joints
    assert joint.choice.candidate.gear_name == "known"
    assert [ask.name for ask in joint.ask] == ["unknown"]


def test_what_stands_in_is_the_lower_limit_and_said(tmp_path):
    """Of other gears T2N for the mean; of a motor its stall torque for the peak."""
    joint = sized(tmp_path, gear={"average_torque": None})
    found = next(c for c in joint.choice.criteria if c.name == "gear average torque")
    assert (found.available, found.status) == (30.0, Status.PASSES)
    assert found.note == "the rated torque: no higher limit is known"
    for stall, stands_in in ((5.0, 3.5 * 0.5), (1.6, 1.6)):
        line = {"stall_torque": stall, "nominal_voltage": 48.0, "no_load_speed": 480.0}
        joint = sized(tmp_path, {"peak_torque": None} | line)
        peak = next(c for c in joint.choice.criteria if c.name == "peak torque")
        assert peak.available == pytest.approx(stands_in)
        assert "at most 3.5 x the continuous torque, by rule; if the amplifier" in peak.note


def test_a_stiffness_that_is_not_printed_is_not_rigid(tmp_path):
    """Neither where a softer gear fails by it, nor where none does."""
    unknown = {k: v for k, v in GEAR.items() if k != "stiffness"}
    for soft in ({**GEAR, "stiffness": 4e3, "mass": 0.8}, {**GEAR, "mass": 0.8}):
        gears = {"soft": soft, "unknown": {**unknown, "mass": 0.5}, "stiff": {**GEAR, "mass": 1.2}}
        catalog = load_catalog(write_catalog(tmp_path / "catalog.yaml", gears=gears))
        (joint,) = sized_cycle(catalog, on_miss="ignore").joints
        assert joint.choice.candidate.gear_name == ("stiff" if soft["stiffness"] < 5e3 else "soft")
        assert [(a.name, a.figures) for a in joint.ask] == [("unknown", ("stiffness",))]


def test_what_a_condition_asks_for_must_be_known(tmp_path):
    short = {"nominal_life": 200.0}
    assert sized(tmp_path, gear=short).choice is not None  # printed, not judged
    assert sized(tmp_path, gear=short, life=10_000.0).choice is None
    for key, asked in (("nominal_life", {"life": 100.0}), ("backlash", {"backlash": 1e-3})):
        joint = sized(tmp_path, gear={key: None}, **asked)
        assert joint.choice is None
        assert joint.assessments[0].unknown


ROWS = """
''           {}                                           50.0  ''
''  {}  50.1  'M cannot be signed: ask its maker for ratings at 50.1 C (makers rate up'
''  {}  -0.1  'M cannot be signed: ask its maker for ratings at -0.1 C (makers rate from'
''           {ambient_curve: [[40.0, 1.0], [60.0, 0.9]]}  59.0  ''
strain wave  {}                                           40.0  ''
strain wave  {}  41.0  'G cannot be signed: ask its maker for ratings at 41 C (makers'
planetary  {}  41.0  'G cannot be signed: ask its maker for ratings at 41 C'
planetary    {}                                           0.0   ''
cycloidal    {}                                           49.0  ''
"""


@pytest.mark.parametrize(
    ("kind", "rated", "ambient", "asked"),
    table(ROWS, yaml.safe_load, yaml.safe_load, float, yaml.safe_load),
)
def test_nothing_is_signed_where_its_maker_does_not_rate_it(tmp_path, kind, rated, ambient, asked):
    motor = {"thermal": None, "continuous_torque": 0.9, **rated}
    catalog = one_drive(tmp_path, motor, {"kind": kind})
    given = {"inertia_ratio": 20, "ambient": ambient}
    report = sized_cycle(catalog, conditions=given, on_miss="ignore")
    assert (report.joints[0].choice is None) == bool(asked)
    assert asked in report.joints[0].no_fit
    assert report.verdict.signed == (not asked)
    if asked:
        lacking = f"{kind} gears" if kind else "motors"  # of what the catalogue holds
        with pytest.raises(SizingError, match=f"^conditions.ambient = {ambient:g} C: {lacking} la"):
            report.check()


def test_an_amplifier_is_not_signed_where_its_maker_does_not_rate_it(tmp_path):
    amplifier = {
        "source": "invented",
        "grade": "R",
        "continuous_current": 9.0,
        "peak_current": 90.0,
    }
    given = {"inertia_ratio": 20, "amplifiers": {"table": "A"}}
    for ambient in (40.0, 41.0):
        catalog = one_drive(tmp_path, {"thermal": None}, amplifiers={"A": amplifier})
        more = {**given, "ambient": ambient}
        (joint,) = sized_cycle(catalog, conditions=more, on_miss="ignore").joints
        assert (joint.choice is None) == (ambient > 40.0)
        assert ("of its amplifier" in joint.no_fit) == (ambient > 40.0)


def test_what_fits_what():
    sourced = {"source": "invented", "grade": "R"}
    kit, shaft = (Motor(**sourced, mounting=x) for x in ("frameless", "shaft"))
    wave = Gear(**sourced, ratio=100.0, kind="strain wave")
    planet = Gear(**sourced, ratio=10.0, kind="planetary")
    own = Gear(**sourced, ratio=10.0, kind="planetary", motors=("maxon",))
    assert [gear.takes("K", kit) for gear in (wave, planet, own)] == [True, False, False]
    assert [gear.takes("S", shaft) for gear in (wave, planet, own)] == [True, True, False]
    assert own.takes("maxon EC", shaft)
    inside = Brake(**sourced, torque=1.0, sold="Siemens 1FK2")
    assert [inside.goes_with(name) for name in ("", "Siemens 1FK2-03", "M")] == [
        False,
        True,
        False,
    ]
    alone = Brake(**sourced, torque=1.0, sold="alone")
    assert alone.goes_with("M")
    assert not alone.goes_with("A", integrated=True)  # a gearmotor has no shaft for it
    assert inside.goes_with("Siemens 1FK2-03", integrated=True)


def test_a_frameless_kit_weighs_a_quarter_more(tmp_path):
    plain = sized(tmp_path, gear={"kind": "strain wave"}).choice.candidate
    kit = sized(tmp_path, {"mounting": "frameless"}, {"kind": "strain wave"}).choice.candidate
    assert kit.mass == pytest.approx(1.25 * plain.mass)
    assert any("frameless kit: 25%" in text for text in kit.stand_ins)
    planetary = sized(tmp_path, {"mounting": "frameless"})
    assert planetary.candidates == 0
    assert "goes with its gears: a frameless kit needs a strain wave gear" in planetary.no_fit


def test_lists_are_by_kind_and_complete_in_the_catalogue_where_they_must_be():
    catalog = load_catalog()
    signable = [n for n, g in catalog.gears.items() if not lacks(kind_of(g), g)]
    assert sum(n.startswith("Harmonic Drive CSG") for n in signable) >= 7
    assert set(NEEDS) >= {kind_of(g) for g in catalog.gears.values()}
    assert not any(np.isnan(getattr(Conditions(), key)) for key in ("resonance_base", "ambient"))


def test_a_catalogues_ambient_stays_beside_given_conditions(tmp_path):
    """In `size` as an object and as keys, in `sweep` and in `retime`: one rule, one rating."""
    catalog = one_drive(tmp_path, conditions={"ambient": 48.0, "peak_factor": 1.1})
    scene, keys = turntable(), {"bus_voltage": 60.0}
    asked = [sized_cycle(catalog, conditions=x) for x in (Conditions(**keys), keys)]
    source = {"catalog": str(tmp_path / "catalog.yaml"), "conditions": keys}
    motors = {"pinfric_motors": 1, **source, "others": {"drive": "M + G"}}
    (tmp_path / "motors.yaml").write_text(yaml.safe_dump(motors))
    limits = read_limits(scene, tmp_path / "motors.yaml")[0]
    sweep = {
        "pinfric_sweep": 1,
        "samples": 1,
        "parameters": {"speed": {"uniform": {"low": 0.9, "high": 1.0}}},
        "motors": {"table": {"drive": "M + G"}},
    }
    trial = motors_on_trial(scene, load_sweep(sweep | source)[0], "sweep")[1][0]
    found = [*(report.conditions for report in asked), limits.from_catalog[1], trial.conditions]
    assert [(c.ambient, c.peak_factor, c.bus_voltage) for c in found] == [(48.0, 1.1, 60.0)] * 4
    left = MOTOR["continuous_torque"] * ((125.0 - 48.0) / (125.0 - 25.0)) ** 0.5
    rated = [joint.choice.criteria[0].available for report in asked for joint in report.joints]
    rated += [limits.over_time[0], trial.continuous_torque]
    assert rated == pytest.approx([left] * 4, rel=1e-12)
