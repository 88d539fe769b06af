"""The page to sign: every number of one joint worked out by hand, and its sources."""

import hashlib
import re
import shlex
from html import unescape
from math import exp, pi, sqrt

import pytest
from cli_cases import run
from envelopes import result_of
from sizing_cases import (
    ACCELERATION,
    COULOMB,
    CYCLE,
    GEAR,
    INERTIA,
    MOTOR,
    PAUSE,
    PLATEAU,
    RAMP,
    RATE,
    one_drive,
    sized_cycle,
)

from pinfric import __version__
from pinfric.drives.criterion import compare
from pinfric.model.scene_file import bundled_folder
from pinfric.show.pages.sizing import _ended, sizing_page


def texts(html):
    return unescape(re.sub("<[^>]*>", "", html.replace("<br>", " "))).strip()


def tables(page):
    """The tables of a page: lists of rows, each heading -> text."""
    found = []
    for table in re.findall(r"<table.*?</table>", page, re.DOTALL):
        head, *rows = re.findall(r"<tr>(.*?)</tr>", table)
        names = [texts(x) for x in re.findall(r"<th[^>]*>(.*?)</th>", head)]
        cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in rows]
        found.append([dict(zip(names, map(texts, row), strict=True)) for row in cells])
    return found


def with_heading(page, *names):
    return [row for table in tables(page) for row in table if {*names} <= row.keys()]


def is_about(text, x):
    """Whether three digits are those of a number."""
    assert float(text.replace("–", "nan")) == pytest.approx(x, rel=6e-3, abs=1e-9)  # noqa: RUF001


def warmest(torques, times, tau):
    """The greatest theta of tau theta' + theta = T^2, settled: a lag, exactly, period by period."""
    theta, most = 0.0, 0.0
    for k in range(200):
        for torque, span in zip(torques, times, strict=True):
            theta = torque**2 + (theta - torque**2) * exp(-span / tau)
            most = max(most, theta) if k > 190 else most
    return sqrt(most)


def test_every_number_of_a_joint_is_that_of_a_pocket_calculator(tmp_path):
    """One turntable, one motor, one gear; the motor's thermal figures are left out."""
    report = sized_cycle(one_drive(tmp_path, {"thermal": None}))
    page, conditions = sizing_page(report), report.conditions
    ratio, shaft = GEAR["ratio"], MOTOR["rotor_inertia"] + GEAR["input_inertia"]
    # without thermal figures copper is as hot as class A allows, 105 C: 1 + 0.0039 x 80
    k, resistance = MOTOR["torque_constant"], 1.312 * MOTOR["resistance"]
    inertial, times = INERTIA * ACCELERATION, (RAMP, PLATEAU, RAMP, PAUSE)
    joint = inertial + COULOMB, COULOMB, COULOMB - inertial, COULOMB
    rotor = ratio * shaft * ACCELERATION
    start = joint[0] / GEAR["efficiency"] / ratio + rotor
    keep = COULOMB / GEAR["efficiency"] / ratio
    slow = joint[2] * GEAR["back_efficiency"] / ratio - rotor
    motor, speed = (start, keep, slow, keep), ratio * RATE
    ways = (RATE * RAMP / 2, RATE * PLATEAU, RATE * RAMP / 2)
    cubic = (sum(w * abs(t) ** 3 for w, t in zip(ways, joint, strict=False)) / sum(ways)) ** (1 / 3)
    mean_speed = ratio * sum(ways) / CYCLE
    square = sum(t**2 * s for t, s in zip(motor, times, strict=True)) / CYCLE
    thermal = conditions.thermal_time
    expected = {
        "continuous torque": (sqrt(square), 0.5),
        "short-term torque": (warmest(motor, times, thermal), 0.5),
        "overloaded standstill": (0.0, thermal),
        "peak torque": (conditions.peak_factor * start, 2.0),
        "speed-torque line": (resistance * start / k + k * speed, 0.9 * 48.0),
        "motor speed": (speed, 600.0),
        "gear average torque": (cubic, 40.0),
        "gear repeated peak torque": (joint[0], 60.0),
        "gear maximum input speed": (speed, 700.0),
        "gear average input speed": (mean_speed, 300.0),
        "bearing tilting moment": (0.0, 1e5),
        "bearing radial force": (0.0, 1e6),
        "bearing axial force": (9.81, 1e6),
        "inertia ratio": (INERTIA / (ratio**2 * shaft), 10.0),
        "gear resonance": (8.0, sqrt(GEAR["stiffness"] / INERTIA) / (2 * pi)),
        "holding without power": (0.0, 1.0),
    }
    rows = {row["criterion"]: row for row in with_heading(page, "criterion", "needs", "has")}
    judged = {name for name, row in rows.items() if "%" in row["margin"]}
    assert judged == set(expected)  # "bus voltage" passes, without a reserve
    margins = {}
    for name, (need, has) in expected.items():
        is_about(rows[name]["needs"], need)
        is_about(rows[name]["has"], has)
        margins[name] = 1 - need / has
        assert float(rows[name]["margin"].split()[0]) == pytest.approx(100 * margins[name], abs=0.5)
    life = GEAR["nominal_life"] * GEAR["rated_speed"] / mean_speed * (30 / cubic) ** 3 / 5
    is_about(rows["gear life L10"]["has"], life)
    # the first screen
    (chosen,) = with_heading(page, "drive")
    least = min(margins, key=margins.get)
    assert chosen["tightest criterion"] == least
    assert f"{100 * margins[least]:.0f} %" == chosen["least margin"]
    is_about(chosen["mass kg"], MOTOR["mass"] + GEAR["mass"])
    powers = [t * speed + resistance * (t / k) ** 2 for t in motor]
    tiles = [texts(x) for x in re.findall(r'<div class="fact[^"]*"><b>(.*?)</b>', page)]
    open_ = sum(row["margin"] == "not checked" for row in rows.values())
    assert tiles[:3] == ["1.50 kg", "1 of 1", str(open_)]
    assert open_ > 0
    is_about(tiles[3].removesuffix(" W"), powers[0])
    # what the cycle demands
    (demand,) = with_heading(page, "peak N m", "speed rad/s")
    is_about(demand["peak N m"], joint[0])
    is_about(demand["speed rad/s"], RATE)
    worst = sqrt(sum(t**2 * s for t, s in zip(joint, times, strict=True)) / CYCLE)
    least_rms = sqrt(worst**2 - COULOMB**2 * PAUSE / CYCLE)
    low, high = demand["RMS least–worst N m"].split("–")  # noqa: RUF001
    is_about(low, least_rms)
    is_about(high, worst)
    # the bus: power over a ramp is a line from the copper loss on
    copper = [resistance * (t / k) ** 2 for t in motor]
    bus = with_heading(page, "drawn J")[0]
    back = copper[2] + slow * speed  # at the beginning of the ramp down
    turns = RAMP * copper[2] / -(slow * speed)  # from then on before its end it draws
    driven = (copper[0] + start * speed / 2) * RAMP + (copper[1] + keep * speed) * PLATEAU
    drawn = driven + copper[3] * PAUSE + copper[2] * turns / 2
    is_about(bus["drawn J"], drawn)
    is_about(bus["fed back J"], -back * (RAMP - turns) / 2)
    is_about(bus["peak W"], powers[0])
    is_about(bus["braking W"], -back)


