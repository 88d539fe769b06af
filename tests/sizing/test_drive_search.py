"""The choice, against every drive judged one by one, and its independence of all else."""

import json
import random
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builders import example
from sizing_cases import (
    ACCELERATION,
    CYCLE,
    GEAR,
    INERTIA,
    MOTOR,
    RAMP,
    one_drive,
    sized_cycle,
    trapezoid,
    turntable,
    write_catalog,
)

import pinfric as pf
from pinfric.drives.bearing import BearingRatings
from pinfric.drives.catalog import Brake, Catalog, Gear, Motor
from pinfric.drives.catalog_file import load_catalog
from pinfric.drives.criterion import Status
from pinfric.drives.drivetrain import Ratings, motor_cycle, motor_with_gear, with_brake
from pinfric.drives.limits import check
from pinfric.drives.policy import NEEDS, kind_of, lacks
from pinfric.sizing.choice import QUESTIONS
from pinfric.sizing.choice import drives as drives_of
from pinfric.sizing.drive_search import CatalogArrays, DriveSearch, Parts, rank

ARM = "ur10_machine_tending"


@pytest.fixture(scope="module")
def arm():
    scene = pf.load_scene(ARM)
    catalog = load_catalog()
    return scene, pf.load_trajectory(ARM, scene), catalog


def drives(report):
    return [joint.choice and joint.choice.candidate.name for joint in report.joints]


def sized(arm, catalog=None, **conditions):
    scene, motion, whole = arm
    return pf.size(scene, motion, catalog or whole, conditions=conditions, on_miss="ignore")


@pytest.mark.parametrize("joint", [pytest.param(1, marks=pytest.mark.slow), 4])
def test_the_choice_is_that_of_a_search_over_all_drives(arm, joint):
    """Every drive that can be signed and is no heavier, judged in full with its joint's brake."""
    report = sized(arm)
    catalog = report.catalog
    joint = report.joints[joint]
    case, mine = joint.search.case, joint.choice.candidate
    best = []
    for g, gear in catalog.gears.items():
        if gear.output == "linear" or lacks(kind_of(gear), gear):
            continue
        for m in dict.fromkeys([*list(catalog.motors)[::2], mine.motor]):
            motor = catalog.motors[m]
            made = motor_with_gear(m, motor, g, gear, gear.ratios[0])
            known = None not in (made.mass, motor.rotor_inertia, made.ratings.continuous_torque)
            if not gear.takes(m, motor) or not known:
                continue
            needed = joint.search.holding_torque(made)
            for name, brake in joint.search.arrays.brakes.items() if needed else ():
                if brake.torque >= needed and brake.sold == "alone":
                    made = with_brake(made, name, brake)
                    break
            if made.mass > mine.mass:
                continue
            motor_ = motor_cycle(made, case.cycle, case.conditions)
            found = check(made, motor_, case)
            if not any(c.status == Status.FAILS for c in found):
                best.append((made.mass, made.name))
    assert min(best) == (mine.mass, mine.name)


def braked_by_hand(made, case, brakes):
    """The smallest brake that is sold alone or in this motor, holds, and bears a stop's energy."""
    gear, rest, ratio = made.transmission, np.abs(case.rest.load), made.ratio
    load, speed = rest / ratio, np.abs(ratio * case.cycle.velocity)
    for name, brake in sorted(brakes.items(), key=lambda one: (one[1].torque, one[1].mass)):
        if brake.sold != "alone" and not made.motor.startswith(brake.sold):
            continue
        if brake.torque < 1.5 * load.max():
            continue
        inertia = case.load_inertia / ratio**2 + gear.rotor_inertia + brake.rotor_inertia
        driven = speed + load * brake.engage_time / inertia
        energy = (inertia / 2 * driven**2 * brake.torque / (brake.torque - load)).max()
        if energy <= brake.stop_energy:
            return with_brake(made, name, brake)
    return made


