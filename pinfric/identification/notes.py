"""Notes on an identification: how logs were read, what they do not determine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from pinfric.identification.checks import OTHER_GRAVITY, inertia_scales
from pinfric.identification.choice import free_errors
from pinfric.identification.columns import COARSE, FEWEST_ROWS, PASS, PRESLIDING, Rows
from pinfric.identification.delay import other_delays
from pinfric.identification.estimate import Estimate, rare_samples, scale_is_known
from pinfric.identification.findings import HeldOut
from pinfric.identification.geometry import (
    REACH,
    Gravity,
    Zero,
    gravity_by_efforts,
    zeros_by_efforts,
)
from pinfric.identification.laws import BACKWARD, FORWARD, INERTIA, K
from pinfric.identification.misfit import Misfit
from pinfric.identification.motor_constant import EffortFactor
from pinfric.identification.normal import residuals
from pinfric.identification.parameters import Parameter
from pinfric.identification.recordings import stick_velocity
from pinfric.identification.rest import BreakAway, RestBound
from pinfric.identification.scales import (
    MOVED,
    EffortScale,
    doubted,
    effort_scales,
    moved_masses,
    noted,
)
from pinfric.model.arrays import FloatArray
from pinfric.motions.log.effort_place import place_note

#: Below this share of its velocity limit a joint has not been fast.
_FAST = 0.2
#: A fit that leaves a larger share of an effort lacks something.
_MISSED = 0.1
#: Times the fitted rows' error from which that of all moving rows is a doubt: 1.0 to 1.2 where the
#: laws hold, 4 to 10 where friction builds up over 2 to 8 mrad.
_BESIDE_REVERSALS = 2.0
#: Share of the effort in moving rows below which their error says nothing: without noise any is
#: many times another.
_BARELY = 0.01
#: A motor's friction is a larger share of its effort than this.
_LEAST_FRICTION = 0.01
#: Share of the time at rest in which an effort should be within the interval.
_HELD_INSIDE = 0.985
#: Holds outside it from which that is said: a long hold in one posture is one sample.
_HOLDS = 3
#: Share of a residual's square up to which a shape is no doubt: one of 120 is found by chance.
_SLIGHT = 0.05
#: Share by which time stamps may be wrong without a doubt, by kept links.
_OFF = 0.05
#: Share of a residual's square from which a shape is so large that it looks like other errors.
_LARGE = 0.3
#: rad or m within which an angle that passed the filter is the same.
_SAME = 1e-9
#: What is said of joints that never move by their angles, but whose efforts change.
_FROZEN = (
    "its angle never changes, though its effort does: held still, or is its angle not read? The "
    "other joints' friction rests on it"
)
#: How much larger an error may be than that of least squares without a word.
_WORSE = 0.03


class Notes(NamedTuple):
    """What is said of an identification.

    Attributes:
        doubts: what contradicts it. given: what it rests on and efforts hardly check. others: the
            rest.
    """

    doubts: tuple[str, ...]
    given: tuple[str, ...]
    others: tuple[str, ...]


def notes(
    estimate: Estimate,
    rest: Mapping[str, RestBound],
    coefficients: Sequence[Parameter],
    static: Mapping[tuple[int, int], BreakAway],
    errors: Mapping[str, HeldOut],
    factors: Sequence[EffortFactor],
    shapes: Sequence[Misfit] = (),
    uneven: Mapping[int, float] = MappingProxyType({}),
) -> Notes:
    """Return a line for everything that was read, repaired or left out, or that logs do not show.

    Args:
        rest: joint -> what its holds show. static: see `parameters`.
        errors: joint -> error on held-out blocks, in fitted rows and in all that move.
        factors: on efforts, by a known payload. shapes: of residuals. uneven: see `Uncertainty`.
    """
    lines = [
        f"{recording.name}: {line}"
        for recording in estimate.question.recordings
        for line in recording.reading.notes
    ]
    if place := place_note(estimate.question.scene, estimate.question.at):
        lines.append(place)
    lines += _of_logs(estimate) + _of_ways(estimate)
    slid = [j for j, rows in enumerate(estimate.rows) if rows.effort.size]
    lines += _by_joint(
        _of_motion(estimate, slid)
        | _of_rest(estimate, slid, rest, static)
        | _of_laws(estimate, slid)
    )
    lines += _open_exponents(estimate)
    lines += _of_masses(estimate)
    stick = stick_velocity(estimate.question.scene, estimate.question.recordings)
    if stick > estimate.question.scene.stick_velocity:
        lines.append(
            f"the scene's `stick` velocity is {stick:.1e} rad/s or m/s: noise makes joints at rest "
            "appear to move up to this speed"
        )
    if estimate.distrusted:
        where = ", ".join(estimate.scene.joint_names[j] for j in estimate.distrusted)
        lines.append(
            f"too little data to choose the law of {where}: on blocks that were not used, the "
            "chosen laws predict worse than Coulomb and viscous friction, which is used there"
        )
    vague = [p.key for p in coefficients if not p.determined]
    if vague:
        lines.append(f"not determined: {', '.join(vague)}")
    lines.append(
        "an offset of an effort sensor appears as a difference between forward and backward "
        "Coulomb friction"
    )
    # What contradicts the model, and at which joints
    names = estimate.scene.joint_names
    fitted = [(j, estimate.rows[j], residuals(estimate.rows[j], estimate.fit, j)) for j in slid]
    contradicting = {
        "the error of all moving rows is far above that of the fitted ones, which leave out what "
        "is near reversals: friction builds up over a way after them (presliding), or gear play, "
        "or a filter, or too few samples a motion": [
            f"{name} {100 * error.moving_share:.0f} for {100 * error.share:.1f} %"
            for name, error in errors.items()
            if error.moving_error > _BESIDE_REVERSALS * error.error and error.moving_share > _BARELY
        ],
        "the model does not explain its effort (held-out error / error of the mean effort), so it "
        "keeps the scene's friction: check joint, sign, zero and unit of its columns of angle and "
        "effort, and of its neighbours'": [
            f"{names[j]} {100 * share:.0f} %" for j, share in estimate.unexplained.items()
        ],
        "the error is above 10 % even on the fitted data, so something is missing or wrong "
        "(signs, zeros, motors that move with another joint)": [
            f"{names[j]} {100 * np.sqrt(off @ off / (rows.effort @ rows.effort)):.0f} %"
            for j, rows, off in fitted
            if off @ off > _MISSED**2 * (rows.effort @ rows.effort)
        ],
        f"its effort holds no friction (below {100 * _LEAST_FRICTION:.0f} %), so it is a model's "
        "or measured behind the gear (--effort-at joint): log the motor's, or leave its friction "
        "out (--without)": [
            names[j]
            for j, rows, off in fitted
            if estimate.question.motor and _frictionless(rows, off, estimate.fit.slots[j])
        ],
        f"efforts at rest are within the interval for less than {100 * _HELD_INSIDE:g} % of the "
        "time, so static friction or the rigid effort is wrong": [
            f"{names[j]} {100 * rest[names[j]].inside:.1f} %"
            for j in slid
            if rest[names[j]].inside < _HELD_INSIDE and rest[names[j]].outside >= _HOLDS
        ],
    }
    clear, slight = ([x for x in shapes if (x.share > _SLIGHT) is named] for named in (True, False))
    lines += _misfits(estimate, slight)
    geometry = _geometry(estimate, _by_joint(contradicting), clear)
    lines += geometry.others
    doubts = (
        list(geometry.doubts)
        + _unbalanced(estimate)
        + _contacts(estimate)
        + _by_joint(contradicting)
        + _misfits(estimate, clear)
        + _uneven(estimate, uneven)
    )
    lines += _payload_factors([x for x in factors if not x.wrong])
    doubts += _payload_factors([x for x in factors if x.wrong])
    other_scales, small_scales = _scales(estimate, clear)
    doubts += _delays(estimate) + other_scales
    still = [name for j, name in enumerate(names) if j not in slid and _frozen(estimate, j)]
    given = [*_by_joint({_FROZEN: still}), *small_scales, *geometry.given]
    if estimate.question.no_gravity:
        doubts.append(
            "the efforts hold no gravity (their controller takes it off): friction was fitted with "
            "loads from the URDF's masses, and no inertias are written"
        )
    doubts += [] if estimate.question.inertias_stay else _by_joint(_of_links(estimate))
    return Notes(tuple(doubts), tuple(given), tuple(lines))


def _frictionless(rows: Rows, off: FloatArray, slots: FloatArray) -> bool:
    """Whether links and rotor alone make a joint's effort, but for residuals."""
    friction = rows.slots @ np.where(np.arange(K) == INERTIA, 0.0, slots)
    size = rows.effort @ rows.effort
    return bool(friction @ friction < _LEAST_FRICTION**2 * size and off @ off < _MISSED**2 * size)


