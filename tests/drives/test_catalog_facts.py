"""One figure of each maker and kind of product against what was read in its document, by hand.

Retyped from what was read of the documents, not from the catalogue's tables; `test_every_maker`
names the makers of which none was read.
"""

from functools import reduce
from math import pi

import pytest
from tables import table

from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.policy import lacks

#: The printed unit in the catalogue's.
UNITS = {"-": 1.0, "rpm": pi / 30, "gcm2": 1e-7, "kgcm2": 1e-4, "ms": 1e-3, "kJ": 1e3, "g": 1e-3,
         "arcmin": pi / 10800, "%": 0.01, "mm/rev": 2e3 * pi}  # fmt: skip

#: Section, product, figure, value and unit as printed, and where.
PRINTED = """
motors  maxon EC 45 flat 50 W 251601  continuous_torque  0.0834 -  product page 251601, July 2020
motors  maxon EC 90 flat 220 W 607942  resistance  0.216 -  product page 607942, July 2020
motors  Allied Motion MF0095020  peak_torque  18 -  Megaflux sheet, 48 V windings
motors  Kollmorgen TBM-6025-A  continuous_torque  0.706 -  TBM page
motors  Yaskawa SGM7A-15A  peak_torque  14.7 -  Sigma-7 manual 907516, p. 82
motors  Yaskawa SGM7J-04A  rotor_inertia  0.486 kgcm2  Sigma-7 manual 907516, p. 55
motors  Mitsubishi HG-KN43J  peak_torque  3.8 -  MELSERVO-JE, motor specifications
motors  Fagor FXM74.20A  continuous_stall_torque  27.3 -  FXM table as a converter has it
motors  Beckhoff AS1050  stepper.holding_torque  1.2 -  AS1000 manual, 1426854667
motors  Beckhoff AS1050  stepper.resistance  0.28 -  AS1000 manual, 1426854667
gears  Harmonic Drive CSG-25-100  momentary_peak_torque  369 -  CSG-2UH engineering data
gears  Harmonic Drive CSG-32-100  average_torque  281 -  CSG-2UH engineering data
gears  Harmonic Drive CSG-25-100  stiffness.k2  50000 -  CHA engineering data 1018854
gears  Schaeffler RT1-H-CS 20 i=100  no_load_running_torque  0.105 -  RT1-H-CS data
gears  Beckhoff TP050 MA i=220  rated_torque  794 -  AG2400, 9001045515
gears  Beckhoff TP050 MF i=5  momentary_peak_torque  1250 -  AG2400, 8995561355
gears  Beckhoff TP010 MF i=10  stiffness  79070.4 -  AG2400, 8995369483: 23 N m/arcmin
gears  Neugart PLE060 i=5  repeated_peak_torque  64 -  AG2250, 8411826955
gears  Neugart PLE040 i=7  backlash  15 arcmin  AG2250, 8411770123
gears  Neugart PLE060 i=5  bearing.max_moment  14 -  AG2250, 8411826955: MK, 20,000 h
gears  Neugart PLE060 i=5  bearing.max_axial  500 -  AG2250, 8411826955: Fa, 20,000 h
gears  Neugart PLE040 i=7  bearing.max_moment  5 -  AG2250, 8411770123: MK, 20,000 h
gears  Neugart PLE160 i=8  max_input_speed  6500 rpm  AG2250, 8412002827
gears  Wittenstein NPS015 i=10  rated_torque  19 -  AG3300: NPS015 MF
gears  maxon GP 42 C i=43  rated_torque  15 -  product page, July 2020
gears  maxon GP 42 C i=43  efficiency  72 %  product page, July 2020
gears  maxon GP 32 S ball 10x2, i = 1  rated_torque  386 -  product page 363970, July 2020
gears  ROBOTIS DYD-17-051  back_driving_torque  5 -  DYD gear manual
gears  Zhenkang ZKRV-80E i=81  repeated_peak_torque  2000 -  ZKRV table
gears  Parker OSP-E 32BHD  rated_torque  1870 -  OSP-E catalogue, p. 310
gears  Parker OSP-E 32BHD  no_load_running_torque  2.2 -  OSP-E catalogue, p. 310
gearmotors  CubeMars AK80-64  peak_torque  120 -  AK80-64 page
gearmotors  ZeroErr eRob80i-50  peak_torque  44 -  eRob80i page
gearmotors  MyActuator EPS-RH-20-100  continuous_torque  50 -  EPS-RH page
gearmotors  RobStride RS02  continuous_torque  6 -  RS02 user manual 260428, pp. 9-12
gearmotors  RobStride RS02  mass  405 g  OpenELAB's guide to RS02: 405 g +- 5 g
gearmotors  Damiao DM-J8009P-2EC  peak_torque  40 -  DM-J8009P-2EC manual V1.0
gearmotors  Robotis Dynamixel XW540-T140  max_voltage  14.8 -  e-Manual, xw540-t140
gearmotors  Robotis Dynamixel XW540-T140  stall_torque  6.9 -  e-Manual, xw540-t140, 12 V
gearmotors  Robotis Dynamixel XW540-T260  max_voltage  14.8 -  e-Manual, xw540-t260
gearmotors  Robotis Dynamixel XW540-T260  no_load_speed  40 rpm  e-Manual, xw540-t260, 12 V
gearmotors  Robotis Dynamixel XL330-M077-T  max_voltage  6.0 -  e-Manual, xl330-m077
gearmotors  Robotis Dynamixel XC330-M181-T  max_voltage  6.0 -  e-Manual, xc330-m181
gearmotors  Robotis Dynamixel XC330-M288-T  max_voltage  6.0 -  e-Manual, xc330-m288
gearmotors  Robotis Dynamixel XC330-M288-T  stall_torque  0.93 -  e-Manual, xc330-m288, 5 V
gearmotors  Feetech STS3215 12 V  stall_torque  2.94 -  feetech.cn, 525603: 30 kg cm
gearmotors  Nippon Pulse S250T  continuous_torque  60 -  S250 specification sheet
brakes  Harmonic Drive SHA25A  torque  1.0 -  SHA-CG manual 600792, p. 25: 51 N m behind 51
brakes  Emerson PACMotion M4  engage_time  30 ms  GFK-3169B, p. 31
brakes  Mitsubishi HC-MF 23, 43  stop_energy  22 -  MR-J2S-A manual, p. 210
brakes  Mitsubishi HG-KR 73B  wear_energy  1280 kJ  HG-KR manual: 20 000 stops of 64 J
brakes  Yaskawa SGMGV-09  torque  12.7 -  UAK manual, p. 67
brakes  Siemens 1FK2-05  static_torque  8 -  1FK2 instructions A5E46089564B, p. 49
brakes  Siemens 1FK2-05  wear_energy  284 kJ  1FK2 instructions A5E46089564B, p. 49
brakes  Rexroth MKE 037B  release_time  4 ms  MKE manual R911402016, p. 34
brakes  Allen-Bradley 1326AS K3  torque  2.26 -  GMC-SG001E, p. 6-85
brakes  Kendrion INTORQ BFK551-03, 1 N m  stop_energy  800 -  BFK551 instructions BA 14.0224, p. 15
brakes  Wittenstein premo G1  torque  1.3 -  premo, i = 16 to 35, at 120 C
bearings  SKF deep groove ball  mu  0.0015 -  skf.com, friction: constant coefficients
bearings  Harmonic Drive FHA-25C output bearing  ratings.dynamic_rating  18000 -  FHA-C, p. 23
bearings  Harmonic Drive CSG/HFUC-2UH-25 output bearing  ratings.max_moment  156 -  CSG-2UH data
amplifiers  maxon EPOS4 50/5  peak_current  15 -  EPOS4 50/5 hardware reference, p. 9
amplifiers  Beckhoff ELM7221  continuous_current  8 -  ELM72xx, 12673864203
amplifiers  mjbots moteus-n1  max_voltage  54 -  moteus, table of specifications
amplifiers  mjbots moteus-c1  continuous_current  5 -  moteus-c1, product page, not cooled
"""
#: Makers, and kinds, of which no document of the maker's was read.
UNREAD = """
Apex PBC PBSA Elatech FYSETC Hanpose LDO Moons Motech Nanotec OMC TQ KEBA THK igus PTFE/bronze
Slewing Omron
"""


@pytest.fixture(scope="module")
def catalog():
    return load_catalog("default")


@pytest.mark.parametrize(("section", "product", "figure", "printed", "where"), table(PRINTED))
def test_a_figure_is_the_printed_one(section, product, figure, printed, where, catalog):
    value, unit = printed.split()
    found = reduce(getattr, figure.split("."), getattr(catalog, section)[product])
    assert found == pytest.approx(float(value) * UNITS[unit], rel=1e-4), where
    assert getattr(catalog, section)[product].source


def test_every_maker_has_a_figure_that_was_looked_up(catalog):
    """But those of which no document of the maker's was read."""
    unread = set(UNREAD.split())
    looked = {(section, product.split()[0]) for section, product, *_ in table(PRINTED)}
    for section in ("motors", "gears", "gearmotors", "brakes", "bearings", "amplifiers"):
        for maker in {name.split()[0] for name in getattr(catalog, section)} - unread:
            assert (section, maker) in looked


def test_planetary_gears_of_two_makers_lack_no_figure(catalog):
    whole = {
        name.split()[0]
        for name, gear in catalog.gears.items()
        if gear.kind == "planetary" and not lacks("other gear", gear)
    }
    assert {"Beckhoff", "Neugart"} <= whole