@pytest.mark.parametrize("inner", [0.3, 3.0])
def test_brakes_inside_motors_and_weak_ones_leave_the_lightest_drive(arm, inner):
    """Brakes of one maker's motors, lighter or heavier; others that bear too little energy."""
    whole = arm[2]
    same = {"source": "invented", "grade": "R", "engage_time": 0.02}
    brakes = {
        f"{sold} {torque:g}": Brake(
            **same,
            torque=torque,
            torque_max=(1.0 if factor < 1 else factor) * torque,
            mass=factor * mass,
            rotor_inertia=2e-6,
            stop_energy=energy,
            sold=sold,
        )
        for sold, factor in (("alone", 1.0), ("maxon EC 90", inner))
        for torque, mass, energy in (
            (1.0, 0.4, 0.5),
            (1.7, 0.3, 12.0),
            (2.3, 0.5, 40.0),
            (9.0, 2.0, 900.0),
        )
    }
    gears = {n: g for n, g in whole.gears.items() if "CSG" in n and not lacks(kind_of(g), g)}
    motors = {n: m for n, m in whole.motors.items() if n.startswith(("maxon EC 90", "maxon EC 60"))}
    some = replace(whole, gears=gears, motors=motors, gearmotors={}, brakes=brakes)
    report = sized(arm, some, cooling="fan")
    for joint in report.joints[1:3]:
        case, mine, best = joint.search.case, joint.choice.candidate, []
        for g, gear in gears.items():
            for m, motor in motors.items():
                made = motor_with_gear(m, motor, g, gear, gear.ratios[0])
                if not gear.takes(m, motor) or made.transmission is None or made.mass is None:
                    continue
                made = braked_by_hand(made, case, brakes)
                if made.mass > mine.mass:
                    continue
                found = check(made, motor_cycle(made, case.cycle, case.conditions), case)
                if not any(c.status == Status.FAILS for c in found):
                    best.append((made.mass, made.name, made.brake))
        assert min(best) == (mine.mass, mine.name, mine.brake)


def test_a_brake_inside_another_motor_holds_no_joint(arm):
    """Where the only brakes are those of other motors a joint that needs one is missed."""
    whole = arm[2]
    inside = {n: b for n, b in whole.brakes.items() if b.sold != "alone"}
    report = sized(arm, replace(whole, brakes=inside), holding_brake="where_needed")
    for joint, still in zip(report.joints, report.standstills, strict=True):
        assert not joint.choice.candidate.brake
        assert still.brake is None
        assert not still.fitted
    lift = report.standstills[1]
    assert (lift.held, lift.torque.status) == (False, Status.FAILS)
    assert f"{report.joints[1].name}: {lift.torque.why}" in report.verdict.failing


def test_a_product_that_known_figures_rule_out_is_not_asked_about():
    """A servo of 0.4 N m for a joint that holds 45: its stiffness would not help."""
    report = pf.size(*example("panda_pick_and_place"), "default", on_miss="ignore")
    asked = [ask.name for joint in report.joints[:4] for ask in joint.ask]
    assert asked
    assert not any("XL-320" in name or "XL330" in name for name in asked)


#: The best that a figure may be: with these a product that is asked about is lighter.
BEST = {
    "efficiency": 1.0,
    "stiffness": 1e12,
    "bearing": BearingRatings(kind="crossed roller", max_moment=1e9),
    **dict.fromkeys(("mass",), 1e-3),
    **dict.fromkeys(("rated_torque", "repeated_peak_torque", "momentary_peak_torque"), 1e9),
    **dict.fromkeys(("max_input_speed", "average_input_speed", "max_speed"), 1e9),
    **dict.fromkeys(("continuous_torque", "peak_torque"), 1e9),
}


