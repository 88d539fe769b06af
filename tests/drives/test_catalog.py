"""Catalogues: the bundled one, and what is wrong with others."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml
from sizing_cases import GEAR, MOTOR, one_drive, write_catalog
from tables import table

import pinfric as pf
from pinfric.drives.drivetrain import gear_transmission, gearmotor_drive
from pinfric.drives.policy import Conditions, lacks, parse_conditions
from pinfric.errors import CatalogError


def test_bundled_catalogue_has_the_figures_of_its_sources_and_no_doubts():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        catalog = pf.load_catalog()
    motor = catalog.motors["Kollmorgen TBM-6025-A"]
    assert (motor.continuous_torque, motor.peak_torque) == (0.706, 2.56)
    assert (motor.rotor_inertia, motor.mass) == (2.52e-5, 0.377)
    gear = catalog.gears["Harmonic Drive CSG-25-100"]
    assert (gear.repeated_peak_torque, gear.average_torque) == (204, 140)
    assert (gear.rated_torque, gear.momentary_peak_torque) == (87, 369)
    assert (gear.input_inertia, gear.mass) == (4.13e-5, 1.5)
    assert gear.max_input_speed == pytest.approx(5600 * 2 * 3.14159265 / 60, rel=1e-3)
    assert catalog.gearmotors["CubeMars AK80-64"].continuous_torque == 48
    assert catalog.bearings["SKF angular contact ball"].mu == 0.0020
    thermal = catalog.motors["maxon EC 90 flat 244879"].thermal
    assert (thermal.winding_time, thermal.housing_time, thermal.max_winding) == (52.6, 281, 125)


SECTIONS = ("motors", "gears", "gearmotors", "kinds", "bearings", "brakes", "amplifiers")
BUNDLED = [(section, name) for section in SECTIONS for name in getattr(pf.load_catalog(), section)]
#: What finds a figure again: a page, a number of a document or part, a table, a dated page.
PLACE = re.compile(
    r"\bpp?\. ?\d|\bpages? |\d{6}|[A-Z]{2}-SG|R9114|\btables?\b|\btype [A-Z]|July 2020|"
    r"product page|specification sheet|selection guide|catalogue|data sheet|manual|"
    r"motor review|actuator software|coefficients|material data|document|MR-JE|identified on|"
    r"data at 20 C|data of order|README"
)


@pytest.mark.parametrize(("section", "name"), BUNDLED)
def test_every_figure_has_maker_and_document_and_a_grade(section, name):
    entry = getattr(pf.load_catalog(), section)[name]
    assert entry.grade in ("R", "T")
    maker = name.split()[0]
    if maker not in ("Slewing", "ZeroErr", "PTFE/bronze"):  # a formula; identified; all makers
        words = {"PBSA": "PBSA", "Siemens": "Siemens", "Allen-Bradley": "Rockwell"}
        assert words.get(maker, maker) in entry.source
    if maker not in ("Slewing", "PTFE/bronze", "PBC"):
        assert PLACE.search(entry.source), entry.source
    if entry.grade == "T":  # who retyped it
        assert re.search("retyp|second|third|distributor|public|identified|pasted", entry.source)
    for figure, product in entry.stand_ins.items():
        assert getattr(entry, figure) is not None
        if figure in ("mounting", "input", "motors"):
            assert product.startswith("by rule: ")
        elif not product.startswith("by rule: "):
            assert product.split()[0] in (
                "Harmonic",
                "Schaeffler",
                "ZeroErr",
                "maxon",
                "ball",
                "B&R",
                "a",
                "Feetech",
            )


def test_the_bundled_catalogue_has_all_that_is_printed_and_no_more():
    catalog = pf.load_catalog()
    assert [len(getattr(catalog, section)) for section in SECTIONS] == [
        232,
        250,
        71,
        29,
        53,
        84,
        14,
    ]
    # what is not printed stays out
    assert catalog.motors["maxon EC-i 40 488607"].peak_torque is None
    assert catalog.gears["Schaeffler RT1-H-CS 25 i=100"].mass is None


def test_maxons_figures_agree_with_each_other():
    """A mistyped digit shows: stall torque = k U/R, k n0 = U, and a balance of power.

    At the nominal point friction and iron lose U I - R I^2 - M omega: more than nothing, and less
    than at no load, where the motor turns faster: U I0 - R I0^2 with R I0 = U - k n0, k less the
    0.5 % of rounding to three digits. Only without iron M is k (I - I0).
    """
    motors = {n: m for n, m in pf.load_catalog().motors.items() if " W " in n}
    assert len(motors) == 29
    for name, m in motors.items():
        stall = m.torque_constant * m.nominal_voltage / m.resistance
        assert m.stall_torque == pytest.approx(stall, rel=0.02), name
        assert 0.9 < m.torque_constant * m.no_load_speed / m.nominal_voltage < 1.01, name
        U, R, I = m.nominal_voltage, m.resistance, m.continuous_current  # noqa: E741
        turns = U * I - R * I**2 - m.continuous_torque * m.rated_speed
        idle = (U - 0.995 * m.torque_constant * m.no_load_speed) / R
        assert 0.0 < turns < U * idle - R * idle**2, name
        assert m.rated_speed < m.no_load_speed < m.max_speed, name


def test_yaskawas_figures_agree_with_each_other():
    """Rated power = torque x speed; the torque constant is per A RMS of the rated current."""
    motors = {n: m for n, m in pf.load_catalog().motors.items() if n.startswith("Yaskawa")}
    watts = {"A5": 50, "C2": 150}
    for name, m in motors.items():
        code = name.split("-")[1].removesuffix("A")
        power = watts.get(code, 100 * int(code) if code.isdigit() else None)
        if power in (800, 500, 900):  # 750, 450 and 850 W
            power -= 50
        if name.endswith("20A") and "7G" in name:
            power = 1800
        assert m.continuous_torque * m.rated_speed == pytest.approx(power, rel=0.03), name
        amperes = m.torque_constant * m.continuous_current
        assert m.continuous_torque == pytest.approx(amperes, rel=0.15), name


def test_harmonic_drives_figures_agree_with_each_other():
    """Ratings grow with size and ratio, and so does the momentary peak."""
    gears = {n: g for n, g in pf.load_catalog().gears.items() if "CSG" in n}
    by_size = {}
    for name, g in gears.items():
        _, size, ratio = name.rsplit("-", 2)
        assert g.ratio == float(ratio)
        by_size.setdefault(int(size), []).append(g)
        assert g.rated_torque <= g.average_torque <= g.repeated_peak_torque
        assert 1.4 < g.momentary_peak_torque / g.repeated_peak_torque < 2.3
    for group in by_size.values():
        peaks = [g.repeated_peak_torque for g in group]
        assert peaks == sorted(peaks)
        assert len({(g.mass, g.input_inertia, g.max_input_speed) for g in group}) == 1
    for figure in ("rated_torque", "mass", "input_inertia"):
        found = [getattr(gears[f"Harmonic Drive CSG-{s}-100"], figure) for s in sorted(by_size)]
        assert found == sorted(found)
    assert gears["Harmonic Drive CSG-17-100"].momentary_peak_torque == 109  # SHG-17 has 143
    for name in ("efficiency", "starting_torque"):
        assert "Schaeffler" in gears["Harmonic Drive CSG-25-100"].stand_ins[name]
    assert gears["Harmonic Drive CSG-25-50"].efficiency is None


@pytest.mark.parametrize(("ratio", "eta", "idle"), [(22, 0.94, 2.7), (110, 0.92, 1.1)])
def test_a_planetary_gears_idle_torque_counts_once(ratio, eta, idle):
    """Torque at the input for the nominal torque: that of the printed efficiency, and the idle."""
    gear = pf.load_catalog().gears[f"Beckhoff TP050 MA i={ratio}"]
    made, _ = gear_transmission(gear, float(ratio), 0.0)
    assert made.efficiency == pytest.approx(eta, rel=1e-3)
    assert made.no_load_torque.kinetic == idle
    nominal = gear.rated_torque / ratio
    assert nominal / gear.efficiency == pytest.approx(nominal / eta + idle, rel=1e-3)


def test_brakes_have_the_torques_of_their_own_rows():
    """Shifted by a row it would be the brake of the next size."""
    brakes = pf.load_catalog().brakes
    yaskawa = {"05": 4.5, "09": 12.7, "13, 20": 19.6, "30, 44": 43.1, "55, 75": 72.6}
    for model, torque in yaskawa.items():
        assert brakes[f"Yaskawa SGMGV-{model}"].torque == torque
    assert brakes["Mitsubishi HC-MF 23, 43"].stop_energy == 22.0
    assert (brakes["Siemens 1FK2-05"].torque, brakes["Siemens 1FK2-05"].holds) == (5, 8)


def test_amplifiers_have_the_currents_of_their_names():
    """The 50/5 of maxon give 5 A; KEBA's peak is 200 % of the rated current for 30 s."""
    amplifiers = pf.load_catalog().amplifiers
    for name, a in amplifiers.items():
        if name.startswith("maxon"):
            assert (a.continuous_current, a.current) == (float(name.split("/")[1]), "peak")
        elif name.startswith("KEBA"):
            assert (a.peak_current, a.peak_time) == (2 * a.continuous_current, 30.0)
        elif name.startswith("mjbots"):
            assert (a.peak_time, a.current, a.min_voltage) == (None, "peak", 10.0)
        else:
            assert (a.peak_time, a.current) == (None, "rms")
            assert 1.8 < a.peak_current / a.continuous_current <= 2.0, name


