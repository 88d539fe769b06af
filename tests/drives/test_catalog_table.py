"""Tables of makers as catalogues, and the bill of materials."""

import csv
import io
import re
import warnings
from pathlib import Path

import numpy as np
import pytest
from cli_cases import told
from sizing_cases import GEAR, MOTOR, sized_cycle, turntable, write_catalog

from pinfric.drives.bearing import BearingRatings, Factors
from pinfric.drives.catalog import BearingEntry, Brake, Gear, GearMotor, Motor, Screw
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.table import import_table
from pinfric.drives.table import write_catalog as write_content
from pinfric.drives.thermal import Thermal
from pinfric.drives.units import cells_of, in_si, unit_of
from pinfric.errors import CatalogError, PinfricWarning
from pinfric.model.entry import Entry
from pinfric.model.yamlfile import yaml_text
from pinfric.show.report.bill import bill_of_materials

MAPPING = """
section: motors
columns:
  name: Type
  continuous_torque: {column: Mn, unit: mN m}
  peak_torque: {column: Mmax, unit: mN m}
  rotor_inertia: {column: J, unit: g cm^2}
  max_speed: {column: n, unit: rpm}
  mass: {column: Weight, unit: g}
  thermal.winding_housing: {column: Rth1, unit: K/W}
  thermal.housing_ambient: {column: Rth2, unit: K/W}
  price: EUR
  dimensions: Size
every: {source: "a maker, p. 3", grade: R}
"""
HEAD = "Type,Mn,Mmax,J,n,Weight,Rth1,Rth2,EUR,Size,unused\n"


def table(tmp_path, rows, head=HEAD, mapping=MAPPING):
    (tmp_path / "motors.csv").write_text(head + rows, encoding="utf-8")
    (tmp_path / "motors.columns.yaml").write_text(mapping)
    return tmp_path / "motors.csv"


