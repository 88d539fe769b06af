"""From recordings to one estimate: delay, laws, inertias and coefficients, in passes.

Loads follow from inertias, and inertias from a fit that knows the loads: the first pass takes the
URDF's inertias and plain friction, each later one the results of the one before.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pinfric.errors import IdentificationError
from pinfric.identification.checks import (
    check_efforts,
    check_gravity,
    check_limits,
    gravity_scales,
    holds_no_gravity,
)
from pinfric.identification.choice import (
    MARGIN,
    Choice,
    Problem,
    choose,
    held_out_parts,
    nested_errors,
)
from pinfric.identification.columns import (
    Prepared,
    Rows,
    blocks,
    coarse,
    joint_rows,
    prepare,
    settled,
    thinning,
    with_loads,
)
from pinfric.identification.contacts import Contact, contacts, without_contacts
from pinfric.identification.delay import Delay, common_delay, log_delay
from pinfric.identification.inertias import consistent_fit, urdf_prior, with_parameters
from pinfric.identification.influence import influence
from pinfric.identification.laws import (
    BACKWARD,
    COULOMB,
    DIRECTIONS,
    FORWARD,
    GEARS,
    INERTIA,
    PLAIN,
    RESTS_ON,
    SPEEDS,
    STRIBECK,
    STRIBECK_BACKWARD,
    STRIBECK_FORWARD,
    STRIBECK_LOAD,
    K,
    Law,
    candidates,
)
from pinfric.identification.motor_constant import EffortFactor, effort_factors
from pinfric.identification.normal import (
    BlockProducts,
    Fit,
    FrictionNormalEquations,
    above_zero,
    weighted,
)
from pinfric.identification.recordings import STILL, Recording
from pinfric.identification.standing import base_joints
from pinfric.identification.stribeck import (
    StribeckFit,
    find_stribeck,
    stribeck_decay,
    with_stribeck,
)
from pinfric.identification.ways import FEWEST, Build, find_ways, reversals, with_ways
from pinfric.model.arrays import BoolArray, FloatArray
from pinfric.model.coordinates import is_sliding
from pinfric.model.couples import mixed
from pinfric.model.scene import Scene

#: Both losses of a gear show where the load drives and is driven in at least this share of the
#: rows. A gear loses at most this share of what passes it (an efficiency of two thirds).
_LEAST_SHARE, _MOST_LOSS = 0.15, 0.5
#: Standard errors from which a loss shows although friction is larger than the load, and the load's
#: least share of that friction: below, other friction that no law has looks like a loss.
_CLEARLY, _LEAST_BESIDE = 4.0, 0.3
#: Standard error below which a factor on an effort is told: then nobody is asked about it.
_TOLD = 0.1
#: Blocks in which something slides: those of the shortest log.
_FEWEST_BLOCKS = 4
#: A model that leaves a larger share of what a joint's mean effort alone leaves explains nothing:
#: with an angle's sign or zero wrong in mid-chain it was 0.8 to 1.6.
_UNEXPLAINED = 0.8


@dataclass(frozen=True)
class Question:
    """What an identification is asked: scene, logs and what is free.

    Attributes:
        scene: the robot; its bearings are candidates.
        at: what the logs' efforts are, one of `EFFORT_PLACES`; here they are stated at the joints.
        keep_inertias: whether the URDF's count as right.
        laws: joint -> its law, where it is not to be chosen.
        gains: joints whose effort's unit a person has stated.
        without: joints whose efforts were left out.
        no_gravity: whether the efforts hold no gravity: then loads on bearings and gears are the
            URDF's, and the fitted links no robot's.
        contacts: times in which the robot was touched, whose efforts were taken out.
        jumps: whether friction jumps at reversals, so that no ways are searched.
        floating: the scene as given, whose free base six joints of `scene` stand for (`standing`).
    """

    scene: Scene
    recordings: Sequence[Recording]
    at: str = "reflected"
    keep_inertias: bool = False
    laws: Mapping[str, Law] = field(default_factory=dict)
    gains: Collection[str] = ()
    without: Collection[str] = ()
    no_gravity: bool = False
    contacts: tuple[Contact, ...] = ()
    jumps: bool = False
    floating: Scene | None = None

    @property
    def base(self) -> tuple[str, ...]:
        """The joints of `scene` in the place of the free base."""
        return () if self.floating is None else base_joints(self.floating)

    @property
    def inertias_stay(self) -> bool:
        """Whether the scene found has the URDF's inertias."""
        return self.keep_inertias or self.no_gravity

    @property
    def motor(self) -> bool:
        """Whether gear and rotor are in the effort."""
        return self.at != "joint"