def _frozen(estimate: Estimate, j: int) -> bool:
    """Whether a joint's angle never changes in any log, though its effort does."""
    logs = estimate.question.recordings
    efforts = np.concatenate([log.effort[:, j] for log in logs])
    efforts = efforts[np.isfinite(efforts)]
    return all(np.ptp(log.position[:, j]) < _SAME for log in logs) and bool(
        efforts.size and np.ptp(efforts) > 0.0
    )


def _by_joint(what: Mapping[str, list[str]]) -> list[str]:
    return [f"{text}: {', '.join(names)}" for text, names in what.items() if names]


def _misfits(estimate: Estimate, shapes: Sequence[Misfit]) -> list[str]:
    lines = []
    for j in sorted({shape.joint for shape in shapes}):
        unit = estimate.scene.drives[j].unit
        own = [
            f"{shape.over} {shape.size:.2g} {unit} RMS ({100 * shape.share:.0f} % of its square)"
            for shape in shapes
            if shape.joint == j
        ]
        lines.append(
            f"lack of fit: {estimate.scene.joint_names[j]}: the residual still depends on "
            f"{'; '.join(own)}; intervals are widened for that"
        )
    return lines


def _uneven(estimate: Estimate, halves: Mapping[int, float]) -> list[str]:
    """Joints whose friction differs by direction as with an offset of a sensor."""
    lines = []
    for j, half in halves.items():
        unit = estimate.scene.drives[j].unit
        lines.append(
            f"lack of fit: {estimate.scene.joint_names[j]}: Coulomb friction differs by "
            f"{2.0 * abs(half):.2g} {unit} between the directions; an offset of "
            f"{abs(half):.2g} {unit} in the effort sensor would explain it; intervals are "
            "widened to contain both"
        )
    return lines


