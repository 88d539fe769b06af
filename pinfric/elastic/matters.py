"""Whether elasticity matters along a motion."""

from __future__ import annotations

import numpy as np

from pinfric.dynamics.inverse.result import InverseResult
from pinfric.elastic.motion import elasticity, rotor_inertia, unloaded_frequency
from pinfric.model.described import described, quantity
from pinfric.motions.summary import ends_by_magnitude, known_rms

#: The part of a motion's accelerations below its bandwidth.
_INSIDE = 0.95
#: Equal steps of a motion whose spectrum is taken: of longer ones long rests count in part.
_MOST_STEPS = 2**20


@described
class ElasticEffect:
    """Effects of elastic gears, in the figures that show whether they matter."""

    frequency: float = quantity(
        "lowest natural frequency over the motion, motors held; without a motion at the scene's "
        "start, unloaded",
        "Hz",
    )
    bandwidth: float | None = quantity(
        "frequency below which 95 % of the energy of the accelerations lies; none without times",
        "Hz",
        default=None,
    )
    motor_share: float | None = quantity(
        "RMS of I f(t)'', the torque that winds the gears up, divided by the RMS of the motor's "
        "torque, of the drive where it is largest; none without times",
        default=None,
    )
    drive: str = quantity("that drive", default="")
    corrected: tuple[str, ...] = quantity(
        "drives with the encoder at the joint, whose wind-up the controller corrects", default=()
    )
    sag: float | None = quantity("largest sag of the tool at rest", "m", default=None)
    interval: float | None = quantity(
        "largest half-width of the tool's positions at rest; none: no tool or no rest",
        "m",
        default=None,
    )


def elastic_effect(result: InverseResult) -> ElasticEffect | None:
    """Return the effects along a motion; None without elastic gears.

    Args:
        result: of inverse dynamics; without times only the frequency is known.
    """
    scene = result.scene
    if not scene.elastic:
        return None
    drives = [scene.drives[d] for d in scene.elastic]
    corrected = tuple(drive.name for drive in drives if drive.encoder == "joint")
    if result.t is None or len(result.t) < 3:
        return ElasticEffect(unloaded_frequency(scene), corrected=corrected)
    motion_effects = elasticity(result)
    tools = [rest.tool for rest in motion_effects.rests if rest.tool is not None]
    share, drive = _motor_share(result)
    return ElasticEffect(
        frequency=float(motion_effects.frequency[motion_effects.slowest]),
        bandwidth=bandwidth(result.t, result.states.a),
        motor_share=share,
        drive=drive,
        corrected=corrected,
        sag=max((tool.sag_distance for tool in tools), default=None),
        interval=max((tool.farthest for tool in tools), default=None),
    )


def bandwidth(t: np.ndarray, a: np.ndarray) -> float:
    """Return the frequency, Hz, below which 95 % of the energy of accelerations lies; 0 without
    motion.

    At equal steps as long as the shortest; the last one may be shorter.

    Args:
        t: (T,) s, of any steps, 3 or more.
        a: (T, nv), each column is divided by its RMS.
    """
    steps = np.diff(t)
    step = steps[:-1].min()
    if t[-1] - t[0] > _MOST_STEPS * step:  # at rest nothing moves: shorter, it says the same
        t = np.append(0.0, np.cumsum(np.minimum(steps, step * max(_MOST_STEPS // len(t), 1))))
    count = int(np.ceil((t[-1] - t[0]) / step - 1e-6)) + 1
    even = np.linspace(t[0], t[-1], count)
    columns = np.column_stack([np.interp(even, t, column) for column in a.T])
    size = np.sqrt((columns**2).mean(axis=0))
    moving = columns[:, size > 0.0] / size[size > 0.0]
    if not moving.size:
        return 0.0
    energy = (np.abs(np.fft.rfft(moving, axis=0)) ** 2).sum(axis=1).cumsum()
    at = np.fft.rfftfreq(len(even), even[1] - even[0])
    return float(at[np.searchsorted(energy, _INSIDE * energy[-1])])


def _motor_share(result: InverseResult) -> tuple[float, str]:
    """RMS of r J f(t)'' over that of the motor's torque, of the drive where it is largest.

    t is the effort without friction, whose jumps no motor follows.
    """
    scene, t = result.scene, result.times
    worst, _ = ends_by_magnitude(result.motor_torque_lower, result.motor_torque_upper)
    needed = np.zeros((len(t), len(scene.elastic)))
    for start, stop, _ in result.states.phases(scene):
        if stop - start < 3:
            continue
        for k, d in enumerate(scene.elastic):
            drive, span = scene.drives[d], slice(start, stop)
            assert drive.spring is not None  # scene.elastic
            torque = result.effort_frictionless[span, d]
            rate = np.gradient(np.gradient(torque, t[span]), t[span])
            twisting = rate / drive.spring.tangent(torque)
            needed[span, k] = rotor_inertia(scene, d) * twisting / abs(drive.ratio)
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = known_rms(t, needed) / known_rms(t, worst[:, list(scene.elastic)])
    shares = np.nan_to_num(shares, nan=0.0)
    top = int(np.argmax(shares))
    return float(shares[top]), scene.drives[scene.elastic[top]].name