#: Diameter of a gearhead (mm) -> where its maker states the radial load (m from the flange).
AT_FLANGE = {"22": 0.010, "32": 0.010, "42": 0.012, "52": 0.012, "62": 0.024, "81": 0.024}


def test_maxons_gearheads_have_the_loads_of_their_own_rows():
    """A shifted row shows: with more stages the radial load of a type never falls."""
    gears = {n: g for n, g in pf.load_catalog().gears.items() if n.startswith("maxon GP")}
    heads = {n: g for n, g in gears.items() if g.kind == "planetary"}
    assert len(heads) == 30
    types = {name.split(" i=")[0] for name in heads}
    for kind in types:
        stages = [g for n, g in heads.items() if n.split(" i=")[0] == kind]
        radial = [g.bearing.max_radial for g in stages]
        assert radial == sorted(radial), kind
        arm = AT_FLANGE[kind.split()[2]]
        assert [g.bearing.max_moment for g in stages] == pytest.approx([arm * f for f in radial])
        assert lacks("other gear", stages[0]) == ("stiffness",)
    printed = {
        "GP 22 HP i=198": (110, 100),
        "GP 32 C i=246": (220, 120),
        "GP 42 C i=3.5": (120, 150),
        "GP 52 C i=150": (900, 200),
        "GP 42 HD i=150": (720, 250),
        "GP 62 A i=71": (570, 120),
        "GP 81 A i=3.7": (400, 80),
        "GPX 32 UP i=243": (250, 110),
    }
    for name, loads in printed.items():
        bearing = heads[f"maxon {name}"].bearing
        assert (bearing.max_radial, bearing.max_axial) == loads, name


