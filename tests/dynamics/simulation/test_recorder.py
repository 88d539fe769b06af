"""What a run records: samples at their times and events, progress, interruption."""

import numpy as np
import pytest
from builders import guided
from numpy.testing import assert_allclose
from simulation_cases import SHORT, G, slope, swing

import pinfric as pf
from pinfric.errors import SimulationError


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_ctrl_c_keeps_what_was_computed(method):
    """The interrupt goes on, as in every other call, so that a loop over calls ends."""

    def effort(t, q, v):
        if t > 0.5:
            raise KeyboardInterrupt
        return [1.0]

    with pytest.raises(KeyboardInterrupt) as ended:
        pf.simulate(slope(), [0.0], [3.0], effort, 1.0, method, **SHORT[method])
    motion = ended.value.motion
    assert motion.status == "interrupted"
    assert 0.45 < motion.t[-1] < 0.52
    assert motion.energy().change < 0
    assert len(motion.t) == len(motion.q) == len(motion.friction) > 400


def test_ctrl_c_before_the_first_sample_goes_on(monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("pinfric.dynamics.simulation.simulate.EventIntegration", interrupted)
    with pytest.raises(KeyboardInterrupt):
        pf.simulate(slope(), [0.0], [3.0], [1.0], 1.0)


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_progress_is_told(method, capsys):
    seen: list[float] = []
    pf.simulate(slope(), [0.0], [1.0], [0.0], 1.0, method, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.0)
    pf.simulate(slope(), [0.0], [1.0], [0.0], 1.0, method)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("method", "within"), [("event", 1e-9), ("timestepping", 1e-3), ("regularized", 1e-3)]
)
def test_a_joint_that_leaves_its_range_is_reported_not_stopped(method, within):
    scene = slope(0.5, lowerPositionLimit=[-1.0], upperPositionLimit=[0.25])
    motion = pf.simulate(scene, [0.0], [0.0], [0.0], 1.0, method)
    a = G * (np.sin(0.5) - 0.25 * np.cos(0.5))
    limits = [e for e in motion.events if e.kind == "limit"]
    assert [(e.name, e.direction) for e in limits] == [("slide", 1)]
    assert limits[0].time == pytest.approx(np.sqrt(0.5 / a), abs=within)
    assert motion.q[-1, 0] > 0.5


def test_samples_come_at_their_times_and_at_events():
    motion = swing(sample_step=0.1)
    regular = np.arange(21) * 0.1
    events = [e.time for e in motion.events]
    assert len(events) >= 4
    assert_allclose(motion.t, np.sort([*regular, *events]), atol=1e-12)
    assert (np.diff(motion.t) > 0).all()
    stepped = swing("timestepping", dt=1e-3, sample_step=0.1)
    assert_allclose(stepped.t, regular, atol=1e-12)


@pytest.mark.parametrize("method", ["event", "timestepping", "regularized"])
def test_a_roll_moment_on_a_guide_without_width_is_refused(method):
    with pytest.raises(SimulationError, match=r"t = 0 s: friction\.slide.*width"):
        pf.simulate(guided(0.1), [0.0], [1.0], [0.0], 1.0, method)
    assert pf.simulate(guided(0.0), [0.0], [1.0], [0.0], 0.1, method).status == "finished"
