"""The header as its user meets it: names, arguments, refusals."""

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import chain, dry, lump
from export_cases import (
    COMPILER,
    RICH,
    STRICT,
    assert_columns,
    compiled,
    configurations,
    header,
    loadable,
    needs_compiler,
    rich,
    sampled,
)
from numpy.testing import assert_allclose, assert_array_equal

import pinfric as pf
from pinfric.dynamics.forward.compensation import CompensationOptions
from pinfric.dynamics.forward.solver import InverseInstant
from pinfric.errors import PinfricError, StateError
from pinfric.exporting.cpp import Bounds, default_frames, header_name, template
from pinfric.model.urdf import implausible_body


def arm(folder, coulomb):
    """The scene that `identify` writes of an arm: each has the same file's name."""
    folder.mkdir()
    body = lump(1.0, moment=1.0)
    friction = {"hinge": dry(coulomb)}
    model = chain(("hinge", pin.JointModelRZ(), body))
    return pf.Scene(model, friction=friction, source=str(folder / "scene.yaml"))


def exported(tmp_path):
    """Two arms of 3 and 7 N m, each in its folder."""
    for name, coulomb in (("left", 3.0), ("right", 7.0)):
        pf.export(arm(tmp_path / name, coulomb), to="cpp").write(tmp_path / name)
    return tmp_path


ASKED = """
  arm::Compensator compensator;
  arm::Options options;
  options.scale[0] = 1.0;
  options.limit[0] = arm::inf;
  const double q[1] = {0.1}, v[1] = {0.5};
  arm::State state;
  state.q = q;
  state.v = v;
  double out[1];
  return compensator.friction(state, options, out) ? out[0] : -1.0;
"""
MAIN = """
#include <cstdio>
double left();
double right();
int main() { std::printf("%.17g %.17g", left(), right()); }
"""


def included(folder, scene, bounds=None):
    """The `#include` of the scene's header, which is written."""
    name = header_name(scene.source)
    (folder / f"{name}.hpp").write_text(header(scene, bounds=bounds))
    return f'#include "{name}.hpp"\nusing namespace {name};\n'


def said(program):
    done = subprocess.run([program], capture_output=True, text=True, timeout=60, check=True)
    return [float(x) for x in done.stdout.split()]


@needs_compiler
@pytest.mark.parametrize("order", [("left", "right"), ("right", "left")])
def test_two_identified_arms_in_two_files_keep_their_torques(tmp_path, order):
    exported(tmp_path)
    for name in order:
        (tmp_path / f"{name}.cpp").write_text(
            f'#include "{name}/pinfric_scene.hpp"\nnamespace arm = pinfric_scene;\n'
            f"double {name}() {{{ASKED}}}\ndouble {name}();\n"
        )
    (tmp_path / "main.cpp").write_text(MAIN)
    sources = [*(tmp_path / f"{name}.cpp" for name in order), tmp_path / "main.cpp"]
    command = [COMPILER, "-std=c++17", "-O0", *sources, "-o", tmp_path / "both"]
    subprocess.run(command, check=True, timeout=120)
    assert said(tmp_path / "both") == [3.0, 7.0]


@needs_compiler
def test_two_identified_arms_in_one_file_keep_their_torques(tmp_path):
    exported(tmp_path)
    inner = [
        re.search(r"inline namespace (\w+)", (tmp_path / name / "pinfric_scene.hpp").read_text())[1]
        for name in ("left", "right")
    ]
    includes = '#include "left/pinfric_scene.hpp"\n#include "right/pinfric_scene.hpp"\n'
    functions = "".join(
        f"double {name}() {{ namespace arm = pinfric_scene::{own};{ASKED}}}\n"
        for name, own in zip(("left", "right"), inner, strict=True)
    )
    (tmp_path / "both.cpp").write_text(includes + MAIN + functions)
    command = [COMPILER, "-std=c++17", tmp_path / "both.cpp", "-o", tmp_path / "both"]
    made = subprocess.run(command, check=True, timeout=120, capture_output=True, text=True)
    assert "two robots share the namespace pinfric_scene" in made.stderr
    assert said(tmp_path / "both") == [3.0, 7.0]
    either = functions.replace(f"pinfric_scene::{inner[0]}", "pinfric_scene")
    (tmp_path / "either.cpp").write_text(includes + MAIN + either)
    command = [COMPILER, "-std=c++17", "-fsyntax-only", tmp_path / "either.cpp"]
    made = subprocess.run(command, timeout=120, capture_output=True, text=True)
    assert made.returncode != 0  # whose friction it would be is not guessed
    assert "ambiguous" in made.stderr


