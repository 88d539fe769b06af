"""The sizing report: JSON, tables, and the page, drawn by a browser where there is one."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from io import StringIO
from itertools import compress

import numpy as np
import pytest
from printed import assert_printed
from rich.console import Console
from sizing_cases import MOTOR, one_drive, sized_cycle, turntable, write_catalog

import pinfric as pf
from pinfric.drives.catalog_file import load_catalog
from pinfric.model.described import in_json
from pinfric.show.figure.sizing import torque_speed
from pinfric.show.pages.page import formula
from pinfric.show.pages.sizing import sizing_page
from pinfric.show.report.drives import ask_table, choice_table, currents_table
from pinfric.show.report.names import short_names
from pinfric.show.report.rows import table_of
from pinfric.show.report.sizing import passes, sizing_report
from pinfric.show.report.values import percentage
from pinfric.sizing.summary import sizing_summary

BROWSER = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome", "chrome")
        if (path := shutil.which(name))
    ),
    None,
)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """One joint, a catalogue in which one motor fits, one fails and one lacks its peak torque."""
    motors = {
        "fits <b>": MOTOR,  # a name that must not become markup
        "weak": {**MOTOR, "continuous_torque": 0.05},
        "no peak": {k: v for k, v in MOTOR.items() if k != "peak_torque"} | {"mass": 0.5},
        "heavy": {**MOTOR, "mass": 1.5, "continuous_torque": 1.0, "rotor_inertia": 2e-4},
    }
    path = write_catalog(tmp_path_factory.mktemp("sizing") / "catalog.yaml", motors)
    return sized_cycle(load_catalog(path))


@pytest.fixture(scope="module")
def page(report):
    return sizing_page(report)


@pytest.fixture(scope="module")
def panda():
    from pinfric.model.scene_file import bundled_folder

    scene = pf.load_scene("panda_pick_and_place.yaml")
    file = bundled_folder() / "panda_pick_and_place.csv"
    return pf.size(scene, pf.load_trajectory(file, scene), "default")


def test_json_has_the_promised_figures_of_every_joint(panda):
    answer = json.loads(json.dumps(in_json(sizing_summary(panda)), allow_nan=False))
    assert [joint["name"] for joint in answer["joints"]] == list(panda.scene.actuator_names)
    for entry, joint in zip(answer["joints"], panda.joints, strict=True):
        keys = {"peak", "rms", "breakaway", "holding", "speed", "choice", "candidates"}
        assert keys <= entry.keys()
        assert entry["peak"] == joint.demand.peak
        least, worst = entry["holding"]
        assert 0 <= least <= worst <= entry["peak"]
        assert entry["choice"] == joint.choice.candidate.name
        assert min(m for m in entry["installed"]["margins"].values() if m is not None) >= 0
        assert entry["installed"]["margins"]["amplifier currents"] is None  # not checked
        states = [criterion["status"] for criterion in entry["installed"]["criteria"]]
        assert entry["installed"]["not_checked"] == states.count("not checked")
        beside = {a["name"] for a in entry["alternatives"]}
        assert len(beside) == len(joint.alternatives) > 3
        assert entry["candidates"] == joint.candidates > 1000
    assert {"name", "figures", "joints"} <= answer["ask"][0].keys()
    assert answer["catalog"] == "default"


def test_json_without_a_catalogue_is_the_demand(tmp_path):
    answer = in_json(sizing_summary(sized_cycle()))
    (joint,) = answer["joints"]
    assert joint["peak"] == pytest.approx(15.0)
    assert joint["choice"] is None
    assert joint["alternatives"] == []
    assert answer["catalog"] is None


def test_what_does_not_fit_says_why_and_what_lacks_a_figure_is_asked_for(report):
    (sized,) = report.joints
    why = {a.candidate.name: a.why for a in sized.assessments if not a.fits}
    assert "continuous torque: needs 0.09" in why["weak + G"]
    assert why["no peak + G"] == "cannot be signed: ask for peak torque"
    found = in_json(sizing_summary(report))
    (joint,) = found["joints"]
    assert joint["choice"] == "fits <b> + G"
    assert [a["name"] for a in joint["alternatives"]] == ["heavy + G"]
    assert [(a["name"], a["figures"]) for a in found["ask"]] == [("no peak", "peak torque")]


def test_infeasible_joint_has_its_nearest_miss_in_the_json(tmp_path):
    with pytest.warns(pf.PinfricWarning, match="closest candidate"):
        report = sized_cycle(
            one_drive(tmp_path, {"peak_torque": 0.6}), conditions={"peak_factor": 5}
        )
    (joint,) = in_json(sizing_summary(report))["joints"]
    assert joint["choice"] is None
    assert "peak torque: needs " in joint["nearest_miss"]
    assert joint["installed"]["margins"]["peak torque"] < 0
    page = sizing_page(report)
    assert "<b>Not met.</b> table: none of 1 candidate fits" in page
    assert "does not fit: closest candidate" in page
    console = Console(file=StringIO(), width=80)
    console.print(*sizing_report(report), sep="\n")
    assert "none; nearest M + G" in " ".join(console.file.getvalue().split())


def test_what_lacks_a_figure_is_lighter_only_than_a_drive_that_is_chosen(report):
    found = sizing_summary(report)
    assert ask_table(found).title.startswith("lighter, but a figure")
    (joint,) = found.joints
    none = replace(found, joints=(replace(joint, choice=None),))
    assert ask_table(none).title.startswith("a figure")


def test_tables_fit_eighty_columns(panda):
    console = Console(file=StringIO(), width=80)
    console.print(*sizing_report(panda), sep="\n")
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= 80
    assert_printed(__file__, "size_verbose", text)


def test_console_prints_the_notes(panda):
    console = Console(file=StringIO(), width=80)
    console.print(*sizing_report(panda), sep="\n")
    text = " ".join(console.file.getvalue().split())
    assert len(panda.notes) > 3
    for note in panda.notes:
        assert f"note: {note}" in text
    assert "conditions.mass_in_urdf gives what is there" in text


def test_the_short_report_is_a_screen_and_says_where_the_rest_is(panda):
    console = Console(file=StringIO(), width=80)
    console.print(*sizing_report(panda, verbose=False), sep="\n")
    text = console.file.getvalue()
    assert len(text.splitlines()) <= 40  # seven joints
    assert_printed(__file__, "size", text)


def test_a_cycle_that_does_not_close_stands_in_every_report(tmp_path):
    scene = turntable()
    t = np.linspace(0.0, 1.0, 51)[:, None]
    motion = pf.Trajectory.from_arrays(scene, t[:, 0], 2 * t, 2 + 0 * t, 0 * t)
    open_ = pf.size(scene, motion, load_catalog(write_catalog(tmp_path / "catalog.yaml")))
    text = "table ends 2 rad from where it began"
    assert in_json(sizing_summary(open_))["unclosed"] == [text]
    assert any(text in note for note in in_json(sizing_summary(open_))["notes"])
    demand = pf.size(scene, motion)  # without a catalogue, too
    for report in (open_, demand):
        console = Console(file=StringIO(), width=80)
        console.print(*sizing_report(report), sep="\n")
        printed = " ".join(console.file.getvalue().split())
        assert "repeated, but it does not close" in printed
        assert text in printed
    page = sizing_page(open_)
    assert "repeated, but it does not close" in page
    assert f"<b>The cycle does not close.</b> {text}" in page


def test_currents_are_torques_over_the_makers_constant(report):
    """At the motor's shaft: the largest, and RMS of the torque of larger magnitude."""
    cycle, t = report.joints[0].motor, report.result.times
    torque = np.maximum(abs(cycle.torque_lower), abs(cycle.torque_upper))
    rms = np.sqrt(np.trapezoid(torque**2, t) / (t[-1] - t[0]))
    table = currents_table(sizing_summary(report))
    ((*_, peak, heat, kind),) = table.rows
    assert [column.heading.split("\n")[0] for column in table.columns][-3:-1] == ["peak", "RMS"]
    assert float(peak) == pytest.approx(torque.max() / MOTOR["torque_constant"], abs=6e-3)
    assert float(heat) == pytest.approx(rms / MOTOR["torque_constant"], abs=6e-3)
    assert kind == "dc"


