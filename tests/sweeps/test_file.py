"""Errors of a sweep's file are refused by name, all of them at once."""

import re
from pathlib import Path

import pytest
import yaml
from sweep_cases import BOX, DRIVE, pushed_block, steady, steps, sweep_of, uniform
from tables import table

import pinfric as pf
from pinfric.errors import SweepError
from pinfric.sweeps.file import load_sweep

FINE = uniform(0.5, 1.5)


def refused(content):
    scene = pushed_block(payloads={"box": BOX})
    with pytest.raises(SweepError) as caught:
        pf.sweep(scene, steady(scene), content, processes=1)
    return str(caught.value)


DISTRIBUTIONS = """
{normal: {mean: 1, std: 0.3}}                        normal has no lower bound (0.043 % of it lies
{uniform: {low: -0.1, high: 1}}                      uniform reaches down to -0.1
{uniform: {low: 2, high: 1}}                         uniform`: low 2 is not below high 1
{uniform: {low: 1, high: 1}}                         low 1 is not below high 1
{uniform: {low: 1, high: .inf}}                      uniform.high
{uniform: {low: 1}}                                  mu.uniform.high` is missing
{lognormal: {median: 1, sigma: 0}}                   lognormal.sigma
{lognormal: {median: 1, sigma: 500}}                 reach infinity
{lognormal: {median: -1, sigma: 0.3}}                lognormal.median
{truncated_normal: {mean: 1, std: 0.1}}              needs `low` or `high`
{truncated_normal: {mean: 1, std: 0.1, high: 2}}     has no lower bound
{truncated_normal: {mean: 1, std: 0.1, low: 3}}      contains almost nothing
{truncated_normal: {mean: 1, std: -0.1, low: 0}}     truncated_normal.std
{choice: {values: []}}                               choice.values
{choice: {values: [1, 1]}}                           contains a value twice
{choice: {values: [-1, 2]}}                          choice reaches down to -1
{steps: {low: 0, high: 1, count: 1}}                 steps.count
{steps: {low: 0, high: 1, count: true}}              steps.count
{}                                                   give one of normal, truncated_normal, uniform
{uniform: {low: 1, high: 2}, normal: {mean: 1, std: 1}}  found normal, uniform
{unifrom: {low: 0, high: 1}}                         'uniform'?
"""


@pytest.mark.parametrize(("distribution", "words"), table(DISTRIBUTIONS, yaml.safe_load, str))
def test_impossible_distribution_is_refused_by_name(distribution, words):
    message = refused(sweep_of(friction__all__mu=distribution))
    assert "parameters.friction.*.mu" in message
    assert words in message


PARAMETERS = """
payload.box.mass               {uniform: {low: 0, high: 1}}          a mass must be above 0
payload.bax.mass               {uniform: {low: 1, high: 2}}          'box'?
payload.box.inertia            {uniform: {low: 1, high: 2}}          unknown parameter
speed                          {uniform: {low: -1, high: 1}}         a speed factor must be above 0
speed                          {steps: {low: 0, high: 1, count: 3}}  a speed factor must be above 0
sped                           {uniform: {low: 1, high: 2}}          'speed'?
mounting.roll                  {uniform: {low: -20, high: 20}}       are these degrees?
mounting.yaw                   {uniform: {low: 1, high: 2}}          unknown parameter
friction.slid.mu               {uniform: {low: 1, high: 2}}          'slide'?
friction.*.coulomb             {uniform: {low: 1, high: 2}}          no joint with coulomb in this
friction.slide.radius          {uniform: {low: 1, high: 2}}          unknown parameter
transmission.*.no_load_torque  {uniform: {low: 1, high: 2}}          no drive with no_load_torque
speed                          {uniform: {low: 1, high: 2}, each: true}  there is only one speed
"""


@pytest.mark.parametrize(
    ("name", "distribution", "words"), table(PARAMETERS, str, yaml.safe_load, str)
)
def test_parameter_that_cannot_be_is_refused_by_name(name, distribution, words):
    message = refused({**sweep_of(), "parameters": {name: distribution}})
    assert f"parameters.{name}" in message
    assert words in message