@pytest.mark.parametrize("name", ["2arm", "left arm", "class", "a__b", "_a", "a-b", "std", "ä"])
def test_names_that_are_none_in_cpp_are_refused(tmp_path, name):
    with pytest.raises(PinfricError, match="should be a name of C"):
        pf.export(arm(tmp_path / "a", 3.0), to="cpp", namespace=name)


@pytest.mark.parametrize("source", ["a--b.yaml", "_x_.yaml", "机器人.yaml", "a b.yaml", "1.yaml"])
def test_the_name_of_any_file_is_one_in_cpp(source):
    found = header_name(source)
    assert header_name("", found) == found


@needs_compiler
def test_a_second_header_of_one_robot_compiles_and_says_so(tmp_path):
    for name in ("one", "other"):
        pf.export(arm(tmp_path / name, 3.0), to="cpp").write(tmp_path / name)
        copy = tmp_path / name / "pinfric_scene.hpp"
        os.utime(copy, (0, len(name)))  # else g++ takes it for the same file
    (tmp_path / "both.cpp").write_text(
        '#include "one/pinfric_scene.hpp"\n#include "other/pinfric_scene.hpp"\n'
        '#include "one/pinfric_scene.hpp"\n'
        f"namespace arm = pinfric_scene;\ndouble left();\ndouble left() {{{ASKED}}}\n"
    )
    command = [COMPILER, *STRICT, "-fsyntax-only", tmp_path / "both.cpp"]
    made = subprocess.run(command, timeout=120, capture_output=True, text=True)
    assert made.returncode == 0, made.stderr
    assert made.stderr.count("note: ") == 1  # the same file again is nothing to speak of
    assert "another header of the robot of pinfric_scene" in made.stderr


@needs_compiler
def test_the_program_holds_the_hashes_of_the_files(tmp_path):
    (tmp_path / "use.cpp").write_text(
        included(tmp_path, pf.load_scene("so101")) + "int main() {}\n"
    )
    compiled(tmp_path / "use.cpp", tmp_path / "use", "-O2")
    binary = (tmp_path / "use").read_bytes()
    scene = pf.load_scene("so101")
    for file in (scene.source, scene.robot.urdf):
        digest = subprocess.run(["sha256sum", file], capture_output=True, text=True, check=True)
        stated = f"{Path(file).name} sha256 {digest.stdout.split()[0]}"
        assert stated.encode() in binary


@needs_compiler
@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("c.friction(state, options, out);", "nodiscard"),
        ("c.set_wrench(0, six);", "nodiscard"),
        ("state.q = three;", "no match|cannot convert|no viable"),
        ("const double* p = six; state.q = p;", "no match|no known conversion|no viable"),
    ],
)
def test_what_is_easily_forgotten_does_not_compile(tmp_path, line, complaint):
    scene = pf.load_scene("so101")
    start = (
        f"{included(tmp_path, scene)}"
        "void use(Compensator& c, Options& options, State& state);\n"
        "void use(Compensator& c, Options& options, State& state) {\n"
        "  double out[Robot::drives], six[6] = {}, three[3] = {};\n"
        "  (void)c, (void)options, (void)out, (void)six, (void)three;\n"
    )
    good = "state.q = six; state.q = out; if (!c.friction(state, options, out)) return;"
    for text, fails in ((good, False), (line, True)):
        (tmp_path / "use.cpp").write_text(f"{start}  {text}\n}}\n")
        command = [COMPILER, *STRICT, "-fsyntax-only", tmp_path / "use.cpp"]
        made = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert (made.returncode != 0) == fails, made.stderr
    assert re.search(complaint, made.stderr)


