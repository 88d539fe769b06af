"""Commands beside each other: what one signs, writes or finds, the others run, repeat and keep."""

import contextlib
import io
import json
from html import unescape
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from export_cases import Headers, configurations
from identify_cases import identified_arm
from judges.changed_robots import MISTAKES, ROBOTS, RobotFiles
from judges.seams_of_states import judge_scene

import pinfric as pf
from pinfric import cli

#: What `size` gives beside a robot's scene and cycle.
DEFAULT = ("--catalog", "default")
#: A sample may exceed a limit by so much: retime's own tolerance.
WITHIN = 1.0 + 1e-3


class Ran(NamedTuple):
    """What a command left: exit code, what --json printed, and both streams."""

    code: int
    printed: dict
    out: str
    err: str

    @property
    def result(self):
        """The result in the JSON; empty where there is none."""
        return self.printed.get("result", {})

    @property
    def said(self):
        """All texts of the JSON and of the streams."""
        texts = [self.out * (not self.printed), self.err]

        def gather(x):
            if isinstance(x, str):
                texts.append(x)
            for inner in x.values() if isinstance(x, dict) else x if isinstance(x, list) else ():
                gather(inner)

        gather(self.printed)
        return " ".join(" ".join(texts).split())

    @property
    def orderly(self):
        """Whether it did its work, or refused it in one line."""
        errors = [line for line in self.err.splitlines() if line.startswith("pinfric: error")]
        return self.code == 0 or (self.code == 2 and len(errors) == 1)


def pinfric(*words):
    """Run a command in this process."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            cli.main([str(word) for word in words])
        except SystemExit as ended:
            code = int(ended.code or 0)
    text = out.getvalue()
    printed = json.loads(text) if "--json" in words and text.strip() else {}
    return Ran(code, printed, text, err.getvalue())


def tells(text, finding, findings):
    """Whether a text says a finding: in its words, or at its place beside one of its kind."""
    alike = [x["found"] for x in findings if x["kind"] == finding["kind"]]
    place = finding["place"].split()[-1]
    beside = place in text or " more" in text
    return finding["found"] in text or (beside and any(found in text for found in alike))


def judge_verdict(ledger, where, scene, cycle, out, words=DEFAULT):
    """Compare `check`, `size` and `inverse` of one scene: nothing is signed against a finding.

    Returns what `size` left.
    """
    checked = pinfric("check", scene, "--json")
    given = [cycle] if cycle else []
    sized = pinfric("size", scene, *given, *words, "--out", out, "--json")
    ledger.holds("size: a result, or one line", where, sized.orderly, sized.err)
    ledger.holds("check: a result, or one line", where, checked.orderly, checked.err)
    errors, warnings = (
        [x for x in checked.result.get("findings", ()) if x["severity"] == severity]
        for severity in ("error", "warning")
    )
    ledger.holds("check: exit 2 = errors", where, (checked.code == 2) == bool(errors))
    others = {}
    if cycle:
        others["inverse"] = pinfric("inverse", scene, cycle, "--json")
    if not sized.result:
        for finding in errors:
            at = f"{where}: {finding['place']}: {finding['found']}"
            ledger.holds("an error of check: nothing is signed", at, sized.code == 2)
        return sized
    verdict = sized.result["verdict"]
    ledger.holds("size: exit 0 = signed", where, (sized.code == 0) == verdict["signed"])
    failing, remarks = (" ".join(verdict[key]) for key in ("failing", "remarks"))
    for finding in errors:
        at = f"{where}: {finding['place']}: {finding['found']}"
        ledger.holds("an error of check: nothing is signed", at, not verdict["signed"])
        ledger.holds("an error of check: no joint is signed", at, verdict["fitted"] == 0)
        ledger.holds("an error of check: a failing line", at, tells(failing, finding, errors))
        for name, ran in others.items():
            told = ran.code == 2 or tells(ran.said, finding, errors)
            ledger.holds(f"an error of check: {name} says it", at, told)
    page = Path(out) / "report.html"
    shown = " ".join(unescape(page.read_text(encoding="utf-8")).split()) if page.exists() else ""
    for finding in warnings:
        at = f"{where}: {finding['place']}: {finding['found']}"
        told = tells(f"{remarks} {failing}", finding, warnings)
        ledger.holds("a warning of check: a remark of size", at, told)
        if shown:
            on_page = tells(shown, finding, warnings)
            ledger.holds("a warning of check: on the page to sign", at, on_page)
    return sized


def judge_speeds(ledger, where, scene, motion, sized):
    """A signed cycle is within the URDF's speeds and positions, or remarks say that it is not."""
    verdict, model = sized.result["verdict"], pf.load_scene(scene).model
    names = list(model.names)[1:]
    beyond = set()
    for joint in sized.result["joints"]:
        if joint["name"] in names:
            column = model.joints[names.index(joint["name"]) + 1].idx_v
            limit = float(model.velocityLimit[column])
            if 0.0 < limit < 1e3 and joint["speed"] > WITHIN * limit:
                beyond.add(joint["name"])
    told = " ".join([*verdict["remarks"], *verdict["failing"]])
    for joint in sized.result["joints"]:
        held = joint["name"] not in beyond or joint["name"] in told
        ledger.holds(
            "a signed cycle: within the URDF's speeds, or said", f"{where} {joint['name']}", held
        )