def test_passes_in_words(report):
    assert passes(report).startswith("settled after ")
    assert passes(replace(report, passes=1)) == "settled after 1 round"
    alternates = replace(report, passes=10, settled=False)
    assert passes(alternates) == "not settled after 10 rounds: it alternates"
    assert "not settled after 10 rounds" in sizing_page(alternates)


@pytest.mark.slow
def test_what_vanishes_beside_the_peak_prints_as_0(panda):
    demand = panda.joint("panda_joint7").demand
    assert 1e-9 < demand.holding_frictionless < 1e-4 * demand.peak
    assert not re.search(r"RMS [\d.]*e-\d", sizing_page(panda))


def test_page_defines_holding(page):
    assert "“Holding”: every joint of the robot is at rest" in page


def test_tightest_criterion_is_that_of_the_least_margin(report):
    (joint,) = sizing_summary(report).joints
    assert joint.verdict.margin == min(
        c.margin for c in joint.installed.criteria if c.margin is not None and c.scaled
    )
    assert joint.installed.margins[joint.verdict.tightest] == joint.verdict.margin


def test_envelope_is_the_line_of_the_bus_voltage_cut_by_the_peak_torque(report):
    (axes,) = torque_speed(report, 0).axes
    (envelope,) = [line for line in axes.lines if line.get_label() == "envelope"]
    x, y = np.array(envelope.get_xdata()), np.array(envelope.get_ydata())
    hot = report.joints[0].motor.figures.hot
    k, r = MOTOR["torque_constant"], hot * MOTOR["resistance"]
    line = np.minimum(k * (0.9 * 48.0 - k * x) / r, MOTOR["peak_torque"])[:201]
    np.testing.assert_allclose(y[:201], np.maximum(line, 0), atol=2e-3)
    # the interval at rest stands upright at speed 0
    (bars,) = [one for one in axes.collections if one.get_label() == "interval at rest"]
    ends = np.array(bars.get_segments())
    assert (ends[:, :, 0] == 0.0).all()
    assert ends[:, :, 1].max() == pytest.approx(3 / 0.8 / 100, rel=1e-2)