@pytest.mark.slow
@needs_compiler
def test_in_place_and_by_containers(tmp_path):
    """The result may overwrite the state; arrays, vectors, pointers; wrong lengths."""
    scene = RICH[7]
    nv = scene.model.nv
    (tmp_path / "use.cpp").write_text(
        f"#include <array>\n#include <cstdio>\n#include <vector>\n{included(tmp_path, scene)}"
        "int main() {\n"
        "  const Compensator c;\n  Options o;\n  InverseInstant i;\n  int wrong = 0;\n"
        f"  const std::vector<double> x = {{{', '.join(str(0.1 * k + 0.2) for k in range(nv))}}};\n"
        f"  std::array<double, {nv}> plain = {{}};\n  State s;\n  s.q = s.v = s.a = s.v_ref = x;\n"
        "  s.error = s.v_now = x;\n  for (double& h : o.hold_error) h = 0.5;\n"
        "  for (double& p : o.power) p = 1.0;\n"
        "  Freedoms State::*const places[] = {&State::q, &State::v, &State::a, &State::v_ref,\n"
        "                                     &State::error, &State::v_now};\n"
        "  for (int call = 0; call < 4; ++call)\n"
        "    for (const auto place : places) {\n"
        "      std::vector<double> y = x;\n      State t = s;\n      t.*place = y;\n"
        "      bool good = true;\n"
        "      for (int again = 0; again < 2; ++again) {\n"
        "        Drives to = plain;\n        if (again) to = y;\n"
        "        const State& from = again ? t : s;\n"
        "        if (call == 0) good = good && c.friction(from, o, to);\n"
        "        if (call == 1) good = good && c.joint_effort(from, o, to);\n"
        "        if (call == 2) good = good && c.motor_torque(from, o, to, i);\n"
        "        if (call == 3) good = good && c.rigid_body(from, to);\n"
        "      }\n"
        "      for (std::size_t k = 0; k < y.size(); ++k) wrong += !good || y[k] != plain[k];\n"
        "      if (plain[0] == 0.0) ++wrong;\n"
        "    }\n"
        "  std::vector<double> shorter(x.size() - 1);\n"
        "  for (const auto place : places) {\n"
        "    State t = s;\n    t.*place = shorter;\n    wrong += c.friction(t, o, plain).good;\n"
        "  }\n"
        "  wrong += c.friction(s, o, shorter).good + c.friction(State(), o, plain).good;\n"
        '  std::printf("%d", wrong);\n}\n'
    )
    compiled(tmp_path / "use.cpp", tmp_path / "use", "-O1", "-fsanitize=address,undefined")
    assert said(tmp_path / "use") == [0.0]


@pytest.mark.parametrize(
    ("options", "given"),
    [
        ({"hold_error": 0.01}, ()),
        ({"hold_error": 0.01}, ("error",)),
        ({"hold_error": 0.01}, ("v_now",)),
        ({"hold_error": 0.01, "hold_velocity": 0.0}, ("error", "v_now")),
        ({"power": 1.0}, ("error",)),
        ({"power": 0.0}, ()),
    ],
)
def test_options_that_could_do_nothing_are_refused(headers, options, given):
    scene = RICH[0]
    q, v, a = sampled(scene, 4, 3)
    measured = {name: 0.1 * v for name in given}
    wanted = CompensationOptions(**options)
    found = headers.ask(scene, q, v, a, **measured, options=wanted)
    assert (found["good"][:, 3:6] == 0.0).all()
    assert not found["friction"].any()
    state = configurations(scene, q)[0], v[0], a[0], v[0]
    with pytest.raises(StateError, match="CompensationOptions"):
        scene.solver().compensate(*state, options=wanted, **{k: x[0] for k, x in measured.items()})


@pytest.mark.parametrize("place", ["q", "v", "a", "v_ref", "error", "v_now"])
@pytest.mark.parametrize("wrong", [1e15, -1e200, 90.0])
def test_what_no_robot_has_is_refused(headers, place, wrong):
    """Degrees are noticed where they exceed the joint's limits."""
    if wrong == 90.0 and place in ("a", "error"):
        pytest.skip("an acceleration or an error of 90 may be")
    scene = pf.load_scene("ur10_machine_tending")
    q, v, a = (0.3 * x for x in sampled(scene, 14, 3))
    given = {"q": q, "v": v, "a": a, "v_ref": v.copy(), "error": 0.0 * v, "v_now": 0.0 * v}
    given[place][1, 2] = wrong
    state = [given.pop(name) for name in ("q", "v", "a", "v_ref")]
    found = headers.ask(scene, *state, **given)
    assert (found["good"][[0, 2]] == 1.0).all()
    assert found["good"][1, 3] == 0.0
    assert not found["friction"][1].any()
    with pytest.raises(StateError, match=rf"{place}: 'elbow_joint': .* should be a number from"):
        scene.solver().compensate(*(x[1] for x in state), **{k: x[1] for k, x in given.items()})


