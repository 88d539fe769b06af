"""The paper's two examples end to end: forward, then inverse along the forward motion, twice.

The paper simulates a pendulum and a three-link robot under given torques and recovers the torques
by inverse dynamics; in stiction an interval brackets them. Here the Pinocchio-based formulation
does this, and the paper's own, in absolute coordinates, judges it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pinfric.dynamics.inverse.inverse import inverse_dynamics
from pinfric.dynamics.inverse.result import InverseResult
from pinfric.dynamics.samples.reactions import joint_wrenches
from pinfric.dynamics.simulation import simulate as simulation
from pinfric.dynamics.simulation.motion import Motion
from pinfric.model.described import derived, described, quantity
from pinfric.model.scene import Scene
from pinfric.model.scene_file import load_scene
from pinfric.motions.joint_columns import joint_columns, single_positions
from pinfric.motions.trajectory import load_trajectory
from pinfric.paper.bodies import Mechanism
from pinfric.paper.examples import Case, pendulum, slider_crank, three_link
from pinfric.paper.forward import NoConsistentFriction
from pinfric.paper.inverse import inverse
from pinfric.paper.simulate import simulate

#: Samples per second at which the forward motion is handed to inverse dynamics.
SAMPLE_RATE = 2000
#: What a torque may lie outside its interval by rounding, N m.
SLACK = 1e-9

#: The bundled scene of a closed loop, and every how many samples of its motion one is compared.
CLOSED_LOOP, LOOP_STRIDE = "slider_crank", 10

#: Where the printed data are ambiguous or say nothing, and the reading that fits its results.
READINGS = (
    "static friction 0.35, kinetic 0.30 (printed the other way round)",
    "the pendulum's J is about its centre of mass (printed: about O)",
    "a pin carries load at its two ends, F_r/2 +- M_b x k/d; the planar pendulum's pin |F_r|",
    "gravity is 9.81 m/s^2 (not printed; 9.80 fits as well)",
)


@dataclass(frozen=True)
class Example:
    """One of the paper's examples: a bundled scene, its judge, and the printed stick times (s)."""

    name: str
    site: str
    judge: Callable[..., Case]
    printed: tuple[float, float]


EXAMPLES = (
    Example("pendulum", "joint_1", pendulum, (1.07, 1.21)),
    Example("three_link", "joint_12", three_link, (0.521, 0.558)),
)


@described
class Reproduction:
    """One example as reproduced.

    Attributes:
        example: which.
        scene: of it.
        motion: the forward motion, by the event method.
        result: inverse dynamics along it.
        frictionless: the same without friction.
    """

    example: Example
    scene: Scene
    motion: Motion
    result: InverseResult
    frictionless: InverseResult
    stick: tuple[float, float] = quantity("when the site sticks in the forward motion", "s")
    stick_absolute: tuple[float, float] = quantity("the same by the absolute formulation", "s")
    max_torque_error: float = quantity("largest |recovered - applied| outside stiction", "N m")
    bracketed: float = quantity(
        "share of the stick samples whose interval contains the applied torque"
    )
    max_width_error: float = quantity(
        "largest |width of the interval - 2 mu_s c| in stiction", "N m"
    )
    max_formulation_difference: float = quantity(
        "largest difference between the two formulations in efforts (both ends), loads and "
        "reactions, along the motion",
        "N m, N",
    )

    @property
    @derived()
    def name(self) -> str:
        """The example's name."""
        return self.example.name

    @property
    @derived("s")
    def printed(self) -> tuple[float, float]:
        """When the paper says that it sticks."""
        return self.example.printed


@described
class ClosedLoop:
    """A closed loop by both formulations."""

    name: str = quantity("of its scene")
    max_formulation_difference: float = quantity("largest, as in the examples", "N m, N")


@described
class Examples:
    """Both examples of the paper, and a closed loop."""

    examples: tuple[Reproduction, ...] = quantity("as reproduced")
    loop: float

    @property
    @derived()
    def reading(self) -> str:
        """How the printed data are read."""
        return "consistent"

    @property
    @derived()
    def readings(self) -> tuple[str, ...]:
        """What that reading takes for meant."""
        return READINGS

    @property
    @derived()
    def closed_loop(self) -> ClosedLoop:
        """A closed loop with a translational joint by both formulations."""
        return ClosedLoop(CLOSED_LOOP, self.loop)