@dataclass(frozen=True, eq=False)
class Estimate:
    """What is known after a step, and in the end what was found.

    Attributes:
        scene: the question's, with the fitted inertias of links.
        prepared: the columns of each log, loads by these inertias.
        choice: laws and held-out errors.
        rows: of each joint. row_weights: (n,) of these, below 1 for outliers.
        problem: the summed products, with the weights that were used.
        fit: with physically possible links.
        stribeck: of each joint's friction; None: it has none.
        errors: (nj,) of the chosen laws and of plain friction, on blocks used neither for the
            choice nor for the fit, N m or N.
        distrusted: joints whose chosen laws were worse there than plain friction, now taken.
        gravity: see `gravity_scales`.
        build: ways over which friction builds up; None: nothing asks for one.
    """

    question: Question
    scene: Scene
    prepared: tuple[Prepared, ...]
    choice: Choice
    rows: tuple[Rows, ...]
    row_weights: tuple[FloatArray, ...]
    problem: Problem
    fit: Fit
    delay: Delay = field(default_factory=lambda: Delay(0.0, np.inf, ()))
    stribeck: tuple[StribeckFit | None, ...] = ()
    errors: tuple[FloatArray, FloatArray] = (np.zeros(0), np.zeros(0))
    distrusted: tuple[int, ...] = ()
    gravity: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    build: Build | None = None

    @property
    def builds_up(self) -> bool:
        """Whether the friction of any joint builds up over a way."""
        return self.build is not None and any(self.build.ways)

    @cached_property
    def unexplained(self) -> dict[int, float]:
        """Joint -> held-out error / standard deviation of its effort, above `_UNEXPLAINED`."""
        best = np.minimum(*self.errors)
        spread = [float(np.std(own.effort)) if own.effort.size else np.inf for own in self.rows]
        return {j: x for j, x in enumerate((best / spread).tolist()) if x > _UNEXPLAINED}

    @cached_property
    def known(self) -> tuple[int, ...]:
        """The joints that slid and that the model explains."""
        return tuple(
            j for j, own in enumerate(self.rows) if own.effort.size and j not in self.unexplained
        )

    def effort_factors(self) -> tuple[EffortFactor, ...]:
        """Return the factors on joints' efforts that a known payload shows."""
        weights = [w * own for w, own in zip(self.problem.weights, self.row_weights, strict=True)]
        return effort_factors(self.question.scene, self.prepared, self.rows, weights)


