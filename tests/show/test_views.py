"""An object's text is one screen; `plot` and `summary` hold what `--out` writes."""

import doctest
import pickle
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, example, plane_friction, sliding_block
from dynamics.forward.test_forward import mimic_scene
from matplotlib.figure import Figure
from numpy.testing import assert_allclose, assert_array_equal
from printed import assert_printed
from sizing_cases import one_drive, trapezoid, turntable
from sweep_cases import pushed_block, steady, sweep_of, swept_panda, uniform

import pinfric as pf
from pinfric.accuracy import study
from pinfric.accuracy.explain import explain
from pinfric.errors import StateError
from pinfric.model.described import EFFORT, MOTOR, in_json
from pinfric.show.figure import registry
from pinfric.show.inverse_summary import inverse_summary
from pinfric.show.pages.sizing import sizing_page
from pinfric.sizing.report import SizingReport
from pinfric.sweeps.summary import sweep_summary

LONG = "a_very_long_name_of_a_joint_that_some_exporter_made_up_from_the_path_of_its_part"


@pytest.fixture(scope="module")
def panda():
    scene, motion = example("panda_pick_and_place", "panda_pick_and_place.csv")
    return scene, motion, pf.inverse_dynamics(scene, motion)


def crowd(count=150):
    """More joints than a screen has lines, with names wider than it."""
    names = [f"{LONG}_{i}" for i in range(count)]
    model = chain(*((name, pin.JointModelRZ(), pin.Inertia.Random()) for name in names))
    friction = dict.fromkeys(names, dry(2.0, 1.0))
    return pf.Scene(model=model, friction=friction, source=f"/a/long/folder/{LONG * 3}.yaml")


def everything(panda):
    scene, motion, result = panda
    yield from (scene, motion, result)
    slope = sliding_block(plane_friction(0.5, 0.3))
    yield pf.forward_dynamics(slope, [0.0], [1.0], [0.0])
    yield pf.simulate(slope, [0.0], [1.0], np.zeros(1), 1.0)
    yield pf.size(scene, motion)
    pushed = pushed_block()
    yield pf.sweep(pushed, steady(pushed), sweep_of(4, speed=uniform(0.9, 1.1)), processes=1)
    many = crowd()
    yield many
    still = np.zeros((11, 150))
    moved = pf.Trajectory.from_arrays(many, np.linspace(0, 1, 11), still, still, still)
    yield moved
    found = pf.inverse_dynamics(many, moved)
    assert found.stick_intervals()
    yield found
    yield pf.forward_dynamics(many, still[0], still[0], still[0])
    yield pf.load_scene("four_bar")


def test_every_repr_is_one_screen_without_arrays(panda):
    things = [*everything(panda)]
    assert_printed(__file__, "repr", "\n\n".join(map(repr, things[:7])))
    for thing in things:
        text = repr(thing)
        lines = text.splitlines()
        assert lines[0].startswith(type(thing).__name__)
        assert len(lines) <= 24
        assert max(map(len, lines)) <= 100
        assert "array(" not in text


def test_repr_of_a_result_without_solution_or_times_says_so():
    slope = sliding_block(plane_friction(0.5, 0.3))
    instants = pf.inverse_dynamics(slope, [[0.0]], [[1.0]], [[0.0]])
    assert "1 sample\n" in repr(instants)
    lost = np.full_like(instants.effort_lower, np.nan)
    broken = replace(instants, effort_lower=lost, effort_upper=lost, status=np.array([1]))
    assert "1 jammed" in repr(broken)
    bare = sliding_block()
    assert "friction  none" in repr(bare)


def test_summary_has_the_figures_of_the_json(panda, tmp_path):
    scene, motion, result = panda
    table = result.summary()
    joints = in_json(inverse_summary(result, ""))["joints"]
    assert list(table.index) == list(scene.actuator_names)
    for joint in joints:
        assert table.loc[joint["name"]].to_dict() == {k: v for k, v in joint.items() if k != "name"}
    sized = pf.size(scene, motion, "default", on_miss="ignore")
    rows = sized.summary()
    for joint in sized.joints:
        row = rows.loc[joint.name]
        assert row["peak"] == joint.demand.peak
        assert row["choice"] == joint.choice.candidate.name
        assert (row["holding_least"], row["holding_worst"]) == joint.demand.holding
        assert row["nearest_miss"] is None
    assert {c: rows.attrs["units"][c] for c in ("peak", "mass", "margin")} == {
        "peak": table.attrs["units"]["peak"],
        "mass": "kg",
        "margin": "1",
    }
    tiny = one_drive(tmp_path)
    missed = pf.size(
        turntable(),
        trapezoid(turntable()),
        tiny,
        on_miss="ignore",
        conditions={"peak_factor": 50.0},
    )
    assert missed.summary()["nearest_miss"]["table"] == missed.verdict.failing[0]