def test_efforts_have_the_same_names_and_figures_in_both_languages():
    """`effort` after the gear, `joint_effort` a command's content; ends of a negative ratio."""
    fields = re.search(r"struct InverseInstant \{(.*?)\n\};", template("compensator.hpp"), re.S)
    named = set(re.findall(r"(\w+)\[Robot::", fields[1]))
    assert named == {n for n in dir(InverseInstant) if n[0] != "_"} - {
        *("gear_ratio", "status", "count", "index")
    }
    scene = rich(1)
    q, v, a = (x[:40] for x in sampled(scene, 4))
    solver, ratio = scene.solver(), np.array([drive.ratio for drive in scene.drives])
    assert (ratio < 0.0).any()
    q = configurations(scene, q)
    result = pf.inverse_dynamics(scene, q, v, a)
    for i, state in enumerate(zip(q, v, a, strict=True)):
        found = solver.inverse(*state)
        torques = ratio * [found.motor_torque_lower, found.motor_torque_upper]
        for end, expected in zip(("lower", "upper"), np.sort(torques, axis=0), strict=True):
            name = f"joint_effort_{end}"
            assert_array_equal(getattr(found, name), expected)
            assert_allclose(getattr(result, name)[i], expected, rtol=1e-9, atol=1e-9)
    assert np.abs(result.joint_effort_upper - result.effort_upper).max() > 1.0


def test_joint_effort_is_the_motors_torque_seen_from_the_joint(headers):
    """Rigid body, rotors, friction: a controller without the rotors misses r^2 J a."""
    scene = pf.load_scene("ur10_machine_tending")
    q, _, a = sampled(scene, 3)
    v = np.random.default_rng(3).choice([-1.0, 1.0], a.shape) * 0.5
    options = CompensationOptions(switch_velocity=1e-3)
    found = headers.ask(scene, q, v, a, options=options)
    result = pf.inverse_dynamics(scene, q, v, a)
    ratio = np.array([drive.ratio for drive in scene.drives])
    rotor = np.array([drive.transmission.rotor_inertia for drive in scene.drives])
    assert_columns(found["joint_effort"], ratio * result.motor_torque_lower, "effort")
    for end in ("lower", "upper"):
        expected = ratio * getattr(result, f"motor_torque_{end}")
        assert_columns(found[f"joint_effort_{end}"], expected, end)
    without = found["rigid_body"] + found["friction"]
    assert_columns(found["joint_effort"] - without, ratio**2 * rotor * a, "rotors", 1e-10)


def test_a_limit_that_cuts_is_reported(headers):
    scene = RICH[0]
    q, v, a = sampled(scene, 13, 100)
    free = headers.ask(scene, q, v, a)
    assert not free["limited"].any()
    limit = np.abs(free["friction"]).mean(axis=0)
    cut = CompensationOptions(limit=limit)
    found = headers.ask(scene, q, v, a, options=cut)
    assert_array_equal(found["limited"] == 1.0, np.abs(free["friction"]) > limit)
    assert_array_equal(found["friction"], np.clip(free["friction"], -limit, limit))
    assert found["limited"].any()


@needs_compiler
def test_a_scale_that_drives_is_refused_at_a_measured_velocity(tmp_path):
    """Above 1/(1 + e) in the header, above 1 in Python; a desired velocity there, too."""
    (tmp_path / "use.cpp").write_text(
        "#include <cstdio>\n"
        + included(tmp_path, RICH[0], bounds=Bounds.none(6)._replace(stable_scale=[0.7] * 6))
        + "int main() {\n  const Compensator c;\n  Options o;\n  State s;\n"
        "  const double x[6] = {0.1, 0.1, 0.1, 0.1, 0.1, 0.1};\n  double out[6];\n"
        "  s.q = s.v_now = x;\n"
        '  std::printf("%g %d ", o.measured_scale[0], c.friction_measured(s, o, out).good);\n'
        "  o.measured_scale[0] = 0.71;\n"
        '  std::printf("%d ", c.friction_measured(s, o, out).good);\n'
        "  o = Options();\n  s.v_ref = x;\n"
        '  std::printf("%d", c.friction_measured(s, o, out).good);\n}\n'
    )
    compiled(tmp_path / "use.cpp", tmp_path / "use")
    assert said(tmp_path / "use") == [0.7, 1.0, 0.0, 0.0]
    solver = RICH[0].solver()
    with pytest.raises(StateError, match=r"measured_scale: 1\.01 drives a joint that moves"):
        solver.compensate_measured(
            pin.neutral(RICH[0].model),
            np.zeros(6),
            options=CompensationOptions(measured_scale=1.01),
        )


