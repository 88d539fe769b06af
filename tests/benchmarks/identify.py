"""How well identification does on logs with known truth: python tests/benchmarks/identify.py [N]

N seeds (18) of a UR5 as tests/identify_cases.py makes it: 60 s at 500 Hz, 18 bits, noise of 2 % and
2 % that hangs together, efforts 4 ms late, masses wrong by 20 %. Printed are the coverage of 95 %
intervals, the delay, how often the kind of law is found, the error on an unseen motion, and time.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from identify_cases import (
    BACK_EFFICIENCY,
    COULOMB,
    DELAY,
    EFFICIENCY,
    MU,
    VISCOUS,
    excitation,
    guess,
    log,
    motor_effort,
    truth,
)

import pinfric as pf


def hidden() -> dict[str, tuple[float, float]]:
    """Key -> least and greatest true value (a gear with one loss: between both of its own)."""
    names, known = truth().joint_names, {}
    for name, (up, down), viscous in zip(names, COULOMB, VISCOUS, strict=True):
        known |= {f"friction.{name}.coulomb.positive": (up, up),
                  f"friction.{name}.coulomb.negative": (down, down),
                  f"friction.{name}.viscous": (viscous, viscous)}  # fmt: skip
    equal = 1.0 / (2.0 - BACK_EFFICIENCY)
    known[f"friction.{names[2]}.mu"] = MU, MU
    known[f"transmission.{names[1]}.efficiency"] = min(equal, EFFICIENCY), EFFICIENCY
    return known


def main(seeds: int) -> None:
    """Run and print."""
    known, inside, delays, kinds, errors, seconds = hidden(), [], [], [], [], []
    motion = excitation(99, 20.0, 100.0)
    true = motor_effort(truth(), motion)
    for seed in range(seeds):
        given = log(seed)
        start = time.process_time()
        found = pf.identify(guess(seed), given)
        seconds.append(time.process_time() - start)
        hits = [p.low <= known[p.key][1] and p.high >= known[p.key][0]
                for p in found.parameters if p.key in known]  # fmt: skip
        inside += hits
        delays.append(found.delay)
        laws = list(found.laws.values())
        kinds.append((laws[1].load == "gear", laws[2].load == "bearing"))
        off = true - motor_effort(found.scene, motion)
        errors.append(np.sqrt(np.mean(off**2, axis=0) / np.mean(true**2, axis=0)))
        print(f"seed {seed}: {np.mean(hits):.0%} inside, delay {1e3 * found.delay:.2f} ms, error "
              f"{errors[-1].max():.2%} at most, {seconds[-1]:.1f} s", flush=True)  # fmt: skip
    late = np.abs(np.array(delays) - DELAY)
    print(f"\n95 % intervals cover {np.mean(inside):.1%} of {len(inside)}; delay within "
          f"{1e3 * late.max():.2f} ms; gear found {sum(k[0] for k in kinds)}, bearing "
          f"{sum(k[1] for k in kinds)} of {seeds}; unseen motion off by {np.max(errors):.2%}; "
          f"{np.median(seconds):.1f} s of processor time")  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 18)
