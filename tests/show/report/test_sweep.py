"""What a sweep prints and draws: within 80 columns, JSON that parses, figures of odd sweeps too."""

import json

import pytest
from builders import example
from printed import assert_printed
from sweep_cases import BOX, DRIVE, pushed_block, steady, steps, sweep_of, uniform

import pinfric as pf
from pinfric.model.described import in_json
from pinfric.show.figure.sweep import sweep_figure
from pinfric.show.report.sweep import sweep_report
from pinfric.show.report.values import digits
from pinfric.sweeps.summary import sweep_summary
from pinfric.terminal import as_text, show


def printed(result, capsys):
    show(sweep_report(result, sweep_summary(result)))
    return [line.rstrip() for line in capsys.readouterr().out.splitlines()]


def test_tables_fit_in_80_columns_and_name_every_joint(panda, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    lines = printed(panda, capsys)
    assert all(len(line) <= 80 for line in lines)
    tables = [line for line in lines if line.startswith("joint2 ")]
    # three tables have a row for every joint, the motors' one for those on trial
    assert [line.split()[0] for line in tables[:3]] == ["joint2"] * 3
    assert tables[0].split()[1] == digits(panda.quantiles("peak")[0, 1])
    assert tables[2].split()[1:3] == ["box.mass", "+1.00"]  # it alone moves joint 2
    share = panda.probability(panda.sufficing()).value
    assert f"{100 * share:.1f} %" in next(
        line for line in lines if "(1 of 7 drives) suffices" in line
    )
    assert any("joint2: speed-torque line" in line for line in lines)


def test_json_holds_percentiles_correlations_and_odds(panda):
    content = json.loads(as_text(in_json(sweep_summary(panda))))
    assert [p["name"] for p in content["parameters"]] == list(panda.parameter_names)
    joint = content["joints"][1]
    assert joint["motor_rms"]["percentiles"]["50"] == panda.quantiles("motor_rms")[1, 1]
    assert joint["rms"]["rank_correlation"]["payload.box.mass"] > 0.9
    assert content["motors"][0]["criteria"]["peak torque"]["value"] == 1.0
    assert "amplifier currents" in content["motors"][0]["not_checked"]


@pytest.mark.parametrize("sampling", ["random", "sobol", "grid"])
def test_sweeps_that_hardly_vary_print_and_draw(sampling, capsys):
    scene = pushed_block(payloads={"box": BOX})
    sweep = (
        sweep_of(sampling="grid", speed=steps(1.0, 2.0, 2))
        if sampling == "grid"
        else sweep_of(1 if sampling == "random" else 4, sampling, speed=uniform(1.0, 2.0))
    )
    result = pf.sweep(scene, steady(scene), sweep, processes=1)
    lines = printed(result, capsys)
    assert any(line.startswith("slide") for line in lines)
    assert "at the joints, N" in lines
    sweep_figure(result).draw_without_rendering()
    as_text(in_json(sweep_summary(result)))  # NaN as null


def test_drive_of_the_catalogue_shows_what_fails_and_what_was_not_checked(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    scene, motion = example(
        "panda_pick_and_place", "panda_pick_and_place.csv", masses="without_drives"
    )
    result = pf.sweep(
        scene,
        motion,
        sweep_of(
            20,
            motors={"panda_joint2": {"drive": DRIVE}},
            payload__box__mass=uniform(0.5, 2.0),
        ),
        processes=1,
    )
    lines = printed(result, capsys)
    assert all(len(line) <= 80 for line in lines)
    text = " ".join(" ".join(lines).split())
    met = result.met(result.trials[0])["gear repeated peak torque"]
    assert 0 < met.sum() < 20
    assert f"{100 * (1 - met.mean()):.1f} %" in text.split("motors: share of samples")[1]
    assert_printed(__file__, "sweep", "\n".join(lines))  # joint2 1.54 kg: a kit, 1.25 x 1.23
    sweep_figure(result).draw_without_rendering()
    content = json.loads(as_text(in_json(sweep_summary(result))))["motors"]
    assert content[0]["criteria"]["gear repeated peak torque"]["value"] == met.mean()