def _open_exponents(estimate: Estimate) -> list[str]:
    """Joints whose logs admit several Stribeck exponents."""
    joints = zip(estimate.scene.joint_names, estimate.stribeck, estimate.choice.laws, strict=False)
    each = [
        f"{name} {', '.join(f'{n:g}' for n in sorted([stribeck.exponent, *others]))}"
        for name, stribeck, law in joints
        if stribeck is not None
        and law.stribeck_slots
        and (others := [other.exponent for other in stribeck.others])
    ]
    if not each:
        return []
    return [
        "these logs do not tell with which exponent friction falls from rest to motion; "
        f"intervals contain the coefficients of each: {'; '.join(each)}"
    ]


def _of_links(estimate: Estimate) -> dict[str, list[str]]:
    """What contradicts the links: free ones predict better, or masses have changed much."""
    names, (own, _) = estimate.scene.joint_names, estimate.errors
    free = free_errors(estimate.problem, estimate.rows)
    return {
        "held-out errors are larger than those of ordinary least squares (Coulomb and viscous "
        "friction, free link inertias), so the URDF's inertias are wrong there, or too little was "
        "logged to choose a law": [
            f"{names[j]} by {100 * (own[j] / free[j] - 1):.0f} %"
            for j in estimate.known
            if own[j] > (1.0 + _WORSE) * free[j]
        ],
        f"masses that differ from the URDF's by more than {100 * MOVED:.0f} %, which is unusual "
        "(check the zero and sign of the angles of these joints and their neighbours, the unit of "
        "efforts, and whether the scene lacks a payload)": [
            names[j] for j in moved_masses(estimate)
        ],
    }