@pytest.mark.parametrize("ratio", [80, 100])
def test_strain_wave_gears_whose_efficiency_has_a_stand_in_can_be_signed(ratio):
    gears = pf.load_catalog().gears
    sizes = [17, 20, 25, 32, 40, 45, 50, 58, 65]
    for size in sizes:
        assert lacks("strain wave", gears[f"Harmonic Drive CSG-{size}-{ratio}"]) == (), size
    assert lacks("strain wave", gears["Harmonic Drive CSG-14-80"]) == ("efficiency",)


def test_every_bundled_entry_says_what_fits_it():
    """Kits have no shaft; maxon's pinions fit maxon's motors; 13 of 84 brakes are sold alone."""
    catalog = pf.load_catalog()
    assert all(
        m.mounting and g.input for m in catalog.motors.values() for g in catalog.gears.values()
    )
    kits = {n for n, m in catalog.motors.items() if m.mounting == "frameless"}
    assert kits == {n for n, m in catalog.motors.items() if "frameless" in m.note}
    assert {g.motors for n, g in catalog.gears.items() if n.startswith("maxon")} == {("maxon",)}
    assert {g.input for g in catalog.gears.values() if g.kind == "strain wave"} == {"bore"}
    alone = [n for n, b in catalog.brakes.items() if b.sold == "alone"]
    assert len(alone) == 13
    assert all(n.startswith("Kendrion") for n in alone)
    assert all(n.startswith(b.sold) for n, b in catalog.brakes.items() if n not in alone)