def test_no_load_torque_that_an_efficiency_has_in_it_is_not_varied_apart():
    gear = {
        "ratio": 10.0,
        "efficiency": {"rated": 0.8, "load": 50.0},
        "back_efficiency": 0.7,
        "no_load_torque": 0.01,
    }
    scene = pushed_block(actuators=[{"joint": "slide", "transmission": gear}])
    content = {**sweep_of(), "parameters": {"transmission.*.no_load_torque": FINE}}
    with pytest.raises(SweepError, match="efficiency of slide includes the no-load loss"):
        pf.sweep(scene, steady(scene), content, processes=1)


def test_everything_wrong_with_the_parameters_is_said_at_once():
    message = refused(
        {
            **sweep_of(),
            "parameters": {
                "speed": uniform(-1.0, 1.0),
                "friction.none.mu": FINE,
                "friction.*.mu": {**FINE, "each": True},
                "friction.slide.mu": FINE,
            },
        }
    )
    assert "must be above 0" in message
    assert "'none'" in message
    assert "friction.slide.mu is given twice" in message


DESIGNS = f"""
samples: 0                           `samples`
samples: true                        `samples`
samples: null                        `samples` is missing
seed: -1                             `seed`
sampling: montecarlo                 `sampling`
{{sampling: sobol, samples: 100}}    not a power of two from 2 on
{{sampling: sobol, samples: 1}}      take 2
sampling: grid                       the values of a grid set their number
{{sampling: grid, samples: null}}    takes `steps` or `choice`, not uniform
percentiles: [5, 101]                101 is not between 0 and 100
parameters: {{}}                     `parameters`
condtions: {{}}                      'conditions'?
motors: {{slidr: {{drive: "{DRIVE}"}}}}  'slide'?
motors: {{slide: {{}}}}              `motors.slide.drive`
motors: {{slide: {{drive: D, peak_torque: 1}}}}  there are: drive
motors: {{slide: {{motor: M}}}}      there are: drive
motors: {{slide: {{drive: no such}}}}  the catalogue has no drive 'no such'
pinfric_sweep: 2                     pinfric_sweep
"""


@pytest.mark.parametrize(("change", "words"), table(DESIGNS, yaml.safe_load, str))
def test_impossible_design_is_refused(change, words):
    assert words in refused({**sweep_of(friction__all__mu=FINE), **change})


def test_grid_of_too_many_points_is_refused():
    many = steps(1.0, 2.0, 100_000)
    grid = sweep_of(sampling="grid", speed=many, friction__all__mu=many)
    assert "10,000,000,000 samples" in refused(grid)


def test_what_does_not_fit_the_memory_is_refused(monkeypatch):
    """Before anything is drawn: Linux ends a process that takes more, without a word."""
    monkeypatch.setattr("os.sysconf", {"SC_PHYS_PAGES": 1_000_000, "SC_PAGE_SIZE": 1000}.get)
    varied = sweep_of(10_000_000, speed=uniform(0.5, 2.0))
    words = "10,000,000 samples of 1 parameter and 1 drive take some 1 GB, and this machine has 1 "
    assert words in refused(varied)
    design = {"sampling": "sobol", "samples": 2**23}
    assert "Sobol's design has 25,165,824 samples; at most" in refused(varied | design)


def test_no_processes_are_refused():
    scene = pushed_block()
    with pytest.raises(SweepError, match="processes = 0"):
        pf.sweep(scene, steady(scene), sweep_of(speed=uniform(1, 2)), processes=0)


def test_file_is_read_and_named_in_messages(tmp_path):
    path = tmp_path / "my.sweep.yaml"
    path.write_text(yaml.safe_dump(sweep_of(7, speed=FINE)))
    entries, source = load_sweep(path)
    assert entries.samples == 7
    assert source == str(path)
    path.write_text("pinfric_sweep: 1\nsamples: 7\n")
    with pytest.raises(SweepError, match=r"my\.sweep\.yaml: `parameters` or `table` is missing"):
        load_sweep(path)
    with pytest.raises(SweepError, match=r"there are: .*panda_pick_and_place\.sweep\.yaml"):
        load_sweep("panda_pick")


def test_example_in_the_guide_fits_the_panda():
    page = (Path(__file__).parents[2] / "notebooks/guide/sweep.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"^```yaml\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    scene = pf.load_scene("panda_pick_and_place")
    motion = pf.load_trajectory("panda_pick_and_place.csv", scene)
    found = pf.sweep(scene, motion, {**yaml.safe_load(example), "samples": 3}, processes=1)
    assert found.solved.all()
    assert [trial.drive for trial in found.trials] == ["panda_joint2"]
