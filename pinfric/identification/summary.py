"""Summary of an identification, as `pinfric identify` prints and writes it."""

from __future__ import annotations

from collections.abc import Mapping

from pinfric.identification.advice import Advice
from pinfric.identification.findings import Findings, HeldOut
from pinfric.identification.laws import PLAIN
from pinfric.identification.motor_constant import EffortFactor
from pinfric.identification.parameters import Parameter
from pinfric.identification.rest import RestBound
from pinfric.model.described import EFFORT, PLACE, described, gathered, quantity


@described
class FittedLog:
    """One log that was fitted."""

    name: str = quantity("the log's", heading="log")
    samples: int = quantity("samples that were used", heading="samples")
    duration: float = quantity("duration of the motion", "s", "duration")
    noise: Mapping[str, float] = quantity("joint -> noise of its positions", PLACE)
    cutoff: Mapping[str, float | None] = quantity("joint -> low pass; none: not filtered", "Hz")
    dropped: int = quantity("rows left out", heading="left out")


@described
class JointFriction:
    """The friction that was found of one joint."""

    name: str = quantity("the joint", heading="joint", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    law: str | None = quantity("in words; none: the model does not explain it", heading="law")
    error: HeldOut = quantity("error on held-out data", heading="*")
    rest: RestBound = quantity("bounds from the time at rest", heading="*")
    spread_between_logs: float = quantity(
        "relative difference of friction between logs; NaN with one log",
        heading="between\nlogs",
        cell="{spread_between_logs:percent}",
    )
    held_out: Mapping[str, float] = quantity(
        "law -> error of every candidate, as the choice among them saw it", EFFORT
    )


@described
class Predicted:
    """Error of a joint's predicted effort in a log that was held out as a whole."""

    log: str = quantity("its name", heading="log held out")
    joint: str = quantity("its name", heading="joint", name=True)
    unit: str = quantity('of its efforts, "N m" or "N"', heading="unit")
    error: HeldOut = quantity("error on that log", heading="*")


@described
class Considered:
    """A law of friction that was considered for a joint."""

    law: str = quantity("in words", heading="law")
    coefficients: int = quantity("number of coefficients", heading="coefficients")
    unit: str = quantity('of the joint\'s efforts, "N m" or "N"', heading="unit")
    error: float = quantity(
        "RMS of measured less predicted in fitted rows, in blocks held out of the fit that chose",
        EFFORT,
        "error in\nthe choice",
    )
    of_plain: float = quantity(
        "the error / the error with Coulomb and viscous friction",
        heading="times that\nof Coulomb\n+ viscous",
        cell="{of_plain:.2f}",
    )


@described
class LogNoise:
    """How one joint's positions in a log were read."""

    log: str = quantity("its name", heading="log")
    rate: float = quantity("sampling rate", "Hz", "rate")
    joint: str = quantity("its name", heading="joint", name=True)
    noise: float = quantity("noise of its positions", PLACE, "noise", "{noise:decade}")
    cutoff: float | None = quantity("low pass; none: not filtered", "Hz", "cutoff")


@described
class MoreKnown:
    """Standard error of one coefficient with further recordings."""

    key: str = quantity("key of the coefficient", heading="coefficient")
    factors: Mapping[str, float] = quantity(
        "recording -> standard error with it / present standard error", heading="{}", cell=":.2f"
    )


@described
class IdentifySummary:
    """Friction of a robot identified from logs."""

    logs: tuple[FittedLog, ...] = quantity("logs that were fitted")
    delay: float = quantity(
        "delay of the logged efforts; a guess, or 0, where its standard error exceeds 2.5 ms", "s"
    )
    delay_standard_error: float = quantity("standard error of the delay", "s")
    joints: tuple[JointFriction, ...] = quantity("in the order of the model")
    parameters: tuple[Parameter, ...] = quantity("every coefficient, by its key in the scene")
    effort_factors: tuple[EffortFactor, ...] = quantity(
        "factors on efforts, where some logs carry a known payload and others do not"
    )
    unseen: Mapping[str, Mapping[str, HeldOut]] = quantity(
        "log -> joint -> error on logs that were held out as a whole"
    )
    inertias: str = quantity('link inertias: "kept" from the URDF, or "corrected"')
    advice: tuple[Advice, ...] = quantity("recordings of 30 s, the most informative one first")
    doubts: tuple[str, ...] = quantity("what contradicts the result")
    given: tuple[str, ...] = quantity("what the result rests on and efforts hardly check")
    notes: tuple[str, ...] = quantity(
        "doubts, what is given, repairs of the logs, and what the logs do not determine"
    )


def identify_summary(findings: Findings) -> IdentifySummary:
    """Return the summary of an identification."""
    names = findings.scene.joint_names
    considered = dict(zip(names, findings.estimate.choice.errors, strict=True))
    units = dict(
        zip(names, (findings.scene.drives[j].unit for j in range(len(names))), strict=True)
    )
    return gathered(
        IdentifySummary,
        findings,
        logs=tuple(
            FittedLog(
                recording.name,
                recording.trajectory.t.size,
                recording.trajectory.duration,
                recording.reading.noise,
                recording.reading.cutoff,
                recording.reading.dropped,
            )
            for recording in findings.recordings
        ),
        delay_standard_error=findings.estimate.delay.standard_error,
        joints=tuple(
            JointFriction(
                name=name,
                unit=units[name],
                law=str(findings.laws[name]) if name in findings.laws else None,
                error=error,
                rest=findings.rest[name],
                spread_between_logs=findings.spread[name],
                held_out={str(law): x for law, x in considered[name].items()},
            )
            for name, error in findings.errors.items()
        ),
        inertias="kept" if findings.keeps_inertias else "corrected",
    )


def predicted(summary: IdentifySummary) -> list[Predicted]:
    """Return the errors of the logs that were only predicted, by row."""
    units = {joint.name: joint.unit for joint in summary.joints}
    return [
        Predicted(log, name, units.get(name, ""), error)
        for log, joints in summary.unseen.items()
        for name, error in joints.items()
    ]


def considered(findings: Findings, joint: int) -> list[Considered]:
    """Return the laws considered for a joint, the best first."""
    errors, unit = findings.estimate.choice.errors[joint], findings.scene.drives[joint].unit
    plain = errors.get(PLAIN, float("nan"))
    return [
        Considered(str(law), len(law.slots), unit, error, error / plain)
        for law, error in sorted(errors.items(), key=lambda entry: entry[1])
    ]


def log_noise(findings: Findings) -> list[LogNoise]:
    """Return how each joint's positions were read, log by log."""
    return [
        LogNoise(log.name, 1.0 / log.step, joint, noise, log.reading.cutoff[joint])
        for log in findings.recordings
        for joint, noise in log.reading.noise.items()
    ]


def more_known(findings: Findings, most: int) -> list[MoreKnown]:
    """Return the effect of further recordings on the `most` least known coefficients."""

    def vagueness(parameter: Parameter) -> float:
        return -parameter.standard_error / max(abs(parameter.value), 1e-300)

    known = findings.advice[0].factors if findings.advice else {}
    keys = [p.key for p in sorted(findings.parameters, key=vagueness) if p.key in known]
    return [
        MoreKnown(k, {advice.name: advice.factors[k] for advice in findings.advice})
        for k in keys[:most]
    ]