def _of_logs(estimate: Estimate) -> list[str]:
    delay, lines = estimate.delay, []
    moving = [log.slides.any() for log in estimate.prepared]
    still = [
        log.recording.name
        for log, slides in zip(estimate.prepared, moving, strict=True)
        if not slides
    ]
    if still:
        lines.append(f"no joint slides in {', '.join(still)}: used for bounds on friction at rest")
    if sum(moving) == 1:
        lines.append(
            "one log only: how much friction changes from day to day is not known; "
            "between logs of one robot it changed by 1 to 10 %"
        )
    if delay.disputed and np.isfinite(delay.standard_error):
        least, most = (1e3 * end(x for x, _ in delay.joints.values()) for end in (min, max))
        lines.append(
            f"the delay of the efforts is not determined: joints ask for {least:.1f} to {most:.1f} "
            "ms, as presliding, play or filters make them; taken is the mean by what each knows, "
            f"{1e3 * delay.value:.1f} ms"
        )
    elif np.isfinite(delay.standard_error) and not delay.determined:
        lines.append(
            "the delay of the efforts is not determined (standard error "
            f"{1e3 * delay.standard_error:.1f} ms) and is taken as {1e3 * delay.value:.1f} ms: log "
            "faster motion"
        )
    built_up = zip(estimate.prepared, delay.builds_up, strict=True)
    if names := [log.recording.name for log, builds_up in built_up if builds_up]:
        lines.append(
            f"friction builds up after reversals (presliding) in {', '.join(names)}: the fit "
            f"leaves out the first {1e3 * PRESLIDING[-1]:.0f} mrad or mm after each"
        )
    if sum(moving) > 1 and not estimate.builds_up:
        logs = zip(estimate.prepared, delay.logs, strict=True)
        each = [
            f"{log.recording.name} {1e3 * value:.1f} +- {1e3 * error:.1f} ms"
            for log, (value, error) in logs
            if np.isfinite(error)
        ]
        lines.append(f"delay of the efforts from each log, with standard error: {', '.join(each)}")
    return lines


def _tilt(gravity: Gravity | None) -> list[str]:
    """That the base is mounted at another angle."""
    if gravity is None or not gravity.tilted:
        return []
    angle, error = np.degrees([gravity.angle, REACH * gravity.standard_error])
    vector = ", ".join(f"{g:.2f}" for g in gravity.vector)
    return [
        f"the base is tilted by {angle:.1f} +- {error:.1f} degrees against the scene's gravity, by "
        f"all efforts together: mount it level, or write `robot: {{gravity: [{vector}]}}` (m/s^2 "
        "in the base's frame)"
    ]


def _time(low: float, high: float, by: str, wrong: bool) -> Notes:
    """What efforts tell of the time stamps.

    `low`, `high`: 95 % interval of stamped time over true time.
    """
    reach = f"[{low:.3g}, {high:.3g}]" if np.isfinite(high) else f"{low:.3g} or more"
    told = f"stamped time over true time is {reach} {by}; viscous friction is proportional to it"
    if wrong:
        told += ": is the unit or rate of the time stamps wrong, or are masses?"
        return Notes((told,), (), ())
    if low < 1.0 - _OFF or high > 1.0 + _OFF:
        return Notes((), (f"time stamps are taken as given: {told}",), ())
    return Notes((), (), (told,))