def estimate(question: Question, progress: Callable[[int, int], object]) -> Estimate:
    """Return delay, laws, inertias and coefficients; `progress`: see `identify`.

    Raises:
        IdentificationError: next to nothing slides; an effort with a wrong sign or unit; no joint
            is explained.
    """
    scene, steps = question.scene, len(question.recordings) + 3
    prepared, thin = [], thinning(question.recordings)
    for recording in question.recordings:
        prepared.append(prepare(scene, recording, thin, question.no_gravity))
        progress(len(prepared), steps)
    held = [  # blocks are the samples of all that follows
        np.unique(blocks(log.recording.trajectory.t)[1][log.kept[log.slides.any(axis=1)]])
        for log in prepared
    ]
    logs = ", ".join(log.name for log in question.recordings)
    if (count := sum(own.size for own in held)) < _FEWEST_BLOCKS:
        raise IdentificationError(
            f"{logs}: joints slide (faster than {STILL:g} rad/s or m/s and than the noise) in "
            f"{count} blocks of 1 to 5 s; at least {_FEWEST_BLOCKS} are needed: log more "
            "motion"
        )
    for number, log in enumerate(prepared):  # by the URDF's inertias
        prepared[number] = with_loads(log, scene, np.zeros_like(log.payload))
    plain = ((PLAIN,),) * scene.model.nv
    result = _first(question, tuple(prepared))
    del prepared, log  # a long log's columns fill much of the memory
    # of these a person has stated the unit, or a known payload tells it in the end
    told = {*question.gains, *_told(result)}
    if not question.no_gravity:
        result = replace(result, gravity=gravity_scales(scene, result.prepared, result.rows))
        if holds_no_gravity(result.gravity):
            del result
            ahead = after(progress, len(question.recordings))
            return estimate(replace(question, no_gravity=True), ahead)
        if question.keep_inertias:
            check_gravity(scene, result.gravity, logs, told)
    check_efforts(scene, result.rows, logs, told)
    check_limits(scene, result.rows, result.fit, logs, told)
    if not question.jumps:
        result = _with_ways(result)
    if not result.builds_up:
        slots = result.problem.slots(result.choice.laws)
        result = _lean(result)
        result = _with_delay(result, slots)
    total = 2 * steps if result.builds_up else steps  # `identify` then fits without ways, too
    result = _fitted(result, plain)
    for number in range(4):
        if number >= 2 and not any(law.stribeck_slots for law in result.choice.laws):
            break  # only the speeds at which friction falls take longer
        progress(steps - max(2 - number, 1), total)
        fits = list[StribeckFit | None]()
        for j, law in enumerate(result.choice.laws):
            beside = sorted({INERTIA, *law.slots} - set(RESTS_ON))
            arguments = result.prepared, j, result.rows[j], result.row_weights[j], beside
            parts = _stribeck_choices(result, j)
            fits.append(find_stribeck(*arguments, parts) if parts else None)
        result = replace(result, stribeck=tuple(fits))
        laws = [offered(result, j) for j in range(len(result.rows))]
        slots = result.problem.slots(result.choice.laws)
        result = _lean(result)
        result = _reloaded(result)
        result = _with_delay(result, slots)
        result = _fitted(result, laws)
    if lossy := _beyond_a_gear(result):
        offers = enumerate(result.problem.laws)
        laws = [tuple(x for x in own if j not in lossy or x.load != "gear") for j, own in offers]
        result = _fitted(result, laws)
    touched = () if question.contacts else contacts(result.prepared, result.rows, result.fit)
    if touched:  # all again: laws and delay were found beside it
        del result
        lacks = without_contacts(question.recordings, touched)
        ahead = after(progress, steps - 1)
        return estimate(replace(question, recordings=lacks, contacts=touched), ahead)
    result = _doubted(replace(result, errors=nested_errors(result.problem, result.rows)))
    progress(steps, total)
    if not result.known:
        raise IdentificationError(
            f"{question.scene.source}: the model explains no joint's effort better than its mean "
            "does: check signs, zeros and units of angles and efforts, and the joint of each column"
        )
    return result


def _told(estimate: Estimate) -> list[str]:
    """Return the joints whose effort's factor a known payload tells well."""
    return [x.name for x in estimate.effort_factors() if x.standard_error < _TOLD]


def after(progress: Callable[[int, int], object], done: int) -> Callable[[int, int], object]:
    """Return `progress` of what begins again: its steps come on top of those that are done."""
    return lambda more, total: progress(done + more, done + total)


def _unjudged(laws: tuple[Law, ...]) -> Choice:
    return Choice(laws, ({},) * len(laws), ((),) * len(laws))


def _doubted(estimate: Estimate) -> Estimate:
    """Take plain friction where choosing laws made unseen blocks worse.

    If all joints together are worse: at those that are worse themselves, then at all.
    """
    if (worse := _worse(estimate)).any():
        estimate = _plain(estimate, worse)
        if _worse(estimate).any():
            estimate = _plain(estimate, np.ones_like(worse))
    return estimate


def _worse(estimate: Estimate) -> BoolArray:
    """(nj,) whether the chosen laws err more than plain friction, if all joints together do."""
    rows = np.array([own.effort.size for own in estimate.rows])
    chosen, plain = (estimate.problem.weights * rows * error**2 for error in estimate.errors)
    most = (1.0 + MARGIN) ** 2
    return np.asarray((chosen > most * plain) & (chosen.sum() > most * plain.sum()))


def _plain(estimate: Estimate, where: BoolArray) -> Estimate:
    """Fit again, with plain friction (or the stated law) at some joints (nj,)."""
    stated, errors = estimate.question.laws, estimate.choice.errors
    names, offers = estimate.scene.joint_names, estimate.problem.laws
    laws = [
        (stated.get(name, PLAIN),) if plain else own
        for name, plain, own in zip(names, where.tolist(), offers, strict=True)
    ]
    now = zip(where.tolist(), laws, estimate.choice.laws, strict=True)
    choice = _unjudged(tuple(own[0] if plain else law for plain, own, law in now))
    found = _fitted(replace(estimate, choice=choice), laws)
    return replace(
        found,
        errors=nested_errors(found.problem, found.rows),
        choice=replace(found.choice, errors=errors),
        distrusted=tuple(np.flatnonzero(where).tolist()),
    )