def test_a_table_becomes_a_catalogue_in_si(tmp_path):
    path = table(
        tmp_path,
        '"M 1",224,0.9 N m,44,6000,390,1.35,7.17,312.5,"40 x 80 mm",x\n\n'
        "M 2,100,300,20,0.5 1/min,-,,,,\n",
    )
    write_content(import_table(path).content, tmp_path / "m.yaml", path.name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # half a turn a minute is questioned
        one, two = load_catalog(tmp_path / "m.yaml").motors.values()
    assert (one.continuous_torque, one.peak_torque) == pytest.approx((0.224, 0.9))
    shown = [cell for _, _, cell, *_ in import_table(path).first]
    assert shown[1:4] == ["224 mN m", "0.9 N m", "44 g cm^2"]  # its own unit, else the mapping's
    assert one.rotor_inertia == pytest.approx(4.4e-6)
    assert one.max_speed == pytest.approx(6000 * np.pi / 30)
    assert two.max_speed == pytest.approx(0.5 * np.pi / 30)
    assert (one.mass, one.price, one.dimensions) == (0.39, 312.5, "40 x 80 mm")
    assert one.thermal == Thermal(winding_housing=1.35, housing_ambient=7.17)
    assert (one.source, one.grade) == ("a maker, p. 3", "R")
    assert (two.mass, two.thermal, two.price) == (None, None, None)


@pytest.mark.parametrize("above", ["# ", "#", "# made by hand\n# "])
def test_a_header_behind_a_hash_is_the_header(tmp_path, above):
    """As many names as cells, and figures only below; any other comment is none."""
    row = "A,120,360,48,9000,25,4.4,31,12.5,d20,x\n"
    plain = import_table(table(tmp_path, row), tmp_path / "motors.columns.yaml")
    marked = import_table(table(tmp_path, row, head=above + HEAD), tmp_path / "motors.columns.yaml")
    assert marked.content == plain.content
    commented = import_table(
        table(tmp_path, row, head="# a,b,c,d,e,f,g,h,i,j,k\n" + HEAD),
        tmp_path / "motors.columns.yaml",
    )
    assert commented.content == plain.content


def test_the_mapping_of_the_reference_page_is_one(tmp_path):
    page = Path(__file__).parents[2] / "notebooks" / "reference" / "table.md"
    (mapping,) = re.findall(r"^```yaml\n(.*?)^```$", page.read_text("utf-8"), re.DOTALL | re.M)
    path = table(tmp_path, "M,224,44,1.35,7.17\n", "Type,Mn,J (g cm^2),Rth1,Rth2\n", mapping)
    (motor,) = import_table(path).content["motors"].values()
    assert motor["rotor_inertia"] == pytest.approx(4.4e-6)
    assert motor["thermal"] == {"winding_housing": 1.35, "housing_ambient": 7.17}


def test_what_every_row_has_is_not_shared_between_rows(tmp_path):
    """Rows add to the same part: none may write into another's, nor inherit its omissions."""
    thermal = "thermal: {winding_housing: 1.0, housing_ambient: 2.0}"
    mapping = MAPPING.partition("  thermal.")[0] + (
        "  thermal.winding_time: {column: tau, unit: s}\n"
        f"every: {{source: a maker, grade: R, {thermal}}}\n"
    )
    path = table(
        tmp_path,
        "A,9,9,9,9,9,20\nB,9,9,9,9,9,40\nC,9,9,9,9,9,-\n",
        "Type,Mn,Mmax,J,n,Weight,tau\n",
        mapping,
    )
    motors = import_table(path).content["motors"]
    times = [motors[name]["thermal"].get("winding_time") for name in "ABC"]
    assert times == [20.0, 40.0, None]


@pytest.mark.parametrize("separator", [";", "\t", ","])
@pytest.mark.parametrize(
    ("cells", "rpm"),
    [
        (("3,000", "0.5"), 3000.0),
        (("6'000", "0.5"), 6000.0),
        (("3.000", "0,5"), 3000.0),
        (("3,000", "1,234.5"), 3000.0),
        (("1,234.5", "1"), 1234.5),
        (("1.234,5", "1"), 1234.5),
        (("1,234,567", "1"), 1234567.0),
        (("3,000", "2,5"), 3.0),
        (("3.000", "2.5"), 3.0),
        (("3.000e0", "9"), 3.0),
    ],
)
def test_marks_are_decimal_or_of_thousands_as_the_whole_table_shows(
    tmp_path, separator, cells, rpm
):
    row = separator.join(["M", "224", "900", "44", f'"{cells[0]}"', f'"{cells[1]}"', *[""] * 5])
    path = table(tmp_path, row + "\n", HEAD.replace(",", separator))
    (motor,) = import_table(path).content["motors"].values()
    assert motor["max_speed"] == pytest.approx(rpm * np.pi / 30)


def test_marks_that_may_be_either_are_refused(tmp_path):
    head = HEAD.replace(",", ";")
    for cell in ("3,000", "3.000"):
        with pytest.raises(CatalogError, match=r"line 2 \(M\): max_speed: '3.000' has a decimal"):
            import_table(table(tmp_path, f"M;224;900;44;{cell};390;;;;;\n", head))
    with pytest.raises(CatalogError, match=r"'2,5' has a decimal comma and '0.5' a decimal point"):
        import_table(table(tmp_path, "M;224;900;44;2,5;0.5;;;;;\n", head))
    path = table(tmp_path, "M,224,900,44,3.000,390,,,,,\n")  # commas separate the cells
    assert import_table(path).content["motors"]["M"]["max_speed"] == pytest.approx(3 * np.pi / 30)


def test_what_slides_has_units_of_what_slides(tmp_path):
    """A linear motor's rotor is a mass; one with a screw turns: J r^2 = 1e-5 (2 pi/0.005)^2 kg."""
    head = "Type,F,J,lead,k,K,v\n"
    mapping = """
section: gearmotors
columns:
  name: Type
  continuous_torque: {column: F, unit: kN}
  rotor_inertia: {column: J, unit: UNIT}
  ratio: {column: lead, unit: mm/rev}
  torque_constant: {column: k, unit: N/A}
  stiffness: {column: K, unit: N/um}
  max_speed: {column: v, unit: mm/s}
every: {source: a maker, grade: T, output: linear}
"""

    def read(row, mapping):
        (found,) = import_table(table(tmp_path, row, head, mapping)).content["gearmotors"].values()
        return found

    found = read("S,2,0.1,5,40,20,500\n", mapping.replace("UNIT", "kg cm^2"))
    assert (found["continuous_torque"], found["max_speed"]) == pytest.approx((2000.0, 0.5))
    assert found["rotor_inertia"] == pytest.approx(1e-5)
    assert found["ratio"] == pytest.approx(2 * np.pi / 0.005)
    assert (found["torque_constant"], found["stiffness"]) == (40.0, pytest.approx(2e7))
    printed = mapping.replace("UNIT", "kg").replace("mm/rev", "rad/m")
    assert read("L,2,0.4,1,40,20,500\n", printed)["rotor_inertia"] == 0.4
    direct = mapping.replace("UNIT", "g").replace("  ratio: {column: lead, unit: mm/rev}\n", "")
    direct = direct.replace("output: linear", "output: linear, ratio: 1.0")
    assert read("L,2,200,5,40,20,500\n", direct)["rotor_inertia"] == pytest.approx(0.2)
    with pytest.raises(CatalogError, match=r"kg m\^2 is not a unit of this value; take kg, g, lb"):
        read("L,2,200,5,40,20,500\n", direct.replace("unit: g", "unit: kg m^2"))


def test_brakes_and_bearings_and_what_is_taken_from_elsewhere(tmp_path):
    mapping = """
section: brakes
columns:
  name: Type
  torque: {column: M, unit: N m}
  engage_time: {column: t, unit: ms}
  stop_energy: {column: W, unit: kJ}
  rotor_inertia: {column: J, unit: kg cm^2}
  stand_ins.rotor_inertia: J of
every: {source: "a maker, p. 3", grade: R}
"""
    path = table(tmp_path, "B,.5,25,1.2,0.08,the size above\n", "Type,M,t,W,J,J of\n", mapping)
    write_content(import_table(path).content, tmp_path / "b.yaml")
    (brake,) = load_catalog(tmp_path / "b.yaml").brakes.values()
    assert (brake.torque, brake.engage_time, brake.stop_energy) == (0.5, 0.025, 1200)
    assert (brake.rotor_inertia, brake.stand_ins) == (8e-6, {"rotor_inertia": "the size above"})
    mapping = """
section: bearings
columns: {name: Type, ratings.dynamic_rating: {column: C, unit: kN}}
every: {source: "a maker, p. 3", grade: R, ratings: {kind: crossed roller}}
"""
    path = table(tmp_path, "RB,7.35\n", "Type,C\n", mapping)
    write_content(import_table(path).content, tmp_path / "r.yaml")
    (bearing,) = load_catalog(tmp_path / "r.yaml").bearings.values()
    assert bearing.ratings.dynamic_rating == 7350


def test_a_row_that_cannot_be_costs_itself_and_a_line(tmp_path, capsys):
    rows = (
        "good,224,900,44,6000,390,,,,,\n"
        "swapped,900,224,44,6000,390,,,,,\n"
        "amount,many,900,44,6000,390,,,,,\n"
        "quantity,224 rpm,900,44,6000,390,,,,,\n"
        "unit,224 mNn,900,44,6000,390,,,,,\n"
        "good,224,900,44,6000,390,,,,,\n"
        ",224,900,44,6000,390,,,,,\n"
        "light,224,900,44,6000,-390,,,,,\n"
        "digits,\N{FULLWIDTH DIGIT TWO}24,900,44,6000,390,,,,,\n"
        "score,2_24,900,44,6000,390,,,,,\n"
    )
    path = table(tmp_path, rows)
    found = import_table(path)
    assert list(found.content["motors"]) == ["good"]
    assert found.unused == ("unused",)
    assert found.first[1] == ("Mn", "continuous_torque", "224 mN m", "0.224", "N m")
    for line, part in zip(
        found.left_out,
        (
            "line 3 (swapped): continuous_torque 0.9 is more than peak_torque 0.224: swapped",
            "line 4 (amount): continuous_torque: should be a number, found 'many'",
            "line 5 (quantity): continuous_torque: rpm is not a unit of this value; take N m, mN m",
            "line 6 (unit): continuous_torque: the unit 'mNn' is not known",
            "line 7 (good): this name is given twice",
            "line 8 (no name): no name",
            "line 9 (light): `mass`",
            "line 10 (digits): continuous_torque: should be a number",
            "line 11 (score): continuous_torque: the unit '_24' is not known",
        ),
        strict=True,
    ):
        assert part in line
    (tmp_path / "made").mkdir()
    said = told(capsys, "catalog", path, "--out", tmp_path / "made" / "mine.yaml")
    for part in ("columns not used: unused", "9 rows left out:", "line 6 (unit)", "0.224 N m"):
        assert part in " ".join(said.out.split())
    with pytest.warns(PinfricWarning, match=r"left out: line 3 \(swapped\).* 8 rows more"):
        load_catalog(tmp_path)


def test_a_table_of_which_no_row_can_be_read_says_what_was_understood(tmp_path):
    mapping = MAPPING.replace("{column: J, unit: g cm^2}", "J")  # inertias without unit
    path = table(tmp_path, "A,224,900,44,6000,390,,,,,\nB,2,9,44,6000,390,,,,,\n", mapping=mapping)
    with pytest.raises(
        CatalogError, match=r"none of its 2 rows .* line 2 \(A\): rotor_inertia: 44 "
    ):
        import_table(path)
    with pytest.raises(
        CatalogError, match="were the columns Type as name, Mn as continuous_torque"
    ):
        import_table(path)


GRAVITY, INCH, POUND = 9.80665, 0.0254, 0.45359237
OUNCE = POUND / 16
OZ_IN, TURN = OUNCE * GRAVITY * INCH, 2 * np.pi
#: Unit, what one is in SI, and its spellings in tables of makers and shops.
SPELLINGS = [
    ("rad/s", TURN / 60, "RPM, rpm, Rpm, r/min, rev/min, min-1, min^-1, 1/min, U/min, min⁻¹"),
    ("rad/s", TURN / 360, "deg/s, °/s"),
    ("rad/s", TURN / 0.06, "krpm"),
    ("rad/s", TURN / 6, "s/60°, sec/60deg, s/60 deg"),
    ("N m", 1.0, "N.m, Nm, N-m, N*m, NM, N·m, [Nm]"),
    ("N m", 1e-3, "mNm, mN.m, mN-m, mN·m"),
    ("N m", 1e-2, "Ncm, N.cm, N-cm"),
    ("N m", GRAVITY * 1e-2, "kg.cm, kg-cm, kgcm, Kg.cm, KG-CM, kgf.cm, kgf-cm"),
    ("N m", GRAVITY * 1e-5, "g.cm, gf-cm"),
    ("N m", OZ_IN, "oz-in, oz.in, ozin, OZ-IN, in-oz, ozf-in"),
    ("N m", 16 * OZ_IN, "lb-in, in-lbs, lb.in"),
    ("N m", 192 * OZ_IN, "lb-ft, ft-lb"),
    ("kg m^2", 1e-7, "gcm2, g.cm2, g-cm2, gcm^2, g·cm²"),
    ("kg m^2", 1e-4, "kgcm2, kg.cm2, x10-4 kg.m2, 10^-4 kgm2"),
    ("kg m^2", 1.0, "kg-m2, kgm²"),
    ("kg m^2", OUNCE * INCH**2, "oz-in2"),
    ("kg m^2", OZ_IN, "oz-in-s2, oz-in-s^2"),
    ("N m/A", 1.0, "Nm/A, N.m/Arms"),
    ("N m/A", OZ_IN, "oz-in/A"),
    ("N m/A", 0.06 / TURN, "V/krpm, mV/rpm, mV/min-1, V/1000rpm"),
    ("kg", POUND, "lbs"),
    ("kg", 1.0, "Kg, KG"),
    ("kg", OUNCE, "oz"),
    ("kg", 1e-3, "gr"),
    ("V", 1.0, "VDC, Vdc, Volts"),
    ("A", 1.0, "Amps, Arms"),
    ("ohm", 1.0, "Ohms, \N{OHM SIGN}"),
    ("ohm", 1e-3, "mOhm, mΩ"),
    ("rad", TURN / 21600, "arcmin, arc-min, arc min, arc.min"),
    ("N m/rad", 21600 / TURN, "Nm/arcmin, Nm/', N.m/\N{PRIME}"),
    ("N m/rad", 1296000 / TURN, "Nm/'', Nm/\N{DOUBLE PRIME}"),
    ("N m/rad", 1e3, "kNm/rad"),
    ("rad/m", TURN * 1e3, "mm, mm/rev"),
    ("C", 1.0, "°C, degC"),
    ("W", 1.0, "Watts"),
    ("W", 1e3, "kW"),
    ("1/h", 60.0, "1/min"),
    ("Pa", 1e6, "N/mm/mm"),  # all behind the first "/" divides
    ("N", 1.0, "kg m/s/s"),
    ("1", 0.01, "%"),
]


@pytest.mark.parametrize(("wanted", "size", "units"), SPELLINGS)
def test_spellings_of_units(wanted, size, units):
    for unit in units.split(", "):
        assert in_si(1.0, unit, wanted) == pytest.approx(size, rel=1e-12), unit


@pytest.mark.parametrize(
    ("unit", "wanted"),
    [
        *(("N m/rad", "N m"), ("N m", "N m/rad"), ("kg m^2", "N m"), ("V/rad", "A"), ("kg", "rad")),
        *(("mNn", "N m"), ("N m/", "N"), ("/s", "rad/s"), ("min", "m"), ("N^x", "N")),
    ],
)
def test_units_of_another_quantity_are_refused(unit, wanted):
    with pytest.raises(CatalogError, match=r"is not (a unit|known)"):
        in_si(1.0, unit, wanted)


#: Tables in the forms of shops and makers: a servo, a stepper as a motor, a servo motor, a gearbox.
#: Section; the table; key and column, and unit where the cells have none; rows that can be read.
TABLES = [
    (
        "gearmotors",
        "Model,Stall torque,No load speed,Weight,Voltage,Gear ratio,Link\n"
        "A,1.9 N.m,57 RPM,82 g,12V,272.5 : 1,http\nB,25 kg.cm,0.16 s,60g,6-8.4 V,1:345,http\n"
        "C,30 kg-cm,nan,0.14 lbs,-,288:1,\n",
        "peak_torque=Stall torque, max_speed=No load speed, mass=Weight, ratio=Gear ratio, "
        "nominal_voltage=Voltage",
        "A C",
        {"peak_torque": 1.9, "max_speed": 57 * TURN / 60, "mass": 0.082, "ratio": 272.5},
    ),
    (
        "gearmotors",
        "Model,Speed (s/60°),Weight (gr),Ratio,V\nA,0.20,55,1/254,6\n",
        "no_load_speed=Speed (s/60°)=s/60°, mass=Weight (gr)=gr, ratio=Ratio, nominal_voltage=V=V",
        "A",
        {"no_load_speed": TURN / 1.2, "mass": 0.055, "ratio": 254.0},
    ),
    (
        "motors",
        "sku;torque oz-in;inertia;amps;weight\nS17;62,3;82 gcm2;1,68 Amps;0,63 lbs\n",
        "continuous_torque=torque oz-in=oz-in, rotor_inertia=inertia, mass=weight",
        "S17",
        {"continuous_torque": 62.3 * OZ_IN, "rotor_inertia": 8.2e-6},
    ),
    (
        "motors",
        "Type\tM0 [Nm]\tnN [min-1]\tJ [10-4 kgm2]\tKT [Nm/Arms]\tm [kg]\n"
        "AM\t1.5\t6000\t0.77\t0.45\t2.1\n",
        "continuous_torque=M0 [Nm]=Nm, max_speed=nN [min-1]=min-1, "
        "rotor_inertia=J [10-4 kgm2]=10-4 kgm2, torque_constant=KT [Nm/Arms]=Nm/Arms",
        "AM",
        {"rotor_inertia": 0.77e-4, "max_speed": 100 * TURN, "torque_constant": 0.45},
    ),
    (
        "gears",
        "name,i,T2N,J1,backlash\nPLE,9:1,130 Nm,0.14 kgcm2,7 arc-min\n"
        "PLF,9/1,130 Nm,0.14 kgcm2,7'\nPLX,n.a.,1 Nm,-,-\n",
        "ratio=i, rated_torque=T2N, input_inertia=J1, backlash=backlash",
        "PLE PLF",
        {"ratio": 9.0, "rated_torque": 130.0, "backlash": 7 * TURN / 21600},
    ),
]


@pytest.mark.parametrize(("section", "text", "columns", "read", "figures"), TABLES)
def test_tables_in_the_forms_of_shops_and_makers(tmp_path, section, text, columns, read, figures):
    mapping = {"section": section, "columns": {"name": re.split("[,;\t]", text)[0]}}
    for column in columns.split(", "):
        key, name, *unit = column.split("=")
        mapping["columns"][key] = {"column": name, "unit": unit[0]} if unit else name
    mapping["every"] = {"source": "a shop", "grade": "T"}
    if section == "gears":
        mapping["every"]["kind"] = "planetary"
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    (tmp_path / "t.columns.yaml").write_text(yaml_text(mapping))
    found = import_table(tmp_path / "t.csv")
    entries = found.content[section]
    assert list(entries) == read.split(), found.left_out
    for entry in entries.values():
        if entry is entries[read.split()[0]] or section == "gears":  # spelled otherwise
            for figure, value in figures.items():
                assert entry[figure] == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("mapping", "text"),
    [
        ("section: motors\ncolumns: {name: Typ}\n", "has no column 'Typ'; did you mean 'Type'"),
        ("section: motors\ncolumns: {mass: Weight}\n", "which column has the names"),
        ("section: motor\ncolumns: {name: Type}\n", "'motors'"),
        ("section: motors\ncolumns: {name: Type, masss: n}\n", "nearest of 42: 'mass'"),
    ],
)
def test_mappings_that_cannot_be(tmp_path, mapping, text):
    with pytest.raises(CatalogError, match=text):
        import_table(table(tmp_path, "M,1,2,3,4,5,,,,,\n", mapping=mapping))


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(CatalogError, match=r"none.csv"):
        import_table(tmp_path / "none.csv")
    path = table(tmp_path, "")
    with pytest.raises(CatalogError, match="no rows below"):
        import_table(path)
    path.write_bytes(b"Type\n\xff\xfe\n")
    with pytest.raises(CatalogError, match="in UTF-8"):
        import_table(path)


