"""A compensator for a controller in C++: its limits, its test, the uncertainty of its friction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from pinfric import __version__
from pinfric.dynamics.forward.compensation import freedom_names
from pinfric.dynamics.forward.solver import compensated_states
from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.exporting.cpp import Bounds, CppFiles, EmbeddedState, cpp_files, default_frames
from pinfric.model.brief import file_name
from pinfric.model.scene import Scene
from pinfric.motions.joint_columns import single_positions, stated_limit
from pinfric.sweeps.file import load_sweep
from pinfric.sweeps.parameters import resolve, vary

#: States that the test main compares.
_STATES = 20
#: The default limit of a compensation, as a factor on the largest along the motion.
_SPARE = 1.5
#: States at which the level of friction is compared, and rows of a posterior.
_LEVELS, _DRAWS = 200, 400
#: What `identify` calls its table of draws.
_POSTERIOR = "posterior.csv"


def compensator(
    scene: Scene,
    result: InverseResult,
    frames: Sequence[str],
    unknown: Mapping[str, float],
    name: str,
) -> CppFiles:
    """Return the header and its test.

    Args:
        scene: see `cpp_files`.
        result: inverse dynamics along the motion, or of states, from which limits are made.
        frames: names of links for payloads and wrenches.
        unknown: drive -> e of `level_uncertainty`.
        name: of the namespace.

    Raises:
        PinfricError: see `cpp_files`.
    """
    largest = np.max(np.abs([compensation(result, end) for end in ("lower", "upper")]), axis=(0, 1))
    stable = [stable_scale(unknown.get(name, 0.0)) for name in scene.actuator_names]
    # Where no effort limit of a joint is stated, from what the motion takes
    ends = result.joint_effort_lower, result.joint_effort_upper
    spare = _spare(np.abs(ends).max(axis=(0, 1)))
    stated = [stated_limit(scene.model.effortLimit[d.velocity_index]) for d in scene.drives]
    limits = [a if a < np.inf else b for a, b in zip(stated, spare, strict=True)]
    bounds = Bounds(_spare(largest), limits, stable)
    frames = tuple(frames) or default_frames(scene)
    # States along the motion, the first as it is at rest, with what pinfric computes of them
    picked = np.linspace(0, len(result.status) - 1, _STATES).astype(int)
    q, v, a = (x[picked].copy() for x in (result.states.q, result.states.v, result.states.a))
    v[0] = 0.0
    at_states = inverse_dynamics(replace(scene, measured=None), q, v, a)  # speeds are mentioned
    friction = compensated_states(scene, q, v, a)
    joints = list(scene.model.joints)[1:]
    at = single_positions(q, [joint.nq for joint in joints if joint.nq])
    rows = at, v, a, at_states.motor_torque_lower, at_states.motor_torque_upper, friction
    states = [EmbeddedState(*row) for row in zip(*rows, strict=True)]
    heading = _heading(scene, frames, unknown, name)
    return cpp_files(scene, frames, bounds, states, heading, name)


def _spare(largest: np.ndarray) -> list[float]:
    """Limits: `_SPARE` times the largest values along a motion; infinite where these are 0."""
    return [float(f"{_SPARE * x:.3g}") if x > 0.0 else np.inf for x in largest]


def compensation(result: InverseResult, end: str) -> np.ndarray:
    """Return joint_effort - r^2 J a - tau_id (T, na): friction and gear losses, at the joints.

    Args:
        result: with the drives.
        end: "lower" or "upper", of `joint_effort`.
    """
    gears = result.scene.gears()
    rotors = gears.ratio**2 * gears.rotor_inertia * result.actuator_acceleration
    effort: np.ndarray = getattr(result, f"joint_effort_{end}")
    return effort - rotors - result.effort_frictionless


def level_uncertainty(
    scene: Scene, result: InverseResult, posterior: str | Path | None = None
) -> dict[str, float]:
    """Return the relative uncertainty e of each drive's friction: half its 95 % interval.

    It is that of the mean of |r T_m - r^2 J a - tau_id| where the drive moves, over the rows of the
    posterior that `identify` wrote. Drives that never move are left out; without a posterior all.

    Args:
        scene: identified.
        result: inverse dynamics along the motion at whose states levels are compared.
        posterior: table of factors on the scene's coefficients; None: `posterior.csv` beside the
            scene's file, if there is one.

    Raises:
        SweepError: a table that is not the scene's.
    """
    table = Path(scene.source).with_name(_POSTERIOR) if posterior is None else Path(posterior)
    if posterior is None and not table.is_file():
        return {}
    content = {"pinfric_sweep": 1, "samples": 1, "table": str(table)}
    targets = resolve(scene, load_sweep(content)[0], str(table))
    values = np.array([target.distribution.values for target in targets])[:, :_DRAWS]  # type: ignore[attr-defined]
    picked = np.unique(np.linspace(0, len(result.status) - 1, _LEVELS).astype(int))
    q, v, a = (array[picked] for array in (result.states.q, result.states.v, result.states.a))
    stick = np.array([scene.stick_velocity_of(drive) for drive in scene.drives])
    moving = np.abs(result.actuator_velocity[picked]) > stick
    levels = np.array(
        [
            _level(inverse_dynamics(vary(scene, targets, list(row)), q, v, a), moving)
            for row in values.T
        ]
    )
    known = _level(inverse_dynamics(replace(scene, measured=None), q, v, a), moving)
    low, high = np.percentile(levels, [2.5, 97.5], axis=0)
    return {
        drive.name: float(0.5 * (high[d] - low[d]) / known[d])
        for d, drive in enumerate(scene.drives)
        if known[d] > 0.0
    }


def stable_scale(e: float) -> float:
    """Return 1/(1 + e), which keeps a model too large by e passive at the measured velocity."""
    return 1.0 / (1.0 + e)


def _level(result: InverseResult, moving: np.ndarray) -> np.ndarray:
    lost = np.abs(compensation(result, "lower")) * moving
    return lost.sum(axis=0) / np.maximum(moving.sum(axis=0), 1)


def _heading(
    scene: Scene, frames: Sequence[str], unknown: Mapping[str, float], name: str
) -> list[str]:
    known = [
        f"  {drive}: friction known to {e:.1%} (e, half of the 95 % interval); stable scale at the "
        f"measured velocity 1/(1+e) = {stable_scale(e):.3f}"
        for drive, e in unknown.items()
    ]
    return [
        f"{name}: joint friction and gear losses of {file_name(scene.source)} for a controller,",
        f"with the load that the joints carry now. Written by pinfric {__version__}; do not edit.",
        "",
        f"Units rad, m, s, kg, N, N m. Freedoms: {', '.join(freedom_names(scene))}.",
        f"Drives: {', '.join(scene.actuator_names)}.",
        f"Frames for payloads and wrenches: {', '.join(frames) or 'none'}.",
        "Carried already: "
        + (", ".join(n for n, payload in scene.payloads.items() if payload.attached) or "nothing")
        + ".",
        *(["How far friction is known (`pinfric identify`):", *known] if known else []),
        "",
        f"  {name}::Compensator compensator;    // once",
        f"  {name}::Options options;            // one number per drive",
        f"  {name}::State state;                // arrays of {scene.model.nv} numbers",
        "  state.q = q; state.v = v; state.a = a;",
        "  if (compensator.joint_effort(state, options, effort))",
        "    ...                               // effort[] (N m or N at the joints): rigid body,",
        "                                      // rotors, friction; friction(...): friction alone,",
        "                                      // friction_measured(...): at a measured velocity",
        "",
        "joint_effort lies in the interval of `inverse` only where no joint is within its band of",
        "switch_velocity, at scale 1, and no limit cuts it. Stiffness and hysteresis of gears are",
        "left out: what a spring winds up is not compensated.",
    ]