def reproduce(example: Example) -> Reproduction:
    """Simulate one example, recover its torques by both formulations, and compare."""
    scene = load_scene(example.name)
    whole = simulation.simulate(scene, method="event", rtol=1e-11, atol=1e-13)
    motion = whole.sample(np.linspace(0.0, whole.t[-1], round(SAMPLE_RATE * whole.t[-1]) + 1))
    result = inverse_dynamics(scene, motion)
    frictionless = inverse_dynamics(dataclasses.replace(scene, friction={}), motion)
    site = scene.site_names.index(example.site)
    drive = scene.actuator_names.index(example.site)
    outside = ~(result.sticking | result.reversal).any(axis=1)
    error = np.maximum(
        np.abs(result.effort_lower - motion.effort), np.abs(result.effort_upper - motion.effort)
    )
    stuck = result.sticking[:, site]
    inside = (result.effort_lower <= motion.effort + SLACK) & (
        motion.effort <= result.effort_upper + SLACK
    )
    width = (result.effort_upper - result.effort_lower)[stuck, drive]
    limit = 2 * scene.sites[site].law.static.mu * result.normal_load[stuck, site]
    judged = example.judge()
    forward = simulate(judged.mechanism, judged.position, judged.rate, judged.effort, whole.t[-1])
    return Reproduction(
        example=example,
        scene=scene,
        motion=motion,
        result=result,
        frictionless=frictionless,
        stick=next((i.start, i.end) for i in whole.stick_intervals() if i.site == example.site),
        stick_absolute=forward.stick_intervals(example.site)[0],
        max_torque_error=float(error[outside].max()),
        bracketed=float(inside[stuck].all(axis=1).mean()) if stuck.any() else 0.0,
        max_width_error=float(np.abs(width - limit).max(initial=0.0)),
        max_formulation_difference=formulation_difference(result, judged.mechanism),
    )


def formulation_difference(result: InverseResult, mechanism: Mechanism) -> float:
    """Return the largest difference of the two formulations along a motion (N m, N).

    Of both ends of efforts and friction, normal loads, and reaction wrenches at the sites (without
    loops at all joints). Reversals between samples are left out: the paper's formulation knows
    single states only.
    """
    states, scene = result.states, result.scene
    columns = {column.name: column for column in joint_columns(scene.loaded_model(), scene.source)}
    single = single_positions(states.q, [column.nq for column in columns.values()])
    tree = [list(columns).index(joint.name) for joint in mechanism.joints]
    speeds = [columns[joint.name].index_v for joint in mechanism.joints]
    judge = inverse(mechanism, single[:, tree], states.v[:, speeds], states.a[:, speeds])
    names = [joint.name for joint in (*mechanism.joints, *mechanism.loops)]
    joints = [names.index(site) for site in result.site_names]
    sites = [mechanism.geometry.sites.tolist().index(joint) for joint in joints]
    pairs = [
        (result.effort_lower, judge.effort_lower),
        (result.effort_upper, judge.effort_upper),
        (result.normal_load, judge.normal_load[:, sites]),
        (result.friction_lower, judge.friction_lower[:, sites]),
        (result.friction_upper, judge.friction_upper[:, sites]),
    ]
    if mechanism.loops:
        assert result.wrench is not None  # where loops close, something always looks at them
        pairs.append((result.wrench, judge.wrench[:, joints]))
    else:
        pairs.append((joint_wrenches(scene, states.q, states.v, states.a), judge.wrench))
    plain = ~result.reversal.any(axis=1)
    return float(max(np.abs(ours - theirs)[plain].max() for ours, theirs in pairs))


def closed_loop_difference() -> float:
    """Return the same (N m, N) of the slider-crank along its bundled motion, moving and at rest."""
    scene = load_scene(CLOSED_LOOP)
    motion = load_trajectory(f"{CLOSED_LOOP}.waypoints.yaml", scene)
    q, v, a = (values[::LOOP_STRIDE] for values in (motion.q, motion.v, motion.a))
    return formulation_difference(inverse_dynamics(scene, q, v, a), slider_crank())


@described
class LiteralReading:
    """What the data give as they are printed.

    Attributes:
        example: which.
        stops_at: when neither stick nor slip is consistent any more (s); None if it never happens.
    """

    example: Example
    stick: tuple[float, float] = quantity(
        "the first stick; the end is where the simulation stops, if it does in it", "s"
    )
    stops_at: float | None

    @property
    @derived()
    def name(self) -> str:
        """The example's name."""
        return self.example.name

    @property
    @derived("s")
    def printed(self) -> tuple[float, float]:
        """When the paper says that it sticks."""
        return self.example.printed

    @property
    @derived("s")
    def no_consistent_acceleration_at(self) -> float | None:
        """When neither stick nor slip is consistent any more; none: never."""
        return self.stops_at


@described
class LiteralExamples:
    """Both examples with their data as printed."""

    examples: tuple[LiteralReading, ...] = quantity("as simulated")

    @property
    @derived()
    def reading(self) -> str:
        """How the printed data are read."""
        return "literal"


def read_literally(example: Example) -> LiteralReading:
    """Simulate one example with its data as printed, by the absolute formulation.

    With static below kinetic friction a joint that breaks away would slide against more than held
    it: at the end of the first stick no motion is consistent.
    """
    judged = example.judge(reading="literal")
    arguments = judged.mechanism, judged.position, judged.rate, judged.effort
    stops_at: float | None = None
    try:
        motion = simulate(*arguments, judged.t_end)
    except NoConsistentFriction as stop:
        if stop.time is None:
            raise
        stops_at = stop.time
        motion = simulate(*arguments, stop.time - 1e-6)
    start, end = motion.stick_intervals(example.site)[0]
    in_it = stops_at is not None and stops_at - end < 1e-3
    return LiteralReading(example, (start, stops_at if in_it and stops_at else end), stops_at)