def _with_ways(estimate: Estimate) -> Estimate:
    """Find the ways over which friction builds up, and with them the delay, by plain friction."""
    scene = estimate.question.scene
    if rare_samples(estimate):
        return estimate  # signs would draw the delay
    strokes = [
        sum(reversals(log, j).size + 1 for log in estimate.prepared if log.slides[:, j].any())
        for j in range(scene.model.nv)
    ]
    offered = np.array(strokes) >= FEWEST
    build = None
    if offered.any():
        build = find_ways(estimate.prepared, urdf_prior(scene.model, kept=False), offered)
    few = {
        j: f"reverses {count} time{'s' * (count != 1)}, and {FEWEST} are needed"
        for j, count in enumerate(strokes)
        if 0 < count < FEWEST
    }
    if few:
        build = build or Build((None,) * scene.model.nv, 0.0, np.inf, {})
        build = build._replace(refused=build.refused | few)
    found = replace(estimate, build=build)
    if build is None or not found.builds_up:
        return found
    logs = ((build.delay, build.error),) * len(found.prepared)
    return _reloaded(
        replace(
            found,
            prepared=tuple(with_ways(log, build.ways) for log in found.prepared),
            delay=Delay(build.delay, build.error, logs, {}, (False,) * len(logs)),
        )
    )


def rare_samples(estimate: Estimate) -> list[Recording]:
    """Return the logs with so few samples a second that no ways are looked for in any."""
    recordings = [log.recording for log in estimate.prepared]
    return [recording for recording in recordings if coarse(recording.step)]


def _lean(estimate: Estimate) -> Estimate:
    """Leave out what the next fit computes again: it takes much memory."""
    problem = replace(estimate.problem, grams=())
    return replace(estimate, rows=(), row_weights=(), problem=problem)


def _reloaded(estimate: Estimate) -> Estimate:
    """Renew the loads of all logs by the estimate."""
    return replace(estimate, prepared=tuple(reloaded(estimate, log) for log in estimate.prepared))


def _with_delay(estimate: Estimate, slots: Sequence[Sequence[int]]) -> Estimate:
    """Find by how much efforts lag, by the slots of the present laws.

    Where friction builds up, the delay was found with the ways; joints may still differ from it.
    """
    # free, even where links are kept: the weight that a URDF lacks shall not look like a delay
    prior = urdf_prior(estimate.question.scene.model, kept=False)
    logs = [replace(log, slides=log.slides | log.turns) for log in estimate.prepared]
    delays = [log_delay(log, slots, prior, estimate.delay.value) for log in logs]
    if estimate.builds_up:
        delay = replace(estimate.delay, joints=common_delay(delays).joints)
        return replace(estimate, delay=delay)
    prepared = tuple(
        settled(log) if own.builds_up else log for log, own in zip(logs, delays, strict=True)
    )
    return replace(estimate, delay=common_delay(delays), prepared=prepared)


def _first(question: Question, prepared: tuple[Prepared, ...]) -> Estimate:
    """Return the estimate with plain friction, all rows with the same weight at first."""
    nj = question.scene.model.nv
    prior = urdf_prior(question.scene.model, question.keep_inertias)
    laws, nothing = ((PLAIN,),) * nj, Fit(np.zeros(0), np.zeros((nj, K)))
    start = Problem((), np.ones(nj), prior, laws, np.zeros(0, int), question.motor)
    choice = _unjudged((PLAIN,) * nj)
    state = Estimate(question, question.scene, prepared, choice, (), (), start, nothing)
    return _fitted(state, laws, first=True)