def judge_files(ledger, where, given, cycle, sized, out, quick=False):
    """Compare what commands make of the files of `size`: they are the machine that was sized."""
    scene, motors = Path(out) / "sized.scene.yaml", Path(out) / "motors.yaml"
    if not scene.exists():
        ledger.holds("unsigned without files: says why", where, sized.code == 2)
        return
    joints = {joint["name"]: joint for joint in sized.result["joints"]}
    signed = sized.result["verdict"]["signed"]
    computed = pinfric("inverse", scene, cycle, "--json")
    ledger.holds("files of size: inverse runs", where, computed.code == 0, computed.err)
    for drive in computed.result.get("joints", ()):
        mine, at = joints[drive["name"]], f"{where} {drive['name']}"
        for key in ("peak", "rms", "rms_least", "peak_frictionless", "rms_frictionless"):
            ledger.same(
                "files of size: efforts of inverse", f"{at} {key}", drive[key], mine[key], 1e-5
            )
        motor = (mine["installed"] or {}).get("motor")
        if motor:
            for ours, theirs in (("motor_peak", "peak"), ("motor_rms", "rms")):
                ledger.same(
                    *("files of size: motor torques of inverse", f"{at} {ours}"),
                    *(drive[ours], motor[theirs], 1e-4),
                )
    before, after = (
        {
            (x["kind"], x["place"])
            for x in pinfric("check", file, "--json").result["findings"]
            if x["severity"] != "note"
        }
        for file in (given, scene)
    )
    if signed:
        ledger.holds(
            "files of a signed size: check finds nothing new",
            where,
            after <= before,
            str(after - before),
        )
    if quick:
        return
    ran = {
        "explain": pinfric("explain", scene, cycle, "--json"),
        "replay": pinfric("replay", scene, cycle, "--html", Path(out) / "plain.html"),
        "replay --motors": pinfric(
            "replay", scene, cycle, "--motors", motors, "--html", Path(out) / "motors.html"
        ),
        "export constants": pinfric(
            *("export", scene, "--to", "constants", "--out", Path(out) / "c.json")
        ),
        "export mjcf": pinfric("export", scene, "--to", "mjcf", "--out", Path(out) / "robot.xml"),
        "export cpp": pinfric("export", scene, "--to", "cpp", "--out", Path(out) / "cpp"),
    }
    for name, one in ran.items():
        ledger.holds(
            "files of size: every command runs, or one line",
            f"{where} {name}",
            one.orderly,
            one.err[-300:],
        )
    again = pinfric("size", scene, cycle, *DEFAULT, "--json")
    ledger.holds(
        "files of size: every command runs, or one line",
        f"{where} size",
        again.orderly,
        again.err[-300:],
    )
    if pf.load_scene(scene).stops is not None:
        _stops(ledger, where, scene, cycle, sized)
    _retimed(ledger, where, scene, cycle, motors, out, sized)