def test_the_page_states_the_words_typed_and_every_input(tmp_path, monkeypatch):
    """Cycles of a duty and the period, too: with others another drive is chosen."""
    monkeypatch.chdir(tmp_path)
    cycle = (bundled_folder() / "pendulum.waypoints.yaml").read_text(encoding="utf-8")
    for name in ("a cycle.yaml", "b.yaml"):
        (tmp_path / name).write_text(f"{cycle}\n# {name}", encoding="utf-8")
    words = ["size", "pendulum", "--cycle", "a cycle.yaml:0.6", "--cycle=b.yaml:0.4", "--on", "0.5"]
    words += ["--period=900", "--catalog", "default", "--condition", "ambient=30", "--out", "out"]
    run(*words)
    page = unescape((tmp_path / "out/report.html").read_text())
    first = page.partition("Signature")[0] or page
    assert f"by pinfric {__version__} with <code>{shlex.join(['pinfric', *words])}</code>" in first
    stated = dict(re.findall(r"<span>([^<]*)</span> <span class=\"hash\">SHA-256 (\w+)<", first))
    names = {name.rpartition("/")[2] for name in stated}
    assert names == {"pendulum.yaml", "pendulum.urdf", "a cycle.yaml", "b.yaml", "catalog"}
    for name in ("a cycle.yaml", "b.yaml"):
        assert stated[name] == hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()
    # what the terminal's first screen remarks on products, the page's does, too
    drive = result_of((tmp_path / "out/sizing.json").read_text())["joints"][0]["installed"]
    assert drive["notes"]
    assert all(note.partition(": ")[2] in texts(first) for note in drive["notes"])
    assert page.rindex("<h2>") == page.index("<h2>What cannot be signed")


@pytest.mark.parametrize(
    ("name", "bus", "shown"),
    [
        ("motor voltage", 48.0, "passes"),
        ("motor speed", 48.0, "0 %"),
        ("motor voltage", 40.0, "-20 %"),
    ],
)
def test_a_step_that_passes_is_no_tight_margin(name, bus, shown):
    """A nominal voltage equal to the bus has no margin, and needs none."""
    cell = _ended(compare(name, 48.0, bus, "V", "", ""))
    assert re.sub("<[^>]*>", "", cell) == shown
    assert ("tight" in cell) == (shown == "0 %")
