"""The same robot told otherwise: other names, another mounting, other lengths, a bystander."""

import numpy as np
from judges.changed_robots import RobotFiles, mounted, renamed, scaled, with_bystander

import pinfric as pf

LENGTH, MASS = 2.0, 3.0


def judge_changed(name, ledger, folder):
    """Compare the demands on a changed robot's drives, and what `check` says of it."""
    robot = RobotFiles.of(name)
    robot.motion["sample_rate"] = 100
    scene, motion = robot.load(folder / "as_it_is")
    plain = pf.inverse_dynamics(scene, motion)
    findings = _findings(folder / "as_it_is" / f"{name}.yaml", {})
    other, old = renamed(robot)
    for kind, changed, names, factors in (
        ("renamed", other, old, (1.0, 1.0)),
        ("bystander", with_bystander(robot), {}, (1.0, 1.0)),
        ("mounted", mounted(robot), {}, (1.0, 1.0)),
        ("scaled", scaled(robot, LENGTH, MASS), {}, (MASS * LENGTH, MASS)),
    ):
        scene, motion = changed.load(folder / kind)
        result = pf.inverse_dynamics(scene, motion)
        where = f"{name} {kind}"
        slower = np.sqrt(factors[0] / factors[1])
        ledger.same(f"{kind}: time", where, result.t, slower * plain.t)
        said = [names.get(own, own) for own in scene.actuator_names]
        places = [said.index(own) for own in plain.actuator_names]
        turning = set(plain.scene.joint_names) - robot.slides
        by = [factors[0] if own in turning else factors[1] for own in plain.actuator_names]
        for field in ("effort_lower", "effort_upper", "effort_frictionless"):
            ours, theirs = getattr(result, field)[:, places], by * getattr(plain, field)
            ledger.same(f"{kind}: efforts of inverse", f"{where} {field}", ours, theirs, 1e-7)
        sites = [names.get(own, own) for own in scene.site_names]
        places = [sites.index(own) for own in plain.site_names]
        ours = result.sticking[:, places].mean(axis=0)
        ledger.same(f"{kind}: sticking", where, ours, plain.sticking.mean(axis=0), 0.02)
        if kind in ("renamed", "mounted"):
            again = _findings(folder / kind / f"{name}.yaml", names)
            ledger.holds(f"{kind}: check", where, again == findings, str(sorted(again ^ findings)))


def _findings(file, names):
    found = set()
    for finding in pf.check(file).findings:
        what, _, name = finding.place.rpartition(" ")
        found.add((finding.kind, str(finding.severity), what, names.get(name, name)))
    return found