def _stops(ledger, where, scene, cycle, sized):
    """`stop` of the files gives the stops that `size` judged."""
    stopped, mine = pinfric("stop", scene, cycle, "--json"), sized.result["stops"]
    ledger.holds("files of size: stop runs", where, stopped.orderly, stopped.err)
    if mine is None or not stopped.result:
        return
    for ours, theirs in zip(stopped.result["axes"], mine["axes"], strict=True):
        for key in ("time", "travel", "peak", "energy"):
            at = f"{where} {ours['name']} {key}"
            if ours[key] is not None or theirs[key] is not None:
                ledger.same("stop of files = stops of size", at, ours[key], theirs[key], 1e-4)
    unmet = bool(stopped.result["unmet"])
    ledger.holds("stop: exit 2 = unmet", where, (stopped.code == 2) == unmet)
    ledger.holds("signed: stop meets its criteria", where, not (sized.code == 0 and unmet))


def _retimed(ledger, where, scene, cycle, motors, out, sized):
    """A retimed motion keeps the limits that `retime` states, and is no longer than the cycle."""
    folder = Path(out) / "retimed"
    ran = pinfric("retime", scene, cycle, "--motors", motors, "--out", folder, "--json")
    ledger.holds(
        "files of size: every command runs, or one line",
        f"{where} retime",
        ran.orderly,
        ran.err[-300:],
    )
    loops = bool(pf.load_scene(scene).loops)
    if sized.code == 0 and not loops:
        ledger.holds("signed: retime finds a motion", where, bool(ran.result), ran.err[-300:])
    if not ran.result:
        return
    result = ran.result
    if sized.code == 0:
        slower = result["duration"] > WITHIN * result["before"]
        ledger.holds(
            "signed: retime is not slower than the cycle",
            where,
            not slower,
            f"{result['duration']} s of {result['before']} s",
        )
    computed = pinfric("inverse", scene, folder / "trajectory.csv", "--json").result
    efforts = {drive["name"]: drive for drive in computed["joints"]}
    for drive in result["drives"]:
        at, mine = f"{where} {drive['name']}", efforts[drive["name"]]
        limits = drive["limits"]
        if limits.get("peak_torque") and sized.code == 0:
            peak = mine["motor_peak"] / limits["peak_torque"]
            ledger.holds(
                "retimed motion by inverse: within the limits",
                at,
                peak <= WITHIN,
                f"{peak:.5f} of the peak torque",
            )
        if drive["rms"] is not None and limits.get("continuous_torque"):
            ledger.same(
                "retimed motion by inverse: its RMS",
                at,
                mine["motor_rms"] / limits["continuous_torque"],
                drive["rms"],
                2e-3,
            )
        unmet = [c["name"] for c in drive["criteria"] if c["status"] == "not met"]
        ledger.holds(
            "retimed motion: rows of size met, or not signed",
            at,
            not unmet or ran.code == 2,
            str(unmet),
        )
    again = pinfric("retime", scene, folder / "trajectory.csv", "--motors", motors, "--json")
    if ledger.holds(
        "retimed motion: retime takes it again", where, bool(again.result), again.err[-300:]
    ):
        longer = again.result["duration"] > WITHIN * result["duration"]
        ledger.holds(
            "retimed motion: again no slower",
            where,
            not longer,
            f"{again.result['duration']} s of {result['duration']} s",
        )