@pytest.mark.parametrize(
    ("few", "least"), [(slice(4, 5), 3), pytest.param(slice(None), 20, marks=pytest.mark.slow)]
)
def test_what_is_asked_for_would_be_lighter_with_some_figures(arm, few, least):
    """With its missing figures at their best it fits some joint and is lighter."""
    report = sized(arm)
    catalog, lighter = report.catalog, dict[str, bool]()
    whole = {n: g for n, g in catalog.gears.items() if not lacks(kind_of(g), g)}
    for joint, ask in [(each, ask) for each in report.joints[few] for ask in each.ask]:
        if lighter.get(ask.name):
            continue
        (kind,) = [k for k in ("gears", "motors", "gearmotors") if ask.name in getattr(catalog, k)]
        entry, arrays = getattr(catalog, kind)[ask.name], joint.search.arrays
        needs = (need for own in NEEDS.values() for need in own.items())
        keys = [keys.split()[0] for figure, keys in needs if figure in ask.figures]
        lacking = [k for k in keys if getattr(entry, k, 0) is None]
        best = {k: BEST[k] for k in lacking if k in BEST}
        rotors = [k for k in lacking if k not in BEST]
        found = None
        for inertia in (1e-12, *np.logspace(-7, -2.5, 12))[: 99 if rotors else 1]:
            made = {ask.name: entry.model_copy(update=best | dict.fromkeys(rotors, inertia))}
            parts = {"gears": whole if kind == "motors" else {}, "gearmotors": {}, kind: made}
            own = replace(catalog, **parts)
            own = CatalogArrays(own, report.conditions, arrays.output, arrays.brakes)
            found = found or DriveSearch(own, joint.search.case, joint.search.parts).lightest()
        lighter[ask.name] = found is not None and found.candidate.mass < joint.choice.candidate.mass
    assert len(lighter) > least
    assert [name for name, better in lighter.items() if not better] == []


def test_a_bound_of_a_gear_without_loss_is_the_rms_of_what_accelerates(tmp_path):
    """Of the table, the rotor, the gear, and a brake whose inertia is not known."""
    brake = {"source": "invented", "grade": "R", "torque": 0.3, "mass": 0.1, "engage_time": 0.02}
    catalog = one_drive(
        tmp_path,
        motor={"rotor_inertia": 3e-4, "continuous_torque": 0.2, "thermal": None},
        gear={"efficiency": 1.0, "back_efficiency": 1.0},
        brakes={"B": brake | {"stop_energy": 1e3, "sold": "alone"}},
    )
    given = {"holding_brake": "all", "inertia_ratio": 1e4}
    (joint,) = sized_cycle(catalog, turntable(friction={}), conditions=given).joints
    shaft = 3e-4 + GEAR["input_inertia"] + 2.2e-6 * 0.3**1.38
    shaft = INERTIA / GEAR["ratio"] + shaft * GEAR["ratio"]
    rms = shaft * ACCELERATION * np.sqrt(2 * RAMP / CYCLE)
    least, mass = joint.search.margins(0, np.array([0]))
    assert (least[0, 0], mass[0, 0]) == pytest.approx((1 - rms / 0.2, 0.6 + 0.9 + 0.1), rel=1e-6)
    assert (joint.choice.candidate.brake, joint.choice.candidate.mass) == ("B", mass[0, 0])
    assert 0.0 < joint.choice.margin <= least[0, 0]


def test_bounds_never_exceed_what_they_bound(arm):
    """Every drive of the first gears, among them those that bounds leave out."""
    search = sized(arm).joints[2].search
    (block,) = [b for b in search.arrays.groups if not b.at_output]
    known = [g for g in range(len(block.names)) if not block.gear_lacks[g]][:4]
    for g in known:
        least, _ = (x[0] for x in search.margins(0, np.array([g])))
        for m in range(0, len(block.motor_names), 5):
            if block.motor_lacks[m] or not block.fits[g, m]:
                continue
            exact = search.judge(0, g, m)
            assert exact.margin <= min(least[m], search.gear_margins[0][g]) + 1e-9