def test_every_number_of_an_entry_has_a_unit_by_which_it_can_be_imported():
    parts: tuple[tuple[type[Entry], type[Entry], str], ...] = (
        (Motor, Motor, ""),
        (Gear, Gear, ""),
        (GearMotor, GearMotor, ""),
        (Motor, Thermal, "thermal."),
        (Gear, Screw, "screw."),
        (Gear, BearingRatings, "bearing."),
        (BearingEntry, BearingRatings, "ratings."),
        (Brake, Brake, ""),
    )
    for entry, part, prefix in parts:
        for name, field in part.model_fields.items():
            if "float" in str(field.annotation) and field.annotation is not Factors:
                if name in ("continuous_curve", "ambient_curve", "effort_curve"):
                    continue  # many numbers, in no one cell
                assert cells_of(entry)[f"{prefix}{name}"]
        for unit in filter(None, cells_of(entry).values()):
            for one in unit.split(" or "):
                assert in_si(1.0, one, one) == 1.0
    assert unit_of(Gear, "rated_torque", linear=True) == "N"
    assert unit_of(Gear, "max_input_speed", linear=True) == "rad/s"
    assert unit_of(GearMotor, "max_speed", linear=True) == "m/s"
    assert unit_of(Gear, "ratio", linear=True) == "rad/m"
    slides = [unit_of(Gear, f"stiffness.{x}", linear=True) for x in ("k1", "t1")]
    assert slides == ["N/m", "N"]
    assert in_si(3.0, "N·m/arcmin", "N m/rad") == pytest.approx(3 * 10800 / np.pi)