def _fitted(estimate: Estimate, laws: Sequence[Sequence[Law]], *, first: bool = False) -> Estimate:
    """Fit the present columns, with laws chosen among those offered; `first`: no fit is known."""
    # 1. rows at the present delay, and the parts of their blocks that are held out
    question, nj = estimate.question, estimate.question.scene.model.nv
    rows = tuple(joint_rows(estimate.prepared, j, estimate.delay.value) for j in range(nj))
    joint = np.repeat(np.arange(nj), [r.effort.size for r in rows])
    block, log = (np.concatenate([getattr(r, name) for r in rows]) for name in ("block", "log"))
    prior = urdf_prior(question.scene.model, question.keep_inertias)
    problem = Problem(
        (), np.ones(nj), prior, laws, held_out_parts(joint, block, log), question.motor
    )
    # 2. rows and joints are weighed by what the fit before leaves, with its laws
    fit, row_weights = estimate.fit, tuple(np.ones(r.effort.size) for r in rows)
    for number in range(2):
        if number or not first:
            row_weights, weights = weighted(rows, fit)
            problem = replace(problem, weights=weights)
        problem = replace(problem, grams=())  # those of before take much memory
        pairs = zip(rows, row_weights, strict=True)
        problem = replace(
            problem, grams=tuple(BlockProducts.of(r, w, problem.folds.size) for r, w in pairs)
        )
        normal = problem.normal()
        equations = FrictionNormalEquations(normal, prior)
        fit = equations.fit(problem.slots(estimate.choice.laws))
    # 3. laws
    free = any(tuple(own) != (PLAIN,) for own in laws)
    choice = choose(problem) if free else estimate.choice
    choice = choice.on_motors(mixed(question.scene.drives, nj))
    # 4. links that can exist
    slots = problem.slots(choice.laws)
    fit = consistent_fit(normal, prior, equations.fit(slots), slots)
    if ends := _at_an_end(problem, choice, fit, scale_is_known(estimate)):
        one_loss = [
            replace(x, both_ways=x.both_ways or j in ends) for j, x in enumerate(choice.laws)
        ]
        choice = replace(choice, laws=tuple(one_loss))
        slots = problem.slots(choice.laws)
        fit = consistent_fit(normal, prior, equations.fit(slots), slots)
    # 5. who moved one way only rubs as much the other way
    for values, law, own in zip(fit.slots, choice.laws, slots, strict=True):
        dry = [slot for slot in COULOMB if slot in own]
        if law.coulomb and len(dry) == 1:
            values[COULOMB] = values[dry[0]]
    scene = estimate.scene
    if not question.inertias_stay:
        scene = question.scene.with_(model=with_parameters(question.scene.model, fit.theta))
    return replace(
        estimate,
        scene=scene,
        rows=rows,
        row_weights=row_weights,
        problem=problem,
        choice=choice,
        fit=fit,
    )


def _stribeck_choices(estimate: Estimate, joint: int) -> list[list[int]]:
    """Choices of the slots of a joint's friction that may fall from rest to motion."""
    mine = estimate.question.laws.get(estimate.scene.joint_names[joint])
    if mine is not None or estimate.choice.laws[joint].stribeck_slots:
        slots = (mine or estimate.choice.laws[joint]).stribeck_slots
        return [list(slots)] if slots else []
    loads = [STRIBECK_LOAD] if _loads(estimate, joint) else []
    return [STRIBECK, *([loads, STRIBECK + loads] if loads else [])]


def _loads(estimate: Estimate, joint: int) -> bool:
    """Whether a joint's bearing or visible gear loss may fall from rest to motion."""
    rows, entry = (
        estimate.rows[joint],
        estimate.scene.friction.get(estimate.scene.joint_names[joint]),
    )
    if rows.effort.size == 0 or mixed(estimate.scene.drives, estimate.scene.model.nv)[joint]:
        return False
    named = entry is not None and entry.bearing is not None
    if named or not estimate.question.motor:
        return named
    return turns(estimate.scene, estimate.scene.joint_names[joint]) and _shows_gear(estimate, joint)


def turns(scene: Scene, name: str) -> bool:
    """Return whether a joint turns: only then a scene states its gear's loss as a load."""
    joint = scene.model.joints[scene.joint_names.index(name) + 1]
    return not is_sliding(joint)


def _shows_gear(estimate: Estimate, joint: int) -> bool:
    """Whether a joint's load is large beside its friction, or shows a gear's loss for all that."""
    # friction that was fitted without a gear contains the gear's loss at the mean load
    load = estimate.rows[joint].load
    coulomb = 0.5 * float(estimate.fit.slots[joint, COULOMB].sum())
    large = coulomb - _MOST_LOSS * float(np.mean(np.abs(load)))
    size = float(np.sqrt(np.mean(load**2)))
    return size > large or (size > _LEAST_BESIDE * coulomb and _loses(estimate, joint))


def _loses(estimate: Estimate, joint: int) -> bool:
    """Whether a joint's gear loss, beside its law, is clearly above zero, and one of a gear."""
    problem, laws = estimate.problem, list(estimate.choice.laws)
    laws[joint] = replace(laws[joint], load="gear", side="motor", both_ways=True)
    slots = problem.slots(laws)
    fit = FrictionNormalEquations(problem.normal(), problem.prior).fit(slots)
    place, loss = above_zero(fit, slots), GEARS["motor", "both"]
    at = place == joint * K + loss
    if not at.any():
        return False
    moved, _ = influence(problem.grams, problem.weights, problem.prior, fit, place)
    error = float(np.linalg.norm(moved[:, -place.size :][:, at]))
    return _CLEARLY * error < float(fit.slots[joint, loss]) < _MOST_LOSS