def written(path, key, value, **more):
    """The catalogue of one drive with another value of a key; "none" leaves it out."""
    content = {"motors": {"M": {**MOTOR, **more}}, "gears": {"G": dict(GEAR)}}
    node, (*places, last) = content, key.split(".")
    for place in places:
        node = node.setdefault(place, {})
    node[last] = yaml.safe_load(value)
    if value == "none":
        del node[last]
    return write_catalog(path / "catalog.yaml", **content)


WRONG = """
motors.M.kt                     0.1              unknown key `motors.M.kt`
motors.M                        {rotor_inertai: 1.0e-5}   did you mean 'rotor_inertia'
motro                           {}               unknown key `motro`.*there are: pinfric_catalog
motors.M.source                 none             `motors.M.source` is missing
motors.M.grade                  A                motors.M.grade
motors.M.mass                   -1               motors.M.mass.*greater than 0
motors.M.mass                   0.6 kg           should be a number.*0.6 kg
motors.M.peak_torque            0.2              motors.M.*swapped
motors.M.stall_torque           3.0              need `nominal_voltage`
gears.G.efficiency              80               gears.G.efficiency.*at most 1
gears.G.ratio                   0                gears.G.ratio
gears.G.no_load_running_torque  5.0              more than the whole loss
gears.G.stand_ins               {colour: H}      stand_ins.*colour
conditions.bus_voltage          0                conditions.bus_voltage
conditions.bus_volts            24               bus_volts.*bus_voltage
extends                         defualt          extends.*'default'
"""


@pytest.mark.parametrize(("key", "value", "text"), table(WRONG))
def test_wrong_entries_are_named_with_file_and_key(tmp_path, key, value, text):
    path = written(tmp_path, key, value)
    with pytest.raises(CatalogError, match=f"^{path}.*{text}"):
        pf.load_catalog(path)


def test_format_version_and_file_are_needed(tmp_path):
    (tmp_path / "a.yaml").write_text("motors: {}\n")
    with pytest.raises(CatalogError, match="`pinfric_catalog` is missing"):
        pf.load_catalog(tmp_path / "a.yaml")
    with pytest.raises(CatalogError, match=r"there is no file .*none\.yaml"):
        pf.load_catalog(tmp_path / "none.yaml")
    with pytest.raises(CatalogError, match="did you mean 'default'"):
        pf.load_catalog("defualt")
    with pytest.raises(CatalogError, match=r"no motors, gears.*`extends: default`"):
        pf.load_catalog(write_catalog(tmp_path / "a.yaml", {}, {}))


DOUBTED = r"""
motors.M.rotor_inertia                 0.5     kg cm\^2
motors.M.rotor_inertia                 0.044   g cm\^2
motors.M.rotor_inertia                 440.0   g cm\^2
motors.M.continuous_torque             224.0   mN m
motors.M.torque_constant               91.0    mN m/A
motors.M.max_speed                     9000.0  rpm
motors.M.mass                          390.0   g entered
gears.G.input_inertia                  0.079   kg cm\^2
gears.G.max_input_speed                7300.0  rpm
gears.G.ratio                          0.01    output turns per motor turn
gears.G.rated_speed                    2000.0  1 to 1000 rad/s; rpm
motors.M.max_speed                     5000.0  up to 3000 W/kg expected; rpm
"""
TOGETHER = r"""
motors.M.torque_constant               1.0     N m/A.* = 0.1 N m/A expected
motors.M.torque_constant               0.01    N m/A.* = 0.1 N m/A expected
motors.M.stall_torque                  60.0    N m.* = 6 N m expected
motors.M.stall_torque                  0.6     N m.* = 6 N m expected
motors.M.no_load_speed                 48.0    max_speed = 600 rad/s.*up to 9 times expected; rpm
motors.M.thermal.winding_time          0.3333  more than 1 s expected
motors.M.thermal.winding_time          20e+3   less than housing_time = 300 s expected
motors.M.thermal.max_winding           398.0   kelvin
"""
#: A motor whose speed-torque line is consistent: k omega_0 = U, T_stall = k U/R.
LINE = {"nominal_voltage": 48.0, "no_load_speed": 480.0, "stall_torque": 6.0}


