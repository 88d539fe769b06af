"""Quality of identification on logs with known truth.

    python benchmarks/identify.py [--seeds 14] [--first 100] [--cases true,stribeck,...]

Each seed is a UR5 of `identify_cases`: 60 s at 250 Hz, 18 bits, white noise of 2 % and
autocorrelated noise of 2 %, efforts 4 ms late, masses wrong by 20 %. The cases are the true model
and those of `identify_wrong_models`; "no bearing" leaves the elbow's bearing out of the scene. The
columns are, for each case: coverage of the 95 % intervals, seeds that report lack of fit, largest
error of the delay, largest error on an unseen motion, ratio of errors on unseen logs to those
reported of held-out blocks, and of the whole friction at 0.5 rad/s of joints without hidden loads
the stated deviation and the true error (RMS over joints and seeds).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/helpers"))
from identify_cases import (
    BACK_EFFICIENCY,
    COULOMB,
    DELAY,
    EFFICIENCY,
    MU,
    NAMES,
    VISCOUS,
    excess,
    excitation,
    guess,
    motor_effort,
    truth,
    whole_friction,
)
from identify_wrong_models import (
    CASES,
    FALL,
    LATE,
    STATIC,
    falling_truth,
    stribeck_truth,
    wrong_log,
)

import pinfric as pf
from pinfric.errors import IdentificationError
from pinfric.identification.identify import Identified

#: Friction that falls from rest to motion: case -> exponent of the speed.
STRIBECK = {"stribeck": 2.0, "stribeck 1": 1.0}
#: Joints whose friction does not depend on the load, and the speed at which it is compared, rad/s.
UNLOADED, SPEED = (0, 3, 4, 5), 0.5
#: The scene lacks what the robot has: the bearing of the elbow.
NO_BEARING = "no bearing"


@dataclass(frozen=True)
class Outcome:
    """Results of one log of one case.

    Attributes:
        inside, known: intervals that hold the true value, and all that have one.
        delay: s, its error.
        unseen: (nj,) error on an unseen motion, as a share of its effort.
        misfits: joints with reported lack of fit.
        seconds: of processor time.
        outside: keys of the intervals that do not hold it.
        beyond: error on an unseen log over that on held-out blocks, whose loads, delay and weights
            are those of all blocks; mean of the joints, each by its effort.
        whole: (2, joints) stated deviation and true error of the whole friction, as shares of it.
    """

    inside: int
    known: int
    delay: float
    unseen: np.ndarray
    misfits: int
    seconds: float
    outside: tuple[str, ...]
    beyond: float
    whole: np.ndarray


def hidden(case: str) -> dict[str, tuple[float, float]]:
    """Key -> least and greatest true value."""
    names, known = truth().joint_names, {}
    for name, ways, viscous in zip(names, COULOMB, VISCOUS, strict=True):
        for way, value in zip(("positive", "negative"), ways, strict=True):
            known[f"friction.{name}.coulomb.{way}"] = value, value
            if case in STRIBECK:
                known[f"friction.{name}.coulomb.{way}.static"] = STATIC * value, STATIC * value
        if case != "power":
            known[f"friction.{name}.viscous"] = viscous, viscous
        if case in STRIBECK:
            known[f"friction.{name}.stribeck.velocity"] = FALL, FALL
    if case == "falling load":
        for name in names[1:3]:
            known[f"friction.{name}.mu"] = 0.05, 0.05
            known[f"friction.{name}.mu.static"] = 0.3, 0.3
            known[f"friction.{name}.stribeck.velocity"] = FALL, FALL
        return known
    known[f"friction.{names[2]}.mu"] = MU, MU
    product = EFFICIENCY * BACK_EFFICIENCY
    known[f"transmission.{names[1]}.efficiency_product"] = product, product
    return known


def outcome(case: str, seed: int) -> Outcome | None:
    """Identify one log and compare with the truth; None if the log is refused."""
    made = "true" if case == NO_BEARING else case
    given, other = wrong_log(made, seed), wrong_log(made, seed + 1000, 30.0)
    scene = guess(seed, bearing=case not in (NO_BEARING, "falling load"))
    if case == "payload":  # with masses wrong as well most such logs are refused
        scene = scene.with_(model=truth().model)
    start = time.process_time()
    try:
        found = pf.identify(scene, given, held_out=[replace(other, name="other")])
    except IdentificationError as error:
        print(f"  {case} {seed}: {error}", file=sys.stderr, flush=True)
        return None
    seconds = time.process_time() - start
    known = hidden(case)
    hits = {
        p.key: p.low <= known[p.key][1] and p.high >= known[p.key][0]
        for p in found.parameters
        if p.key in known
    }
    motion = excitation(99, 20.0, 100.0)
    robot = stribeck_truth(exponent=STRIBECK[case]) if case in STRIBECK else truth()
    robot = falling_truth() if case == "falling load" else robot
    true = motor_effort(robot, motion)
    off = true - motor_effort(found.scene, motion)
    error = np.sqrt(np.mean(off**2, axis=0) / np.mean(true**2, axis=0))
    outside = tuple(key for key, hit in hits.items() if not hit)
    shares = np.array(
        [
            (found.errors[name].error / found.errors[name].rms, one.error / one.rms)
            for name, one in found.unseen["other"].items()
        ]
    )
    return Outcome(
        sum(hits.values()),
        len(hits),
        found.delay - DELAY - LATE * (case == "delay"),
        error,
        misfits(found),
        seconds,
        outside,
        float(np.mean(shares[:, 1] / shares[:, 0])),
        whole(found, robot),
    )


def whole(found: Identified, robot: pf.Scene) -> np.ndarray:
    """Return stated deviations and true errors (2, joints) of friction, as shares of it."""
    result = []
    for j in UNLOADED:
        true = np.mean(COULOMB[j]) + VISCOUS[j] * SPEED + excess(robot, NAMES[j], SPEED)
        draws = whole_friction(found, NAMES[j], SPEED)
        result.append((float(np.std(draws)) / true, float(np.mean(draws)) / true - 1.0))
    return np.array(result).T


def misfits(found: Identified) -> int:
    """Return the number of joints with reported lack of fit."""
    return sum(line.startswith("lack of fit") for line in found.doubts)


def rms(x: object) -> float:
    """Return the root of a mean square."""
    return float(np.sqrt(np.mean(np.square(x))))


def study(cases: list[str], seeds: range) -> Iterator[str]:
    """Yield the table's lines."""
    yield (
        "case       coverage  lack of fit  delay off  unseen motion off  unseen log/blocks  time  "
        "friction: stated, true"
    )
    for case in cases:
        every, refused = [], 0
        for seed in seeds:
            one = outcome(case, seed)
            if one is None:
                refused += 1
                continue
            every.append(one)
            print(
                f"  {case} {seed}: {one.inside}/{one.known}, {one.misfits} misfits, delay "
                f"{1e3 * one.delay:+.2f} ms, unseen {one.unseen.max():.2%} at joint "
                f"{1 + one.unseen.argmax()}, friction {100 * rms(one.whole[0]):.2f} % stated, "
                f"{100 * rms(one.whole[1]):.2f} % off; {' '.join(one.outside)}",
                file=sys.stderr,
                flush=True,
            )
        if not every:
            yield f"{case:<11} all {refused} refused"
            continue
        yield (
            f"{case:<11} {sum(o.inside for o in every) / sum(o.known for o in every):9.1%} "
            f"{sum(o.misfits > 0 for o in every):6d} of {len(every)} "
            f"{1e3 * max(abs(o.delay) for o in every):7.2f} ms "
            f"{max(o.unseen.max() for o in every):18.2%} "
            f"{np.mean([o.beyond for o in every]):12.3f} "
            f"{np.median([o.seconds for o in every]):14.1f} s  "
            f"{rms([o.whole[0] for o in every]):6.2%} {rms([o.whole[1] for o in every]):6.2%}"
            f"{f', {refused} refused' * bool(refused)}"
        )


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=14)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--cases", default=",".join((*CASES, NO_BEARING)))
    given = parser.parse_args()
    for line in study(given.cases.split(","), range(given.first, given.first + given.seeds)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