def _zeros(zeros: Sequence[Zero], names: Sequence[str], fits: bool) -> Notes:
    """What efforts tell of the zeros of angles, with the links free.

    `fits`: whether any is doubted.
    """

    def said(own: Sequence[Zero]) -> str:
        return ", ".join(
            f"{names[x.joint]} {x.value:.2f} +- {REACH * x.standard_error:.2f}" for x in own
        )

    off = [x for x in zeros if fits and x.off]
    open_ = [x for x in zeros if fits and not (x.off or x.known)]
    other = [x for x in zeros if x not in off and x not in open_]
    doubt = (
        f"the logged angle is larger than the true one by so many rad: {said(off)}; `offset` in a "
        "file given by --columns moves its zero"
    )
    told = "by efforts, with free masses, angles are too large by so many rad"
    given = f"zeros of angles are taken as given: {told}: {said(open_)}"
    rest = f"{told}: {said(other)}"
    return Notes((doubt,) * bool(off), (given,) * bool(open_), (rest,) * bool(other))


def _unbalanced(estimate: Estimate) -> list[str]:
    """Logs whose forces at the feet do not balance the base."""
    logs = [log for log in estimate.question.recordings if log.left_at_base]
    return [
        f"{log.name}: the forces at the feet do not balance the motion: they leave "
        f"{100 * log.left_at_base:.3g} % of the weight at the base; is one in another unit, or was "
        "a contact not logged?"
        for log in logs
    ]


def _contacts(estimate: Estimate) -> list[str]:
    """When the robot was touched."""
    scene, logs = estimate.scene, estimate.question.recordings
    each = [
        f"{logs[x.log].name} {x.start:.1f} to {x.end:.1f} s (up to {x.effort:.3g} "
        f"{scene.drives[x.joint].unit} at {scene.joint_names[x.joint]})"
        for x in estimate.question.contacts
    ]
    if not each:
        return []
    return [f"efforts are far from all others, as of a contact, and left out: {', '.join(each)}"]


def _scales(estimate: Estimate, shapes: Sequence[Misfit]) -> tuple[list[str], list[str]]:
    """That one joint's effort has another scale than the others': doubts, and what is given.

    A joint whose residual a shape explains better has none: what it lacks may look like a scale.
    """
    confirmed, names = estimate.question.gains, estimate.scene.joint_names
    lacks = {x.joint: x.share for x in sorted(shapes, key=lambda shape: shape.share)}
    asked = [
        scale
        for scale in effort_scales(estimate)
        if names[scale.joint] not in confirmed and scale.gain > lacks.get(scale.joint, 0.0)
    ]

    def said(scales: Sequence[EffortScale], or_: str) -> str:
        return or_.join(
            f"that of {names[x.joint]} {x.value:.2f} +- {1.96 * x.standard_error:.2f} times"
            for x in scales
        )

    motor = estimate.question.motor
    wrong, small = doubted(asked, motor), noted(asked, motor)
    first = names[wrong[0].joint] if wrong else ""
    doubts = [
        f"the efforts do not fit one robot: {said(wrong, ', or ')} what the other joints' efforts "
        "ask for, whatever the links' masses: its unit, gear ratio or motor constant? Give the "
        f"factor to N m by --gain {first}=FACTOR ({first}=1 if it is in N m)"
    ]
    lines = [
        f"an effort's scale: {said(small, ', ')} what the other joints' efforts ask for, whatever "
        "the links' masses: losses of gears that differ between driving and driven, or its unit or "
        "motor constant"
    ]
    return doubts * bool(wrong), lines * bool(small)