def judge_route(name, ledger, folder, scene=None, cycle=None, words=(), quick=False):
    """Follow a bundled scene along the guide's route: check, size, and the files of size."""
    scene, cycle = scene or name, cycle or name
    out = folder / "sized"
    sized = judge_verdict(ledger, name, scene, cycle, out, (*DEFAULT, *words))
    kind = "size of a bundled scene: a result"
    if ledger.holds(kind, name, bool(sized.result), sized.err[-300:]):
        judge_speeds(ledger, name, scene, cycle, sized)
        judge_files(ledger, name, scene, cycle, sized, out, quick)
    return sized


def judge_rating(name, ledger, folder, payload, urdf):
    """A rating, and the same rating as the way-points that `new` writes for it."""
    made = pinfric("new", urdf, "--payload", payload, "--out", folder)
    ledger.holds("new: runs", name, made.code == 0, made.err)
    scene = folder / f"{Path(urdf).stem}.yaml"
    points = scene.with_suffix(".rating.waypoints.yaml")
    rating, cycle = (
        pinfric("size", scene, *words, *DEFAULT, "--json").result
        for words in (("--rating", f"payload={payload}"), (points,))
    )
    for ours, theirs in zip(rating["joints"], cycle["joints"], strict=True):
        for key in ("peak", "rms", "speed"):
            at = f"{name} {ours['name']} {key}"
            ledger.same("rating = its way-points as a cycle", at, ours[key], theirs[key], 1e-3)
    held = rating["rating"]["joints"]
    for joint in held:
        mine = next(x for x in rating["joints"] if x["name"] == joint["name"])
        at = f"{name} {joint['name']}"
        ledger.holds(
            "rating: its peak bears what it holds",
            at,
            mine["peak_without_masses"] >= 0.999 * joint["held"] - 1e-9,
            f"{mine['peak_without_masses']} of {joint['held']}",
        )


def judge_explained(name, ledger, folder, loads):
    """`explain` beside `inverse`: peaks with and without the friction of loads."""
    found = pinfric("explain", name, name, "--json").result
    scene = pf.load_scene(name)
    motion = pf.load_trajectory(name, scene)
    without = scene.with_(friction={})
    ends = [pf.inverse_dynamics(x, motion) for x in (scene, without)]
    peaks = [np.maximum(np.abs(x.effort_lower), np.abs(x.effort_upper)).max(axis=0) for x in ends]
    changes = peaks[0] - peaks[1]
    change = changes[np.argmax(np.abs(changes))]
    effects = {effect["name"]: effect for effect in found["effects"]}
    ledger.same(
        "explain: change of the peak by inverse", name, effects[loads]["peak_change"], change, 1e-6
    )
    for effect in found["effects"]:
        if effect["on"] and effect["peak_change"] is not None:
            ledger.holds(
                "explain: a change names its drive",
                f"{name} {effect['name']}",
                effect["drive"] in scene.actuator_names,
            )
    ledger.holds(
        "explain: loops are an effect of loops", name, effects["loops"]["on"] == bool(scene.loops)
    )


def judge_mistakes(name, ledger, folder, mistakes):
    """Check, size and inverse of a robot with mistaken units."""
    for mistake in mistakes:
        robot = RobotFiles.of(name)
        MISTAKES[mistake](robot)
        robot.motion["sample_rate"] = 100
        scene, cycle = robot.write(folder / mistake.replace(" ", "_").replace("/", "_"))
        where = f"{name}, {mistake}"
        checked = pinfric("check", scene, "--json")
        found = [x for x in checked.result.get("findings", ()) if x["severity"] != "note"]
        ledger.holds("a mistaken unit: check finds it", where, bool(found) or checked.code == 2)
        judge_verdict(ledger, where, scene, cycle, scene.parent / "sized")


