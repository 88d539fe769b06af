"""What logs say of each other, and of friction at rest, against figures worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from identify_cases import (
    COULOMB,
    DELAY,
    EFFICIENCY,
    MU,
    NAMES,
    PLAIN,
    VISCOUS,
    excitation,
    guess,
    parameter,
    short,
)

import pinfric as pf
from pinfric.identification.columns import Rows
from pinfric.identification.laws import FORWARD, SLOTS
from pinfric.identification.normal import Fit
from pinfric.identification.uncertainty import (
    Uncertainty,
    between_logs,
    for_a_further_log,
)


@pytest.mark.parametrize(
    ("factors", "spread"),
    [
        # means 1.0 and 1.2, variance 0.02; blocks: variance 0.02 over 2 each, 0.01 taken off
        ([[1.1, 0.9], [1.3, 1.1]], 0.1),
        ([[1.0, 1.0], [1.2, 1.2]], np.sqrt(0.02)),
        ([[1.3, 0.7], [1.2, 0.8]], 0.0),
    ],
)
def test_what_blocks_of_one_log_scatter_is_no_difference_between_logs(factors, spread):
    """One joint with 2 N m of Coulomb friction, ten rows in each block."""
    factor = np.repeat(np.ravel(factors), 10)
    slots = np.zeros((40, len(SLOTS)))
    slots[:, FORWARD] = 1.0
    still = np.zeros(40)
    rows = Rows(
        np.zeros((40, 10)),
        slots,
        2.0 * factor,
        np.repeat(np.arange(4), 10),
        np.repeat([0, 1], 20),
        still,
        still,
        still,
    )
    fit = Fit(np.zeros(10), 2.0 * (np.arange(len(SLOTS)) == FORWARD)[None, :])
    found = SimpleNamespace(prepared=[None, None], rows=[rows], fit=fit)
    assert between_logs(found) == pytest.approx([spread], abs=1e-9)


def test_coefficients_lie_in_their_intervals(found):
    known = [
        (parameter(found, "friction", 2, "mu"), MU),
        (parameter(found, "transmission", 1, "efficiency"), EFFICIENCY),
    ]
    for j in range(6):
        for name, value in (
            ("coulomb.positive", COULOMB[j][0]),
            ("viscous", VISCOUS[j]),
            ("coulomb.negative", COULOMB[j][1]),
        ):
            known.append((parameter(found, "friction", j, name), value))
    inside = [p.low <= value <= p.high for p, value in known]
    assert np.mean(inside) > 0.8
    assert all(abs(p.value - value) < 0.15 * abs(value) for p, value in known)
    # standard errors of samples taken as independent would be three times too small
    assert parameter(found, "friction", 1, "coulomb.positive").standard_error > 0.1


def test_the_posterior_scatters_as_the_intervals_say(found):
    p = parameter(found, "friction", 1, "coulomb.positive")
    draws = found.posterior[p.key]
    assert np.mean((draws > p.low) & (draws < p.high)) == pytest.approx(0.95, abs=0.03)
    gear = found.posterior[f"transmission.{NAMES[1]}.efficiency"]
    # a gear that loses more leaves less to Coulomb friction
    assert np.corrcoef(draws, gear)[0, 1] > 0.3


@pytest.mark.slow
def test_two_logs_say_how_much_friction_differs_between_them():
    other = short(3)
    warm = replace(other, effort=other.effort - 0.3 * drag(3, 20.0, 100.0), name="warm")
    found = pf.identify(guess(0), [short(), warm], laws=PLAIN)
    # a third of joint 6's viscous friction was taken off in one of them, and it is most of it
    assert 0.05 < found.spread[NAMES[5]] < 0.25
    assert found.delay == pytest.approx(DELAY, abs=0.0015)
    assert "delay of the efforts from each log, with standard error: log " in "\n".join(found.notes)
    viscous = parameter(found, "friction", 5, "viscous")
    assert viscous.standard_error > 0.8 * found.spread[NAMES[5]] * viscous.value


def drag(seed: int, duration: float, rate: float) -> np.ndarray:
    return excitation(seed, duration, rate).v * np.array(VISCOUS)


@pytest.mark.parametrize("logs", [2, 3, 5])
def test_an_interval_covers_a_further_log(logs):
    """Coulomb friction of 2 N m, times a factor that scatters by 5 % from log to log."""
    rng, slot, inside = np.random.default_rng(logs), FORWARD, []
    fit = Fit(np.zeros(10), (np.arange(len(SLOTS)) == slot)[None, :] * 2.0)
    slots, still = np.zeros((4 * logs, len(SLOTS))), np.zeros(4 * logs)
    slots[:, slot] = 1.0
    for _ in range(600):
        factors = 1.0 + 0.05 * rng.normal(size=logs + 1)
        effort = 2.0 * np.repeat(factors[:-1] / factors[:-1].mean(), 4)
        rows = Rows(
            np.zeros((4 * logs, 10)),
            slots,
            effort,
            np.repeat(np.arange(2 * logs), 2),
            np.repeat(np.arange(logs), 4),
            still,
            still,
            still,
        )
        given = SimpleNamespace(rows=[rows], fit=fit, prepared=[None] * logs)
        between, count = for_a_further_log(given, np.array([slot]))
        known = Uncertainty(np.array([slot]), 1e-12 * np.eye(1), between, 20, count, np.zeros(1))
        _, reach = known.of([slot])
        inside.append(abs(2.0 * factors[-1] / factors[:-1].mean() - 2.0) <= reach)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)