def _geometry(estimate: Estimate, others: Sequence[str], shapes: Sequence[Misfit]) -> Notes:
    """What efforts tell of gravity, time stamps and zeros.

    Beside a large misfit of friction neither stamps nor zeros are doubted: it looks like them. Nor
    are zeros beside `others`, doubts of the model.
    """
    fits = all(shape.share < _LARGE for shape in shapes)
    question, names = estimate.question, estimate.scene.joint_names
    gravity = gravity_by_efforts(estimate)
    told = [Notes(tuple(_tilt(gravity)), (), ())]
    if question.keep_inertias:
        arguments = estimate.prepared, estimate.rows, estimate.fit, estimate.problem.weights
        scales, whole = inertia_scales(question.scene, *arguments)
        own = _inertias({names[j]: scales[j] for j in estimate.known if j in scales})
        told.append(Notes(tuple(own), (), ()))
        if whole is not None:
            ends = (max(whole[0] + way * whole[1], 0.0) for way in (-1.0, 1.0))
            low, high = (float(np.sqrt(end)) for end in ends)
            wrong = fits and (low > 1.0 + _OFF or high < 1.0 - _OFF)
            told.append(_time(low, high, "by the inertia of the kept links", wrong))
    elif gravity is not None:
        told += [
            _time(*gravity.time(), "by gravity", fits and gravity.off_the_clock),
            _zeros(zeros_by_efforts(estimate), names, fits and not others),
        ]
    return Notes(*(tuple(chain.from_iterable(own)) for own in zip(*told, strict=True)))


def _inertias(scales: Mapping[str, tuple[float, float]]) -> list[str]:
    """Joints whose effort holds another inertia than that of the links that were kept.

    Of gravity `check_gravity` judges, before the fit.
    """
    each = [
        f"{name} {scale:.2g} +- {reach:.2g}"
        for name, (scale, reach) in scales.items()
        if abs(scale - 1.0) > OTHER_GRAVITY + reach
    ]
    if not each:
        return []
    return [
        "efforts hold so many times the inertia of the URDF's links, which --inertia keep holds "
        "fixed: are the time stamps, the effort's unit, the gear ratio or the motor constant "
        f"wrong: {', '.join(each)}"
    ]


def _payload_factors(factors: Sequence[EffortFactor]) -> list[str]:
    """What a known payload says of efforts' factors, with 95 % intervals."""
    each = [f"{x.name} {x.value:.3g} [{x.low:.3g}, {x.high:.3g}]" for x in factors]
    wrong = any(x.wrong for x in factors)
    line = "by the known payload, logged efforts are so many times the true ones"
    if wrong:
        line += f" (its unit, gear ratio or motor constant? --gain {factors[0].name}="
        line += f"{1.0 / factors[0].value:.3g} times the present gain)"
    return [f"{line}: {', '.join(each)}"] * bool(each)


def _of_ways(estimate: Estimate) -> list[str]:
    """Ways over which friction builds up, and those that the logs do not tell."""
    build, names = estimate.build, estimate.scene.joint_names
    if rare := rare_samples(estimate):
        each = ", ".join(f"{log.name} has {1.0 / log.step:.3g}" for log in rare)
        return [
            "a way over which friction builds up after reversals is not looked for below "
            f"{PASS / COARSE:g} samples a second: {each}"
        ]
    if build is None:
        return []
    found = [
        f"{names[j]} {way.value:.2g} ({100 * way.gain:.0f} % of the square)"
        for j, way in enumerate(build.ways)
        if way is not None
    ]
    shape = "gradually" if any(way and way.gradual for way in build.ways) else "evenly"
    lines = [
        f"friction builds up {shape} after reversals (presliding), over a way in rad or m; delay "
        f"and ways were found together: {', '.join(found)}"
    ]
    refused = [f"{names[j]} {why}" for j, why in build.refused.items()]
    return lines * bool(found) + [
        f"a way over which friction builds up is not determined: {'; '.join(refused)}"
    ] * bool(refused)


def _delays(estimate: Estimate) -> list[str]:
    """That the delay's search failed, or which explained joints differ."""
    names = estimate.scene.joint_names
    if np.isinf(estimate.delay.standard_error):
        return [
            "lack of fit: the delay of the efforts is not determined (its search ended at a "
            f"bound) and is taken as {1e3 * estimate.delay.value:.1f} ms: are they logged much "
            "later than the angles, or by another clock?"
        ]
    each = [
        f"{names[j]} {1e3 * value:.1f} +- {1e3 * error:.1f} ms"
        for j, (value, error) in other_delays(estimate.delay).items()
        if j in estimate.known
    ]
    if not each:
        return []
    return [
        f"lack of fit: the delays of {', '.join(each)} differ from that of the other joints: "
        "play, a filter, or friction that no law describes"
    ]