def judge_masses(name, ledger, folder, masses):
    """Links that weigh less than the drives that they hold are never signed with them."""
    for said in masses:
        scene = yaml.safe_load((ROBOTS / f"{name}.yaml").read_text(encoding="utf-8"))
        scene["robot"].pop("masses", None)
        if said:
            scene["robot"]["masses"] = said
        file = folder / f"{said or 'unsaid'}.yaml"
        file.write_text(yaml.safe_dump(scene, sort_keys=False))
        where = f"{name}, masses {said or 'unsaid'}"
        sized = judge_verdict(ledger, where, file, name, folder / file.stem)
        light = sized.result["verdict"]
        weight = pinfric("check", file, "--json").result["figures"]["moving_mass"]
        drives = sized.result["drive_mass"]
        held = said != "without_drives" and drives > weight
        ledger.holds(
            "links lighter than their drives: not signed", where, not (held and light["signed"])
        )


def judge_new(urdf, ledger, folder):
    """A robot made by `new`: every command takes its files, and none signs against a finding."""
    name = Path(urdf).stem
    made = pinfric("new", urdf, "--out", folder)
    if not ledger.holds("new: files, or one line", name, made.orderly, made.err) or made.code:
        return
    scene, cycle = folder / f"{name}.yaml", folder / f"{name}.waypoints.yaml"
    motion = cycle if cycle.exists() else None
    asked = DEFAULT if motion else (*DEFAULT, "--rating", "payload=0.5")
    sized = judge_verdict(ledger, name, scene, motion, folder / "sized", asked)
    read = pf.load_scene(scene)
    if all(
        joint.nq for joint in list(read.model.joints)[1:]
    ):  # mimic joints have none of their own
        judge_scene(ledger, name, read, count=2)
    if motion is None:
        return
    if sized.result:
        judge_speeds(ledger, name, scene, motion, sized)
        judge_files(ledger, name, scene, motion, sized, folder / "sized", quick=True)
    for words in (("retime", scene, motion), ("explain", scene, motion), ("stop", scene, motion)):
        ran = pinfric(*words, "--json")
        ledger.holds(
            "new: every command runs, or one line",
            f"{name} {words[0]}",
            ran.orderly,
            ran.err[-300:],
        )


def judge_identified(ledger, folder):
    """The files of an identified scene: inverse, Solver, header and exports say the same."""
    found = identified_arm()
    found.save(folder)
    scene = pf.load_scene(folder / "scene.yaml")
    recording = found.recordings[0].trajectory
    rows = np.unique(np.linspace(0, recording.t.size - 1, 40).astype(int))
    q, v, a = (x[rows] for x in (recording.q, recording.v, recording.a))
    ours, theirs = (pf.inverse_dynamics(x, q, v, a) for x in (found.scene, scene))
    for field in ("effort_lower", "joint_effort_upper", "motor_torque_lower"):
        where = f"identified arm {field}"
        ledger.same(
            "identified scene = its file", where, *(getattr(x, field) for x in (ours, theirs)), 1e-6
        )
    solver, headers = scene.solver(), Headers(folder, [scene])
    angles = recording.joint_positions()[rows]
    told = headers.ask(scene, angles, v, a)
    full = configurations(scene, angles)
    for k in range(len(rows)):
        one, at = solver.inverse(full[k], v[k], a[k]), f"identified arm state {k}"
        for field in ("effort_lower", "effort_upper", "joint_effort_lower", "motor_torque_upper"):
            ledger.same(
                "C++ header = Solver", f"{at} {field}", told[field][k], getattr(one, field), 1e-9
            )
        friction = solver.compensate(full[k], v[k], a[k], v[k])
        ledger.same("C++ header = Solver.compensate", at, told["friction"][k], friction, 1e-9)
    for to in ("mjcf", "urdf", "sdf", "constants"):
        ran = pinfric("export", folder / "scene.yaml", "--to", to, "--out", folder / f"out.{to}")
        ledger.holds("identified scene: exports run", to, ran.code == 0, ran.err)
    for name, error in {**found.errors, **found.unseen["other"]}.items():
        at = f"identified arm {name}"
        ledger.holds(
            "two errors: of moving rows and fitted rows", at, error.moving_error > 0.0 < error.error
        )