def test_the_limit_of_joint_effort_covers_the_rigid_body(headers):
    """What `limit` passes of a wrong load stops there, at the shafts, too."""
    scene = RICH[0]
    q, v, a = sampled(scene, 13, 100)
    free = headers.ask(scene, q, v, a)
    limit = np.abs(free["joint_effort"]).mean(axis=0)
    found = headers.ask(scene, q, v, a, joint_effort_limit=limit)
    assert_columns(found["joint_effort"], np.clip(free["joint_effort"], -limit, limit), "cut")
    at_shaft = np.abs(limit / [drive.ratio for drive in scene.drives])
    expected = np.clip(free["feed_forward"], -at_shaft, at_shaft)
    assert_columns(found["feed_forward"], expected, "cut")
    assert_array_equal(found["friction"], free["friction"])


def test_limits_of_joint_effort_are_the_robots():
    """Of a joint without one: 1.5 times what the motion takes."""
    scene = pf.load_scene("ur10_machine_tending")
    model = scene.model.copy()
    model.effortLimit[4] = np.inf
    scene = scene.with_(model=model)
    motion = pf.load_trajectory("ur10_machine_tending", scene)
    text = pf.export(scene, motion, "cpp").text
    limits = re.search(r"default_joint_effort_limit\[\] = \{(.*)\};", text)[1]
    found, result = [float(x) for x in limits.split(", ")], pf.inverse_dynamics(scene, motion)
    most = np.maximum(-result.joint_effort_lower, result.joint_effort_upper)[:, 4].max()
    assert found.pop(4) == pytest.approx(1.5 * most, rel=5e-3)
    assert found == np.delete(model.effortLimit, 4).tolist()


@pytest.mark.parametrize(
    ("com", "moment", "taken"),
    [(0.14, 0.01, True), (140.0, 0.01, False), (-8.0, 0.01, False), (0.14, 5e4, False)],
)
def test_a_payload_in_millimetres_is_refused(headers, com, moment, taken):
    """140 in place of 0.14 m gives thousands of N m; a moment in kg mm^2 as many."""
    scene = pf.load_scene("ur10_machine_tending")
    payload = (0, 2.8, [0.0, 0.0, com], [moment, 0.0, 0.0, moment, 0.0, moment])
    q, v, a = (0.3 * x for x in sampled(scene, 14, 1))
    found = headers.ask(scene, q, v, a, payloads=[payload])
    assert (found["good"][0, 0] == 1.0) == taken
    assert np.abs(found["rigid_body"]).max() < 1e3


@pytest.mark.parametrize(("mass", "taken"), [(2.8, True), (2800.0, False), (1e9, False)])
def test_a_payload_in_grams_is_refused(headers, mass, taken):
    """2800 kg at an arm of which 29 kg move."""
    scene = pf.load_scene("ur10_machine_tending")
    payload = (0, mass, [0.0, 0.0, 0.14], [0.00872, 0.0, 0.0, 0.00872, 0.0, 0.004])
    q, v, a = (0.3 * x for x in sampled(scene, 14, 1))
    found = headers.ask(scene, q, v, a, payloads=[payload])
    assert (found["good"][0, 0] == 1.0) == taken