def offered(estimate: Estimate, joint: int) -> tuple[Law, ...]:
    """Return the laws that one joint's data can distinguish, by the estimate."""
    scene, rows = estimate.scene, estimate.rows[joint]
    name = scene.joint_names[joint]
    if name in estimate.question.laws:
        return (estimate.question.laws[name],)
    if rows.effort.size == 0:
        return (PLAIN,)
    drives = float(np.mean(rows.load * rows.velocity > 0.0))
    both = min(drives, 1.0 - drives) > _LEAST_SHARE
    entry = scene.friction.get(name)
    bearing = entry is not None and entry.bearing is not None
    stribeck = estimate.stribeck[joint] if estimate.stribeck else None
    gear = estimate.question.motor and _shows_gear(estimate, joint)
    carried = stribeck is not None and _loads(estimate, joint)
    laws = candidates(bearing, gear, both, stribeck is not None, carried)
    if mixed(scene.drives, scene.model.nv)[joint]:  # its friction follows the motor's speed
        laws = tuple(
            law
            for law in laws
            if not law.stribeck_slots and (not law.load or law.side == "motor" != law.load)
        )
    return laws


def scale_is_known(estimate: Estimate) -> bool:
    """Return whether the scale of the masses is known, so that both losses of a gear show.

    With free masses, (t + f)/eta and eta_b (t + f) are also the efforts of a robot and a friction
    larger by 1/eta, whose gear loses nothing driving and has eta eta_b driven.
    """
    return estimate.question.inertias_stay or any(
        log.recording.trajectory.attached.any() for log in estimate.prepared
    )


def _at_an_end(problem: Problem, choice: Choice, fit: Fit, scale: bool) -> list[int]:
    """Return the joints with one gear loss of two at zero, where one loss may be chosen.

    With free masses a loss of zero is the end of their scale (`scale_is_known`), not a result, and
    would bias the joint's other coefficients. Losses that make no gear, eta_b <= -1/eta, count,
    too.
    """
    ends = []
    for j, law in enumerate(choice.laws):
        one_loss = replace(law, both_ways=True)
        if law.load == "gear" and not law.both_ways and one_loss in problem.laws[j]:
            driving, driven = (fit.slots[j, GEARS[law.side, way]] for way in DIRECTIONS[:2])
            zero = min(driving, driven) <= 0.0 and not scale
            ends += [j] if zero or 1.0 - driven <= -(1.0 + driving) else []
    return ends


def _beyond_a_gear(estimate: Estimate) -> list[int]:
    """Return the joints whose chosen gear would lose more than a gear does, and may do without.

    Where a joint carries little, other friction that no law has makes such a loss, which fits these
    logs and predicts no other motion.
    """
    return [
        j
        for j, law in enumerate(estimate.choice.laws)
        if law.load == "gear"
        and law.both_ways
        and estimate.fit.slots[j, GEARS[law.side, "both"]] > _MOST_LOSS
        and any(own.load != "gear" for own in estimate.problem.laws[j])
    ]


def reloaded(estimate: Estimate, prepared: Prepared, scene: Scene | None = None) -> Prepared:
    """Return a log's columns with loads by the estimate, or by another scene's links."""
    v = prepared.recording.velocity
    inner = np.zeros_like(v)
    for j, values in enumerate(estimate.fit.slots):
        sign, share = np.sign(v[:, j]), prepared.share[:, j]
        inner[:, j] = values[FORWARD] * np.maximum(share, 0.0)
        inner[:, j] += values[BACKWARD] * np.minimum(share, 0.0)
        for slot, p in SPEEDS.items():
            inner[:, j] += values[slot] * sign * np.abs(v[:, j]) ** p
        if estimate.stribeck and (stribeck := estimate.stribeck[j]) is not None:
            inner[:, j] += stribeck_decay(v[:, j], stribeck.velocity, stribeck.exponent) * (
                values[STRIBECK_FORWARD] * (sign > 0.0)
                - values[STRIBECK_BACKWARD] * (sign < 0.0)
                + values[STRIBECK_LOAD] * sign * prepared.bearing[:, j]
            )
    return with_stribeck(with_loads(prepared, scene or estimate.scene, inner), estimate.stribeck)