@pytest.mark.parametrize(
    ("key", "value", "text", "more"),
    [(*row, x) for rows, x in ((DOUBTED, {}), (TOGETHER, LINE)) for row in table(rows)],
)
def test_units_that_cannot_be_right_are_questioned(tmp_path, key, value, text, more):
    """By a figure alone, and by a contradiction to others of the speed-torque line."""
    more = more | {"peak_torque": None, "thermal": dict(MOTOR["thermal"])}
    path = written(tmp_path, key, value, **more)
    with pytest.warns(pf.PinfricWarning, match=rf"^{path}: {key[:4]}.*{text}"):
        pf.load_catalog(path)


def test_rpm_of_a_gearmotor_is_questioned(tmp_path):
    entry = "{source: x, grade: R, ratio: 9, continuous_torque: 9, nominal_voltage: 48, mass: 0.49}"
    fast = yaml.safe_load(entry) | {"no_load_speed": 570.0}
    path = write_catalog(tmp_path / "c.yaml", gearmotors={"A": fast})
    with pytest.warns(pf.PinfricWarning, match=r"gearmotors\.A: no_load_speed = 570 .*rpm"):
        pf.load_catalog(path)


def test_plausible_figures_raise_no_question(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        one_drive(tmp_path)
        one_drive(tmp_path, motor=LINE)
        one_drive(tmp_path, gear={"input_inertia": 0.0})  # zero is no slip of a unit


def test_conditions_of_the_caller_go_before_those_of_the_file(tmp_path):
    catalog = one_drive(tmp_path, conditions={"bus_voltage": 24.0, "ambient": 35.0})
    assert catalog.conditions.bus_voltage == 24.0
    merged = parse_conditions({"bus_voltage": 60.0}, catalog.conditions)
    assert (merged.bus_voltage, merged.ambient) == (60.0, 35.0)
    assert parse_conditions({}, catalog.conditions) == catalog.conditions
    merged = parse_conditions(Conditions(bus_voltage=60.0), catalog.conditions)  # what it sets
    assert (merged.bus_voltage, merged.ambient) == (60.0, 35.0)
    assert parse_conditions({"bus_limit": 30.0}, catalog.conditions).bus_limit == 30.0
    with pytest.raises(CatalogError, match="conditions: unknown key `volts`"):
        parse_conditions({"volts": 1.0}, Conditions())


def test_a_catalogue_that_extends_the_bundled_one(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "pinfric_catalog": 1,
                "extends": "default",
                "conditions": {"bus_voltage": 24.0, "mass_in_urdf": {"joint_2": 1.5}},
            }
        )
    )
    bundled, mine = pf.load_catalog(), pf.load_catalog(path)
    assert mine.source == str(path)
    assert (mine.motors, mine.gears, mine.gearmotors, mine.bearings) == (
        bundled.motors,
        bundled.gears,
        bundled.gearmotors,
        bundled.bearings,
    )
    assert (mine.conditions.bus_voltage, mine.conditions.ambient) == (24.0, 40.0)
    assert mine.conditions.mass_in_urdf == {"joint_2": 1.5}
    assert bundled.conditions == Conditions()
    # of the same name the file's entry is taken, whole
    name = "maxon RE 40 148867"
    write_catalog(path, {name: MOTOR, "mine": MOTOR}, {}, extends="default")
    with pytest.warns(pf.PinfricWarning, match=rf"motors\.{name} replaces the bundled entry"):
        own = pf.load_catalog(path)
    assert own.motors[name].source == "invented"
    assert own.replaced == (f"motors.{name} replaces the bundled entry of that name",)
    assert own.motors[name].nominal_voltage is None
    assert own.motors.keys() == {*bundled.motors, "mine"}


def test_catalogues_are_part_of_the_package():
    folder = Path(pf.__file__).parent / "catalog"
    names = {path.name for path in folder.iterdir()}
    assert {"motors.yaml", "gears.yaml", "bearings.yaml", "brakes.csv", "amplifiers.yaml"} <= names
    for path in folder.glob("*.csv"):
        assert f"{path.stem}.columns.yaml" in names
    for path in folder.glob("*.yaml"):
        if path.name.count(".") == 1:
            assert yaml.safe_load(path.read_text())["pinfric_catalog"] == 1