def test_a_missing_velocity_is_the_states_or_refused(tmp_path):
    solver, q, v = arm(tmp_path / "arm", 3.0).solver(), np.array([0.1]), np.array([0.5])
    wanted = solver.compensate(q, v, 0 * v, v)
    assert wanted[0] == 3.0
    assert solver.compensate(q, v, 0 * v) == solver.compensate(q, v, 0 * v, None) == wanted
    for call, name in (
        (lambda: solver.compensate(q, None, None), "v_ref"),
        (lambda: solver.compensate_measured(q, None), "v_now"),
        (lambda: solver.compensate_measured(q, None, v=v), "v_now"),
    ):
        with pytest.raises(StateError, match=rf"^{name}: missing: .* velocity, \(1,\)$"):
            call()
    for options in ({}, None, {"scale": 1.0}, CompensationOptions):
        with pytest.raises(StateError, match=r"^options: should be a pf\.CompensationOptions"):
            solver.compensate(q, v, 0 * v, options=options)
    assert solver.compensate(q, v, 0 * v) == wanted


@pytest.mark.parametrize("to", ["mjcf", "urdf", "sdf", "cpp"])
def test_a_free_base_is_told_to_export_a_fixed_one(to):
    model = chain(
        ("base", pin.JointModelFreeFlyer(), lump(5.0)), ("leg", pin.JointModelRY(), lump(1.0))
    )
    scene = pf.Scene(model, friction={"leg": dry(0.1)}, actuators=[{"joint": "leg"}])
    with pytest.raises(PinfricError, match=r"'base' has .* degrees of .* fixed base") as refused:
        pf.export(scene, to=to)
    assert "rajectory" not in str(refused.value)
    with pytest.raises(PinfricError, match="forces at the feet hold this robot: give a motion"):
        pf.export(scene, to="constants")


@needs_compiler
def test_payloads_are_put_down_and_exchanged(tmp_path):
    """After `set_payload` only the last is there; after `clear_payloads` none."""
    scene = loadable()
    place, tool = default_frames(scene).index("link_5"), scene.payloads["tool"]
    numbers = "{" + ", ".join(repr(float(x)) for x in tool.inertia) + "}"
    com = "{" + ", ".join(repr(float(x)) for x in tool.com) + "}"
    asked = 's.q = q; (void)!c.rigid_body(s, out); for (double x : out) std::printf("%.17g ", x);'
    (tmp_path / "use.cpp").write_text(
        f"#include <cstdio>\n{included(tmp_path, scene)}"
        f"int main() {{\n  Compensator c;\n  State s;\n  double out[{scene.model.nv}];\n"
        f"  double q[{scene.model.nv}] = {{0.3, 0.2, 0.1}};\n"
        f"  const double com[3] = {com}, inertia[6] = {numbers}, far[3] = {{1, 2, 3}};\n"
        f"  bool good = c.add_payload({place}, 5.0, far, inertia);\n"
        f"  good = good && c.set_payload({place}, {tool.mass!r}, com, inertia);\n"
        f"  if (!good || c.set_payload({place}, -1.0, com, inertia)) return 1;\n"
        f"  {asked}\n  c.clear_payloads();\n  {asked}\n}}\n"
    )
    compiled(tmp_path / "use.cpp", tmp_path / "use")
    found = np.reshape(said(tmp_path / "use"), (2, -1))
    q = np.zeros((1, scene.model.nv))
    q[0, :3] = 0.3, 0.2, 0.1
    for row, carried in zip(found, (True, False), strict=True):
        attached = np.full((1, 1), carried)
        full, still = configurations(scene, q), np.zeros_like(q)
        result = pf.inverse_dynamics(scene, full, still, still, attached=attached)
        P = result.effort_frictionless[0]
        assert_allclose(row, P, rtol=1e-12, atol=1e-12 * np.abs(P).max())


@needs_compiler
def test_payloads_are_judged_as_links_are(headers):
    """Random inertias, some of no body: the header agrees with `implausible_body`."""
    scene, rng = loadable(), np.random.default_rng(0)
    q, v, a = sampled(scene, 6, 1)
    kinds = set()
    for _ in range(30):
        turn = pin.exp3(rng.normal(size=3))
        J = turn @ np.diag(rng.uniform(-0.2, 1.0, 3)) @ turn.T
        J[1, 0], J[2, 0], J[2, 1] = J[0, 1], J[0, 2], J[1, 2]
        payload = (0, 1.0, np.zeros(3), J[np.triu_indices(3)])
        possible = implausible_body(1.0, J) is None
        found = headers.ask(scene, q, v, a, payloads=[payload])
        assert (found["good"][0, 0] == 1.0) == possible
        kinds.add(possible)
    assert kinds == {True, False}