def test_legend_says_that_no_speed_torque_line_is_known(tmp_path):
    catalog = one_drive(tmp_path, {"resistance": None, "thermal": None})
    report = sized_cycle(catalog)
    (axes,) = torque_speed(report, 0).axes
    assert axes.lines[0].get_label() == "envelope (no line known)"


def test_page_needs_no_network_and_escapes_names(page):
    assert "fits <b>" not in page
    assert "fits &lt;b&gt; + G" in page
    assert not re.search(r"<(script|link|img|iframe)[^>]*\b(src|href)=", page)
    assert len(page) < 1.5e6
    for text in ("Harmonic Drive engineering data", "not checked", "T<sub>av</sub>", "√("):
        assert text in page


@pytest.mark.slow
def test_everything_that_was_not_checked_is_named_with_what_it_lacks(panda):
    """Each unchecked criterion of drive, brake, bus and robot is in one row, with its joints."""
    expected = set()
    for joint, still, (amplifier, _) in zip(
        panda.joints, panda.standstills, panda.amplifiers, strict=True
    ):
        for c in (*joint.choice.criteria, *still.criteria):
            fed = c.name == "amplifier currents" and amplifier  # named when the motor is known
            if c.status == "not checked" and not fed:
                expected.add((c.name, joint.name))
    expected |= {(c.name, "") for c in panda.bus.criteria if c.status == "not checked"}
    expected.add(("stopping times and distances", ""))
    summary = sizing_summary(panda)
    rows = [(row.criterion, name) for row in summary.unchecked for name in row.joints or ("",)]
    assert set(rows) == expected
    assert len(rows) == len(expected) >= 4
    assert all(row.missing and "no figure" not in row.missing for row in summary.unchecked)
    page = sizing_page(panda, "pinfric size panda motion.csv")
    part = page.partition("Not checked, and why")[2].partition("</section>")[0]
    assert part.count("<tr") - 1 == len(summary.unchecked)
    lacks = {row.criterion: row.missing for row in summary.unchecked}
    assert lacks["supply power"] == "conditions.supply_power"
    for row in summary.unchecked:
        assert row.criterion in part
    assert "<code>pinfric size panda motion.csv</code>" in page
    assert "payload box, 2.00 kg" in page.partition("Signature")[0]  # on the first screen
    assert re.search(r"pinfric/catalog</span> <span class=\"hash\">SHA-256 [0-9a-f]{64}<", page)


def test_nothing_is_said_of_what_was_not_assessed(tmp_path):
    """No drive is known: no mass of drives, and nothing about what flows back."""
    unknown = one_drive(tmp_path, motor={"rotor_inertia": None})
    report = sized_cycle(unknown, on_miss="ignore")
    page = sizing_page(report)
    assert "<b>–</b><span>drives that can be signed" in page  # noqa: RUF001
    assert "fed back: neither" not in page
    (row,) = sizing_summary(report).unchecked[:1]
    assert row.criterion == "all of its drive"
    assert row.missing == "no candidate can be judged"


def test_page_says_what_to_install(report, monkeypatch):
    import pinfric.show.pages.page as module

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(module, "import_module", missing)
    with pytest.raises(pf.PinfricError, match=r"pip install 'pinfric\[report\]'"):
        sizing_page(report)