#: Servo -> base, load-dependent, viscous friction as BAM's files print them, and efficiency.
BAM = {
    "Robotis Dynamixel MX-64": (0.1022, 0.0758, 0.0006, 0.859),
    "Robotis Dynamixel MX-106": (0.1134, 0.1082, 0.0119, 0.805),
    "Robotis Dynamixel XL-320": (0.0206, 0.2190, 0.0023, 0.641),
    "Robotis Dynamixel XL330-M288": (0.0089, 0.1217, 0.0044, 0.783),
    "Feetech STS3215 7.4 V": (0.0556, 0.2116, 0.0315, 0.651),
    "ZeroErr eRob80:50": (3.467, 0.0629, 1.207, 0.882),
    "ZeroErr eRob80:100": (4.832, 0.1480, 7.395, 0.742),
}


@pytest.mark.parametrize("name", BAM)
def test_a_servos_losses_grow_with_its_load_as_they_were_identified(name):
    """On a pendulum that is raised: u - t = base + share (u + t) + viscous v, solved for u."""
    base, share, viscous, efficiency = BAM[name]
    entry = pf.load_catalog().gearmotors[name]
    if entry.rotor_inertia is None:
        entry = entry.model_copy(update={"rotor_inertia": 1e-7})
    gear = gearmotor_drive(name, entry).transmission
    assert gear.efficiency == gear.back_efficiency == pytest.approx(efficiency, abs=5e-4)
    bare = pf.load_scene("pendulum")
    scene = bare.with_(friction={}, actuators=[{"joint": "joint_1", "transmission": gear}])
    q, v = np.array([[0.5], [1.0], [1.4]]), np.array([[0.3], [1.0], [2.0]])
    for way in (1.0, -1.0):
        rising = way * q
        found = pf.inverse_dynamics(scene, rising, way * v, 0.0 * v)
        load = way * found.effort_frictionless[:, 0]
        assert (load > 0.0).all()
        u = way * entry.ratio * found.motor_torque_lower[:, 0]
        assert u - load == pytest.approx(base + share * (u + load) + viscous * v[:, 0], rel=1e-12)


#: Kind -> its torque, and its rules: mass a T^0.75 kg, inertia at the input b m^(5/3) kg m^2, as of
#: bodies of one shape; a and b are near the medians of the bundled ones.
RULES = {
    "stepper": ("holding_torque", 0.73, 3.2e-5),
    "frameless": ("continuous_torque", 0.53, 2.2e-4),
    "motor": ("continuous_torque", 1.3, 2.9e-5),
    "flat motor": ("continuous_torque", 1.3, 5.5e-4),
    "gearmotor": ("peak_torque", 0.045, 1.2e-4),
    "servo": ("stall_torque", 0.045, 1.4e-5),
    "strain wave": ("rated_torque", 0.070, 2.4e-5),
    "planetary": ("rated_torque", 0.12, 9e-6),
    "planetary of stages": ("rated_torque", 0.12, 2.5e-6),
    "cycloidal": ("rated_torque", 0.10, None),
    "belt": ("rated_torque", 0.084, 1.8e-4),
}


def kind_of_row(section, name, entry):
    """Its kind of `RULES`; "": screws and linear motors have none."""
    if section == "motors":
        flat = "flat motor" if " flat " in name else "motor"
        return (
            "stepper" if entry.stepper else "frameless" if entry.mounting == "frameless" else flat
        )
    if entry.output == "linear":
        return ""
    if section == "gearmotors":
        return "servo" if entry.stall_torque else "gearmotor"
    return entry.kind + " of stages" * (entry.kind == "planetary" and max(entry.ratios) > 12)


@pytest.mark.parametrize("section", ["motors", "gears", "gearmotors"])
def test_masses_and_inertias_are_those_of_their_kind_or_a_note_says_why(section):
    odd = {}
    for name, entry in getattr(pf.load_catalog(), section).items():
        if not (kind := kind_of_row(section, name, entry)):
            continue
        figure, a, b = RULES[kind]
        torque = getattr(entry.stepper if kind == "stepper" else entry, figure)
        inertia = getattr(entry, "input_inertia" if section == "gears" else "rotor_inertia")
        off = [entry.mass / (a * torque**0.75)] if entry.mass and torque else []
        off += [inertia / (b * entry.mass ** (5 / 3))] if entry.mass and inertia and b else []
        if any(not 0.2 <= x <= 5.0 for x in off) and not entry.note:
            odd[name] = off
    assert odd == {}