def test_bill_of_materials_counts_parts_over_joints(tmp_path):
    motor = {**MOTOR, "price": 200.0, "dimensions": "60 x 90 mm"}
    bearings = {
        "own": {
            "source": "invented",
            "grade": "T",
            "ratings": {"kind": "crossed roller", "max_moment": 1e3},
        }
    }
    path = write_catalog(
        tmp_path / "c.yaml",
        {"M": motor},
        {"G": {**GEAR, "ratio": [50, 100]}},
        bearings=bearings,
        conditions={"bearings": {"table": "own"}},
    )
    scene = turntable()
    report = sized_cycle(path, scene)
    rows = list(csv.DictReader(io.StringIO(bill_of_materials(report))))
    assert [row["part"] for row in rows] == [
        "M",
        f"G, i = {report.joints[0].choice.candidate.ratio:g}",
        "own",
    ]
    assert rows[0] == {
        "part": "M",
        "quantity": "1",
        "joints": "table",
        "mass_kg": "0.6",
        "mass_total_kg": "0.6",
        "price": "200",
        "price_total": "200",
        "dimensions": "60 x 90 mm",
        "source": "invented",
        "grade": "R",
    }
    assert (rows[1]["price"], rows[2]["mass_kg"]) == ("", "")
    assert bill_of_materials(sized_cycle(scene=scene)) == ""