def test_summary_of_a_motion_is_the_slides_closed_form():
    """A 2 kg block, mu 0.3, starts at 1 m/s without a drive: 1 J of heat, at rest at v / (mu g)."""
    slope = sliding_block(plane_friction(0.5, 0.3))
    motion = pf.simulate(slope, [0.0], [1.0], np.zeros(1), 1.0)
    row = motion.summary().loc["slide"]
    assert row["heat"] == pytest.approx(1.0, rel=1e-9)
    assert row["stick_time"] == pytest.approx(1.0 - 1.0 / (0.3 * 9.81), rel=1e-9)
    assert (row["peak"], row["rms"], row["work"], row["unit"]) == (0.0, 0.0, 0.0, "N")


def test_summary_of_an_instant_is_the_slides_closed_form():
    """A 2 kg block that slides backward on mu 0.3; it has no names, so it takes the scene."""
    slope = sliding_block(plane_friction(0.5, 0.3))
    found = pf.forward_dynamics(slope, [0.0], [-1.0], [0.0])
    row = found.summary(slope).loc["slide"]
    assert row["mode"] == "slips backward"
    assert (row["friction"], row["normal_load"]) == pytest.approx((0.3 * 2 * 9.81, 2 * 9.81))
    batch = pf.Instant(*(np.array([field, field]) for field in found))
    with pytest.raises(StateError, match=r"here are 2; pf\.Instant"):
        batch.summary(slope)
    with pytest.raises(StateError, match="it has 6 joints with friction, this instant 1"):
        found.summary(pf.load_scene("ur10"))


def test_summary_of_a_sweep_has_its_percentiles():
    found = swept_panda()
    joint = in_json(sweep_summary(found))["joints"][1]
    row = found.summary().loc["panda_joint2"]
    assert row["peak_95"] == joint["peak"]["percentiles"]["95"]
    units = found.summary().attrs["units"]
    assert (units["peak_95"], units["motor_rms_50"]) == (EFFORT, MOTOR)
    assert row["suffices"] == in_json(sweep_summary(found))["motors"][0]["suffices"]["value"]


def test_plot_is_a_matplotlib_figure(panda):
    scene, motion, result = panda
    figure = result.plot(trajectory="pick.csv", joints=["panda_joint2", "panda_joint4"])
    assert isinstance(figure, Figure)
    assert any("pick.csv" in text.get_text() for text in figure.texts)
    for other in (pf.size(scene, motion), pf.simulate(scene=pf.load_scene("pendulum"))):
        assert isinstance(other.plot(), Figure)
        assert isinstance(pf.plot(other), Figure)
    with pytest.raises(StateError, match="a Scene has no picture"):
        pf.plot(scene)
    with pytest.raises(StateError, match="a Trajectory has no table"):
        pf.summary(motion)


def test_a_figure_is_found_by_its_result_in_plot_and_on_the_page(tmp_path, monkeypatch):
    """A new one is a function with `draws` above it: no list names it."""
    monkeypatch.setattr(registry, "_KNOWN", [*registry.known()])

    @registry.draws(SizingReport, "own", "Speed over the cycle", one=True)
    def own(report, drive):
        figure = Figure(figsize=(5.0, 2.0))
        figure.subplots().plot(report.result.times, report.result.v[:, drive])
        return figure

    scene = turntable()
    report = pf.size(scene, trapezoid(scene), one_drive(tmp_path), on_miss="ignore")
    (line,) = report.plot("own", drive=0).axes[0].lines
    assert_array_equal(line.get_ydata(), report.result.v[:, 0])
    page = sizing_page(report)
    for name in ("envelope", "effort", "heat", "own"):
        assert isinstance(report.plot(name, drive=0), Figure)
        assert f'<figure id="{name}-0"><svg' in page
    assert '<figure id="bus"><svg' in page
    assert isinstance(report.plot("bus"), Figure)
    with pytest.raises(StateError, match="'own' draws one drive: give its number, as drive=0"):
        report.plot("own")
    with pytest.raises(StateError, match=r"SizingReport has no 'heats'; .*heat"):
        report.plot("heats")
    with pytest.raises(StateError, match="this SizingReport lacks what 'bus' shows"):
        pf.size(scene, trapezoid(scene)).plot("bus")


def test_efforts_are_drawn_in_axes_of_the_callers(panda):
    _, _, result = panda
    own = Figure()
    left, right = own.subplots(1, 2)
    assert result.plot(joints=["panda_joint2", "panda_joint4"], ax=[left, right]) is own
    assert [axes.get_title("left") for axes in own.axes] == ["panda_joint2", "panda_joint4"]
    assert {axes.get_ylabel() for axes in own.axes} == {"effort (N m)"}
    assert left.get_xlabel() == "time (s)"
    drawn = [line for line in left.lines if line.get_gid() == "sliding"]
    slides = result.effort_lower[:, 1] == result.effort_upper[:, 1]
    np.testing.assert_array_equal(drawn[0].get_ydata()[slides], result.effort_upper[slides, 1])
    with pytest.raises(StateError, match="1 axes for 7 drives; name as many `joints` as axes"):
        result.plot(ax=left)