def altered(catalog, rng, kept):
    """Gears and motors left out, useless ones added, all shuffled."""
    gears = [(n, g) for n, g in catalog.gears.items() if n in kept or rng.random() < 0.7]
    motors = [(n, m) for n, m in catalog.motors.items() if n in kept or rng.random() < 0.7]
    for k in range(5):
        name, gear = rng.choice(list(catalog.gears.items()))
        worse = {"mass": 10 * (gear.mass or 1.0), "stiffness": rng.choice([None, 1.0, 1e9])}
        gears.append((f"useless {k} {name}", gear.model_copy(update=worse)))
        name, motor = rng.choice(list(catalog.motors.items()))
        motors.append((f"heavy {k} {name}", motor.model_copy(update={"mass": 90.0})))
    rng.shuffle(gears)
    rng.shuffle(motors)
    brakes = list(catalog.brakes.items())
    rng.shuffle(brakes)
    return replace(catalog, gears=dict(gears), motors=dict(motors), brakes=dict(brakes))


@pytest.mark.parametrize("count", [2, pytest.param(100, marks=pytest.mark.slow)])
def test_the_choice_depends_on_no_other_drive_and_on_no_order(arm, count, monkeypatch):
    """Whatever was taken before gears had to bear its stops says what they must bear: it stays."""
    kept = set()

    def recorded(*given):
        found = drives_of(*given)
        made = [a.candidate for a in found.taken.values()]
        kept.update(part for one in made for part in (one.motor, one.gear_name))
        return found

    with monkeypatch.context() as patched:
        patched.setattr("pinfric.sizing.size.QUESTIONS", (recorded, *QUESTIONS[1:]))
        whole = sized(arm)
    rng = random.Random(count)
    for _ in range(count):
        assert drives(sized(arm, altered(arm[2], rng, kept))) == drives(whole)


@pytest.mark.slow
@pytest.mark.parametrize("masses", ["without_drives", "with_drives"])
def test_ruling_out_a_chosen_drive_makes_no_arm_lighter(arm, masses):
    scene, motion, catalog = arm
    given = scene.with_(masses=masses), motion, catalog
    whole = sized(given)
    for gear in {joint.choice.candidate.gear_name for joint in whole.joints}:
        rest = {n: g for n, g in catalog.gears.items() if n != gear}
        other = sized(given, replace(catalog, gears=rest))
        if None not in drives(other):
            assert other.verdict.mass >= whole.verdict.mass - 1e-12


def test_a_whole_arm_is_like_its_makers(arm):
    """A UR10 seems to have strain wave gears of sizes 32, 32, 25, 17, 17, 17, ratio 100.

    Nothing larger than the next size, though its brakes may close in motion (1.3 times the peak).
    """
    scene, motion, catalog = arm
    bare = sized((scene.with_(masses="without_drives"), motion, catalog))
    sizes = [int(name.split("CSG-")[1].split("-")[0]) for name in drives(bare)]
    made = [14, 17, 20, 25, 32, 40]
    off = [
        made.index(ours) - made.index(its)
        for ours, its in zip(sizes, (32, 32, 25, 17, 17, 17), strict=True)
    ]
    assert np.abs(off).max() <= 1
    assert 15 < bare.verdict.mass < 20
    assert bare.settled


def test_offers_come_by_mass_whatever_gear_they_have(tmp_path):
    motors = {f"M{mass}": MOTOR | {"mass": mass} for mass in (0.4, 0.6, 0.8)}
    gears = {f"G{mass}": GEAR | {"mass": mass} for mass in (0.9, 1.0)}
    catalog = load_catalog(write_catalog(tmp_path / "c.yaml", motors, gears))
    (joint,) = sized_cycle(catalog, conditions={"inertia_ratio": 20}).joints
    masses = [mass for mass, *_ in joint.search.offers()]
    assert masses == pytest.approx([1.3, 1.4, 1.5, 1.6, 1.7, 1.8])


def test_of_equal_masses_the_exact_margin_counts_not_its_bound():
    """Bounds of 0.5, 0.4 and 0.2; the second one's margin is the greatest."""
    margins = [0.1, 0.3, 0.1, 0.9]
    offers = [(1.0, bound, 0, 0, k) for k, bound in enumerate((0.5, 0.4, 0.2))]
    judged = [
        SimpleNamespace(
            candidate=SimpleNamespace(ratings=Ratings()),
            mass=2.0 if k == 3 else 1.0,
            name=f"{k}",
            margin=x,
            fits=True,
        )
        for k, x in enumerate(margins)
    ]
    search = SimpleNamespace(
        offers=lambda: [*offers, (2.0, 0.9, 0, 0, 3)],
        judge=lambda b, g, m: judged[m],
        parts=Parts(),
    )
    assert DriveSearch.fitting(search, 1) == [judged[1]]


