"""The solver's compensation is that of the C++ header."""

from __future__ import annotations

import numpy as np
import pytest
from export_cases import (
    RICH,
    SETTINGS,
    assert_columns,
    configurations,
    sampled,
)


@pytest.mark.parametrize("options", SETTINGS, ids=range(len(SETTINGS)))
@pytest.mark.parametrize("scene", RICH[2:], ids=lambda scene: scene.source)
def test_the_solver_compensates_as_the_header(headers, scene, options):
    q, v, a = sampled(scene, 4, 40)
    rng = np.random.default_rng(4)
    v_ref, v_now = v + rng.normal(scale=0.1, size=v.shape), v + rng.normal(scale=0.1, size=v.shape)
    error = rng.normal(scale=0.01, size=v.shape)
    solver, full = scene.solver(), configurations(scene, q)
    for moving in (True, False):
        state = (v, a) if moving else (None, None)
        found = headers.ask(scene, q, *state, v_ref, error=error, v_now=v_now, options=options)
        expected = [
            solver.compensate(
                full[i],
                *(x[i] if moving else None for x in (v, a)),
                v_ref[i],
                error=error[i],
                v_now=v_now[i],
                options=options,
            )
            for i in range(len(q))
        ]
        assert_columns(found["friction"], np.array(expected), "friction")