def test_dataframe_begins_with_the_motion_in_one_number_a_joint():
    kinds = {
        "wheel": pin.JointModelRUBZ(),
        "slide": pin.JointModelPX(),
        "ball": pin.JointModelSpherical(),
    }
    scene = pf.Scene(chain(*((*kind, pin.Inertia.Random()) for kind in kinds.items())))
    t = np.linspace(0.0, 2.0, 21)
    angle = 5.0 * t  # beyond pi: the column goes on where cosine and sine turn round
    q = np.zeros((21, scene.model.nq))
    q[:, 0], q[:, 1], q[:, 2], q[:, 6] = np.cos(angle), np.sin(angle), 0.1 * t, 1.0
    v = np.tile([5.0, 0.1, 0.0, 0.0, 0.0], (21, 1))
    frame = pf.inverse_dynamics(scene, q, v, 0 * v, t=t).to_dataframe()
    names = ["wheel", "slide", *(f"ball.q[{i}]" for i in range(4))]
    assert list(frame.columns[:8]) == ["t", "wheel.q", "slide.q", *names[2:], "wheel.v"]
    assert_allclose(frame["wheel.q"], angle, atol=1e-12)
    assert_array_equal(frame["slide.q"], 0.1 * t)
    assert frame["ball.a[2]"].tolist() == [0.0] * 21
    assert_array_equal(frame["wheel.v"], v[:, 0])


def test_a_follower_has_no_column_and_its_leader_one():
    scene = mimic_scene()
    motion = pf.simulate(scene, [0.2], [0.5], np.zeros(1), 0.1)
    leader, follower = scene.joint_names
    frame = pf.inverse_dynamics(scene, motion).to_dataframe()
    assert [name for name in frame if name.endswith((".q", ".v", ".a"))] == [
        f"{leader}.q",
        f"{leader}.v",
        f"{leader}.a",
    ]
    assert {f"{leader}.sticking", f"{follower}.sticking"} <= set(frame)
    rows = np.reshape(motion.plot().axes, (-1, 3))
    said = [[t.get_text() for t in row[0].texts] + [row[0].get_title(loc="left")] for row in rows]
    assert said == [[leader], ["follows another joint", follower]]
    assert_allclose(rows[1][1].lines[0].get_ydata(), -0.7 * motion.v[:, 0])


def test_efforts_csv_holds_the_motion_that_was_given(panda):
    _, motion, result = panda
    frame = result.to_dataframe()
    for i, name in enumerate(motion.joint_names):
        assert_array_equal(frame[f"{name}.q"], motion.joint_positions()[:, i])
        assert_array_equal(frame[f"{name}.v"], motion.v[:, i])
        assert_array_equal(frame[f"{name}.a"], motion.a[:, i])
    assert_array_equal(frame["payload.box"], motion.attached[:, 0])


def test_a_notebook_shows_a_result_as_its_table_and_its_figure_as_a_picture(panda):
    shown = panda[2]._repr_html_()
    assert "<th>RMS<br>least–worst<br>N m</th>" in shown  # noqa: RUF001
    table = pf.summary(panda[2])
    pair = f"{table.rms_least.iloc[0]:#.3g}–{table.rms.iloc[0]:#.3g}"  # noqa: RUF001
    assert f"<td>{pair}</td>" in shown
    assert "panda_<wbr>joint2" in shown
    assert "panda_pick_and_place.yaml" in shown
    drawn = panda[2].plot()
    for figure in (drawn, pickle.loads(pickle.dumps(drawn))):
        assert figure._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "name",
    [
        "check",
        "forward_dynamics",
        "holds",
        "inverse_dynamics",
        "load_scene",
        "load_trajectory",
        "retime",
        "simulate",
        "size",
        "sweep",
    ],
)
def test_examples_in_docstrings_run(name):
    found = [
        part for part in doctest.DocTestFinder().find(getattr(pf, name), name) if part.examples
    ]
    assert found
    for part in found:
        assert doctest.DocTestRunner().run(part).failed == 0


@pytest.mark.slow
def test_checks_explanations_and_accuracy_show_themselves_in_a_notebook(monkeypatch):
    monkeypatch.setattr(study, "STEPS", (50, 500))
    monkeypatch.setattr(study, "VELOCITIES", (1e-1, 1e-2))
    shown = pf.check("panda_pick_and_place")._repr_html_()
    assert '<th class="l">what</th>' in shown
    assert "warning" in shown
    scene = pf.load_scene("pendulum")
    effects = explain(scene)._repr_html_()
    assert "<th>cost<br>us</th>" in effects
    assert "friction.<wbr>" not in effects  # keys are words, not names
    measured = study.accuracy(scene, rounds=1)
    assert measured._repr_html_().count("<table") == 1
    assert measured.plot()._repr_png_().startswith(b"\x89PNG")