def test_equal_masses_go_by_margin_then_by_name(tmp_path):
    scene = turntable()
    motors = {
        n: Motor(**{**MOTOR, "continuous_torque": c})
        for n, c in (("b", 0.13), ("c", 0.8), ("a", 0.8))
    }
    catalog = Catalog("c", motors, {"G": Gear(**GEAR)})
    motion = trapezoid(scene)
    (joint,) = pf.size(scene, motion, catalog, conditions={"inertia_ratio": 20}).joints
    ranked = [joint.choice, *joint.alternatives]
    assert [a.candidate.motor for a in ranked] == ["a", "c", "b"]
    assert ranked == sorted(ranked, key=rank)


def test_gears_are_bounded_together_and_those_of_heavy_drives_not_at_all(arm, monkeypatch):
    """The same offers of at most 1 kg, whether heavier ones are asked for, too, or not."""
    search = sized(arm).joints[4].search
    asked, margins = [], DriveSearch._margins

    def counting(self, b, gears):
        asked.append(len(gears))
        return margins(self, b, gears)

    monkeypatch.setattr(DriveSearch, "_margins", counting)
    found, gears, times = [], [], []
    for most in (np.inf, 1.0):
        asked.clear()
        one = DriveSearch(search.arrays, search.case, Parts(search.parts.own, most=most))
        found.append([offer for offer in one.offers() if offer[0] <= 1.0])
        gears.append(sum(asked))
        times.append(len(asked))
    assert found[0] == found[1] != []
    assert gears[1] < gears[0] / 2
    assert times[0] < gears[0] / 4


@pytest.mark.slow
def test_a_table_of_fifty_thousand_motors_is_read_and_judged_with_a_hundred_gears(arm, tmp_path):
    scene, motion, catalog = arm
    random = np.random.default_rng(1)
    torque = 0.05 * 10 ** random.uniform(0.0, 2.2, 50_000)
    speed = random.uniform(3000.0, 7000.0, 50_000)
    table = {
        "Tc N m": torque,
        "Tp N m": torque * random.uniform(2.5, 4.0, 50_000),
        "kt mN m/A": 4.4e5 / speed,
        "R ohm": random.uniform(0.05, 1.0, 50_000),
        "J g cm^2": torque * random.uniform(200.0, 800.0, 50_000),
        "m g": 1200.0 * torque**0.7,
        "n0 rpm": speed,
        "nmax rpm": 1.3 * speed,
    }
    figures = (
        *("continuous_torque", "peak_torque", "torque_constant", "resistance", "rotor_inertia"),
        *("mass", "no_load_speed", "max_speed"),
    )
    rows = [
        f"M{k}," + ",".join(f"{x:.4g}" for x in row) for k, row in enumerate(np.c_[*table.values()])
    ]
    (tmp_path / "m.csv").write_text("\n".join([",".join(["name", *table]), *rows]))
    columns = {
        f: {"column": c, "unit": c.split(" ", 1)[1]} for f, c in zip(figures, table, strict=True)
    }
    every = {"source": "invented", "grade": "R", "mounting": "shaft", "nominal_voltage": 48.0}
    mapping = {"section": "motors", "columns": {"name": "name", **columns}, "every": every}
    (tmp_path / "m.columns.yaml").write_text(json.dumps(mapping))
    gears = dict(list(catalog.gears.items())[:100])
    started = time.process_time()
    motors = load_catalog(tmp_path).motors
    given = replace(catalog, motors=motors, gears=gears)
    report = pf.size(scene, motion, given, on_miss="ignore")
    spent = time.process_time() - started
    print(f"50,000 motors, 100 gears: {spent:.1f} s")
    assert len(motors) == 50_000
    assert spent < 20.0  # 10 s, 15 s beside other work
    assert report.settled