def test_bill_of_materials_of_a_frameless_kit_adds_up_to_the_drive(tmp_path):
    path = write_catalog(
        tmp_path / "c.yaml",
        {"K": {**MOTOR, "mounting": "frameless"}},
        {"G": {**GEAR, "kind": "strain wave", "mass": 0.9}},
    )
    report = sized_cycle(path)
    rows = list(csv.DictReader(io.StringIO(bill_of_materials(report))))
    assert [row["mass_kg"] for row in rows] == ["0.6", "0.9", "0.375"]
    assert rows[2]["source"] == "estimate: 25 % of motor and gear"
    assert sum(float(row["mass_total_kg"]) for row in rows) == pytest.approx(
        report.joints[0].choice.candidate.mass
    )


def test_a_folder_of_catalogues_and_tables_is_one_catalogue(tmp_path):
    """As the bundled one: here a table of motors beside a file of gears and conditions."""
    folder = tmp_path / "parts"
    folder.mkdir()
    table(folder, "M 1,224,900,44,6000,390,1.35,7.17,312.5,,\n")
    write_catalog(folder / "gears.yaml", {}, {"G": GEAR}, conditions={"ambient": 33.0})
    found = load_catalog(folder)
    assert (list(found.motors), list(found.gears)) == (["M 1"], ["G"])
    assert (found.conditions.ambient, found.files) == (33.0, (str(folder),))
    assert found.motors["M 1"].continuous_torque == pytest.approx(0.224)
    (folder / "more.yaml").write_text("pinfric_catalog: 1\nextends: default\n")
    both = load_catalog(folder)
    assert len(both.motors) == len(load_catalog().motors) + 1
    assert both.conditions.ambient == 33.0
    write_catalog(folder / "again.yaml", {}, {"G": GEAR})
    assert list(load_catalog(folder).gears)[-1] == "G"
    write_catalog(folder / "again.yaml", {}, {"G": GEAR | {"mass": 9.0}})
    with pytest.raises(
        CatalogError, match=r"gears\.G: its figures in again.yaml and in gears.yaml differ"
    ):
        load_catalog(folder)
    (tmp_path / "empty").mkdir()
    with pytest.raises(CatalogError, match="empty: no motors, gears"):
        load_catalog(tmp_path / "empty")
