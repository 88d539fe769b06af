"""`pinfric simulate`: its table, its JSON, its files."""

import pytest
from cli_cases import refused, results_in, told
from envelopes import result_of
from judges.verdict import judge
from printed import assert_printed

import pinfric as pf


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_the_scenes_own_simulation_runs_by_every_method(capsys, method):
    answer = result_of(told(capsys, "simulate", "pendulum", "--method", method, "--json").out)
    assert answer["method"] == method
    assert answer["t_end"] == pytest.approx(2.0)
    energy = answer["energy"]
    losses = sum(energy["friction_loss"].values())
    assert losses > 0
    assert energy["work"] == pytest.approx(energy["change"] + losses, rel=5e-3)
    sticks = [i for i in answer["stick_intervals"] if i["end"] - i["start"] > 0.05]
    assert sticks[0]["start"] == pytest.approx(1.0649, abs=5e-3)
    if method == "regularized":  # it knows no static friction, and lets go too early
        assert 1.1 < sticks[0]["end"] < 1.2
    else:
        assert sticks[0]["end"] == pytest.approx(1.2128, abs=5e-3)


def test_files_and_table(capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    printed = told(capsys, "simulate", "three_link", "--t-end", 0.6, "--out", tmp_path / "out").out
    assert_printed(__file__, "simulate", printed)
    assert set(results_in(tmp_path / "out")) == {
        "motion.csv",
        "motion.npz",
        "motion.pdf",
        "motion.png",
        "summary.json",
    }
    scene = pf.load_scene("three_link")
    motion = pf.load_motion(tmp_path / "out" / "motion.npz", scene)
    assert motion.t[-1] == pytest.approx(0.6)
    some = (x[::10] for x in (motion.q, motion.v, motion.a))
    assert judge(pf.inverse_dynamics(scene, *some)).passed()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["pendulum", "--method", "magic"], "magic"),
        (["pendulum", "--t-end", "-1"], "t_end"),
        (["pendulum", "--method", "timestepping", "--dt", "0"], "dt"),
        (["ur5_pick_and_place"], "`simulation`"),
    ],
)
def test_what_cannot_be_simulated_is_said_in_one_line(capsys, arguments, says):
    error = refused(capsys, "simulate", *arguments)
    assert says in error
