"""The paper reproduced: printed stick times, recovered torques, two formulations."""

import pytest
from cli_cases import refused, results_in, run, told
from envelopes import result_of


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What `pinfric paper --json --out DIR` prints and writes."""
    import contextlib
    import io

    folder = tmp_path_factory.mktemp("paper") / "out"
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        assert run("paper", "--json", "--out", folder) == 0
    return result_of(text.getvalue()), folder


#: Bounds: the printed times, and what the readings of the data leave open.
STICKS = {
    "pendulum": ((1.060, 1.072), (1.208, 1.216)),
    "three_link": ((0.515, 0.523), (0.555, 0.561)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", STICKS)
def test_the_paper_is_reproduced(printed, name):
    example = next(e for e in printed[0]["examples"] if e["name"] == name)
    for found in (example["stick"], example["stick_absolute"]):
        for value, (low, high) in zip(found, STICKS[name], strict=True):
            assert low <= value <= high
    assert example["stick"] == pytest.approx(example["stick_absolute"], abs=1e-9)
    assert example["max_torque_error"] < 1e-7
    assert example["bracketed"] == 1.0
    assert example["max_width_error"] < 1e-9
    assert example["max_formulation_difference"] < 1e-8


@pytest.mark.slow
def test_both_formulations_close_a_loop_alike(printed):
    assert printed[0]["closed_loop"]["name"] == "slider_crank"
    assert 0.0 < printed[0]["closed_loop"]["max_formulation_difference"] < 1e-10


@pytest.mark.slow
def test_the_readings_are_stated_and_the_figures_drawn(printed):
    answer, folder = printed
    assert len(answer["readings"]) == 4
    names = set(results_in(folder))
    assert names == {f"figure_{n}.{kind}" for n in (5, 6, 8, 9, 10) for kind in ("png", "pdf")} | {
        "summary.json"
    }


@pytest.mark.slow
def test_the_literal_reading_sticks_early_and_stops(capsys):
    said = told(capsys, "paper", "--reading", "literal", "--json")
    examples = {e["name"]: e for e in result_of(said.out)["examples"]}
    for name, example in examples.items():
        start, end = example["stick"]
        assert start < STICKS[name][0][0]  # earlier than printed
        assert example["no_consistent_acceleration_at"] == pytest.approx(end, abs=1e-9)


def test_an_unknown_reading_is_refused(capsys):
    error = refused(capsys, "paper", "--reading", "own")
    assert "there are consistent, literal" in error