#: Notes whether anything is wider than a phone.
_PROBE = """<script>
const root = document.documentElement;
root.dataset.beyond = root.scrollWidth - root.clientWidth;
</script></body>"""


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome is installed")
def test_browser_draws_every_figure_without_errors(report, tmp_path):
    path, page = tmp_path / "report.html", sizing_page(report).rpartition("</body>")
    path.write_text(page[0] + _PROBE + page[2], encoding="utf-8")
    done = subprocess.run(
        [
            BROWSER,
            "--headless",
            "--no-sandbox",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            "--disable-background-networking",
            "--disable-component-update",
            "--disable-sync",
            "--no-first-run",
            "--host-resolver-rules=MAP * ~NOTFOUND",
            "--enable-logging=stderr",
            "--v=0",
            f"--user-data-dir={tmp_path / 'profile'}",
            "--window-size=500,900",
            "--virtual-time-budget=5000",
            "--dump-dom",
            path.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=90,
    )
    dom = done.stdout
    for kind in ("envelope-0", "effort-0", "heat-0", "bus"):
        assert re.search(rf'<figure id="{kind}"><svg role="img"', dom)
    assert 'data-beyond="0"' in dom  # nothing is wider than a phone
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert not [line for line in console if "rror" in line]


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome is installed")
def test_seven_joints_print_on_ten_pages_at_most(panda, tmp_path):
    path, pdf = tmp_path / "report.html", tmp_path / "report.pdf"
    path.write_text(sizing_page(panda), encoding="utf-8")
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer")
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    words = [BROWSER, *options, profile, f"--print-to-pdf={pdf}", path.as_uri()]
    subprocess.run(words, capture_output=True, timeout=90, check=True)
    assert 5 <= len(re.findall(rb"/Type ?/Page\b", pdf.read_bytes())) <= 10


def cells(page, heading, beside):
    """The texts below a heading, of all tables of a page that have it and the one beside."""
    found = []
    for table in re.findall(r"<table.*?</table>", page, re.DOTALL):
        rows = re.findall(r"<tr>(.*?)</tr>", table)
        split = [re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row) for row in rows]
        heads = [head.replace("<br>", " ") for head in split[0]]
        if heading in heads and beside in heads:
            texts = [row[heads.index(heading)] for row in split[1:]]
            found += [re.sub("<[^>]*>", "", text).strip() for text in texts]
    return found


@pytest.mark.slow
def test_terminal_and_page_print_one_margin_alike(panda, report):
    """The least margin of each drive, and every criterion that has one, in both its tables."""
    for sized in (panda, report):
        found, page = sizing_summary(sized), sizing_page(sized)
        terminal = choice_table(found)
        at = [column.heading for column in terminal.columns].index("least\nmargin")
        chosen = [row[at] for row in terminal.rows]
        of_all, *of_joints = page.split('<section class="joint"')
        assert cells(of_all, "least margin", "tightest criterion") == chosen
        for own, joint in zip(of_joints, found.joints, strict=True):  # of motor and gear alone
            beside = cells(own, "least margin", "tightest criterion")
            drives = [*joint.taken, *joint.alternatives] if joint.alternatives else []
            assert beside == [percentage(drive.margin) for drive in drives]
        criteria = [c for joint in found.joints for c in joint.installed.criteria]
        printed = [row[1] for row in table_of("", criteria, only=("name", "margin")).rows]
        free = [c.status == "passes" and not c.scaled for c in criteria]  # a step has no reserve
        judged = [
            "passes" if step else c.status if c.margin is None else x
            for c, step, x in zip(criteria, free, printed, strict=True)
        ]
        shown = [c.status != "not required" or c.available is not None for c in criteria]
        assert cells(page, "margin", "needs") == list(compress(judged, shown))
        names = sized.scene.actuator_names
        short = [short_names(names)[name] for name in names]
        matrix = [x for name in short for x in cells(page, name, "criterion") if x != "·"]
        assert sorted(matrix) == sorted(judged)
        assert len([x for x in judged if x.endswith("%")]) > 10 * len(names)


def test_formulas_replace_whole_words_only():
    assert formula("int M^2 dt over this joint and theta") == "∫ M² dt over this joint and theta"
    assert formula("tau theta' + theta = x") == "τ ϑ&#39; + ϑ = x"


@pytest.mark.parametrize(
    ("margin", "says"),
    [(0.123, "12 %"), (-0.0027, "-0.3 %"), (0.0996, "10.0 %"), (0.0, "0 %")],
)
def test_a_margin_near_a_limit_has_a_decimal(margin, says):
    assert percentage(margin) == says