def _of_masses(estimate: Estimate) -> list[str]:
    if estimate.question.no_gravity:
        return []
    if estimate.question.keep_inertias:
        each = ", ".join(
            f"{estimate.scene.joint_names[j]} {scale:.3g} +- {reach:.2g}"
            for j, (scale, reach) in estimate.gravity.items()
        )
        asked = [f"gravity in the efforts over that of the URDF: {each}"] if each else []
        return ["the URDF's inertias were kept: their errors are in the friction", *asked]
    model, names = estimate.question.scene.model, estimate.scene.joint_names
    bodies = zip(tuple(model.inertias)[1:], tuple(estimate.scene.model.inertias)[1:], strict=True)
    masses = [
        f"{name} {before.mass:.3g} -> {after.mass:.3g}"
        for name, (before, after) in zip(names, bodies, strict=True)
    ]
    return [f"link behind each joint, kg in the URDF -> found: {', '.join(masses)}"]


def _of_motion(estimate: Estimate, slid: Sequence[int]) -> dict[str, list[str]]:
    question, names = estimate.question, estimate.scene.joint_names
    other = "the Coulomb friction of the other direction is used"

    def hardly(sign: float) -> list[str]:
        return [
            names[j] for j in slid if (sign * estimate.rows[j].velocity > 0.0).sum() < FEWEST_ROWS
        ]

    return {
        "left out by --without, keeps the scene's friction": [
            name for name in names if name in question.without
        ],
        "never slides, keeps the scene's friction": [
            name
            for j, name in enumerate(names)
            if j not in slid and name not in (*question.without, *question.base)
        ],
        f"hardly slides forward, {other}": hardly(1.0),
        f"hardly slides backward, {other}": hardly(-1.0),
    }


def _of_rest(
    estimate: Estimate,
    slid: Sequence[int],
    rest: Mapping[str, RestBound],
    static: Mapping[tuple[int, int], BreakAway],
) -> dict[str, list[str]]:
    names = estimate.scene.joint_names
    rests = [j for j in slid if rest[names[j]].seconds > 0.0]
    return {
        "never rests, no bound on its static friction": [
            names[j] for j in slid if rest[names[j]].seconds == 0.0
        ],
        "rests, but never broke away slowly enough (three times a direction): static friction is "
        "only bounded from below": [
            names[j] for j in rests if not {(j, FORWARD), (j, BACKWARD)} & static.keys()
        ],
    }


def _of_laws(estimate: Estimate, slid: Sequence[int]) -> dict[str, list[str]]:
    names, choice, question = estimate.scene.joint_names, estimate.choice, estimate.question
    laws = list(zip(names, choice.laws, strict=True))
    offers_gear = [any(law.load == "gear" for law in own) for own in choice.errors]
    scale = scale_is_known(estimate)
    limits = estimate.scene.model.velocityLimit
    fastest = {j: float(np.abs(estimate.rows[j].velocity).max()) for j in slid}
    return {
        "never fast, friction at higher speed is extrapolated (rad/s or m/s)": [
            f"{estimate.scene.joint_names[j]} {speed:.2g} of {limits[j]:.2g}"
            for j, speed in fastest.items()
            if speed < _FAST * limits[j] < 1e300
        ],
        "the load hardly changes, so a gear's loss cannot be separated from Coulomb friction": [
            names[j]
            for j in slid
            if question.motor and names[j] not in question.laws and not offers_gear[j]
        ],
        "a law on the joint's side was asked for, but friction of a coupled drive depends on its "
        "motor's speed: a law on the motor's side is used": [
            name for name, law in laws if question.laws.get(name, law).side != law.side
        ],
        "with free masses, only the product of a gear's two efficiencies (motor drives, load "
        "drives) is known (`efficiency_product`); each alone is as wrong as the URDF's masses; "
        "record a log with a known payload (--payload)": [
            name for name, law in laws if law.load == "gear" and not scale
        ],
    }
