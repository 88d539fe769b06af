"""The scene reader: what it accepts and refuses, and that nothing else happens."""

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from schema_cases import WHOLE, anything, with_change
from tables import table

from pinfric.errors import PinfricWarning, SceneError
from pinfric.model.bearings import Bearing
from pinfric.model.entry import parse
from pinfric.model.friction_terms import LoadFriction
from pinfric.model.schema import Friction, SceneFile, Transmission
from pinfric.model.yamlfile import read_yaml


def test_the_whole_format_is_read():
    entries = parse(SceneFile, WHOLE, "scene.yaml")
    assert entries.friction["joint_12"].mu == LoadFriction(static=0.35, kinetic=0.30)
    assert entries.friction["joint_23"].coulomb.negative.static == 3
    assert entries.actuators[1].transmission.rotor_inertia == 4.4e-6
    assert entries.simulation.effort["joint_1"].sine.amplitude == 5.0


REFUSED = r"""
friction joint_23 viscus        0.1                         friction\.joint_23\.viscus.*'viscous'
friction joint_12 bearing       {kind: pin, raduis: 0.1}    raduis`; .*'radius'
lops                            {}                          unknown key `lops`
simulation motor_torqe          {}                          'motor_torque'
friction joint_12 radius        0.1              key `friction\.joint_12\.radius`; there are: bear
friction joint_12 coulomb       5 N m            12\.coulomb`: should be a mapping.*5 N m.$
friction joint_12 7             0.1              joint_12\[7\]`: keys should be strings
friction 7                      {}               `friction\[7\]`: should be text, found 7$
actuators 1 transmission efficiency  null        efficiency`: should be a number, found None$
simulation effort joint_1 sine phase  x          sine\.phase`: should be a number, found 'x'$
friction joint_12 mu            {static: 0.3, kinetic: 0.35}     probably swapped
friction joint_12 mu static     -0.1             at least 0
friction joint_12 bearing radius  -0.1           at least 0
friction joint_12 bearing length  0.0            greater than 0, found 0\.0
friction joint_12 bearing length  -1             greater than 0, found -1
friction joint_12 bearing width   1.0            key .*bearing.width`; there .*, offset$
friction joint_12 bearing kind    pinn           kind`: there is no 'pinn'; did .*'pin'
friction joint_12 bearing       {radius: 0.1}    kind` is missing; there are: pin,
friction joint_12 bearing       [1]              bearing`: should be a mapping of keys, found
friction joint_12 bearing       null             `mu` without `bearing`
friction joint_12 mu            null             `bearing` without `mu`
friction joint_12 viscous       "0.1"            should be a number, found '0.1'
friction joint_12 viscous       true             should be a number, found True
friction joint_12 viscous       .nan             finite
friction joint_12 coulomb       {static: 0.4, kinetic: 0.5}      probably swapped
friction joint_23 coulomb positive static  -2    at least 0
robot gravity                   [0, 0]           gravity
robot gravity                   [0, 0, 0, 0]     `robot.gravity`: has a wrong length
robot gravity                   -9.81            should be a list, found -9\.81
loops                           {pin: {kind: planar_pin}}        `loops`: should be a list
robot payloads box mass         0                greater than 0
actuators 1 transmission ratio  0                ratio must not be 0
actuators 1 transmission efficiency  1.1         at most 1
actuators 1 transmission back_efficiency  null   needs `back_efficiency`
actuators 0                     {transmission: {ratio: 2}}       one of joint, cylinder, force
simulation t_end                0                greater than 0
pinfric                         2                pinfric
"""


def keys(text):
    return [int(key) if key.isdigit() else key for key in text.split()]


@pytest.mark.parametrize(("path", "value", "says"), table(REFUSED, keys, yaml.safe_load, str))
def test_what_cannot_be_is_refused_by_name(path, value, says):
    with pytest.raises(SceneError, match=f"^scene.yaml: .*{says}") as caught:
        parse(SceneFile, with_change(path, value), "scene.yaml")
    assert "\n" not in str(caught.value)


GIVEN = """
stiffness: {k1: 1.0, k2: 2.0, t1: 1.0, t21: 3.0}   `stiffness.t21`; did .*'t2'
stiffness: {k: 1.0, k2: 2.0}                       unknown key `stiffness.k`.*'k3'
no_load_torque: {positive: {static: 1, kinetic: 1}, static: 1}  are: static, kinetic$
efficiency: {rated: 0.8, load: 1.0, lode: 1.0}     `efficiency.lode`; there are:
"""


@pytest.mark.parametrize(("entry", "says"), table(GIVEN, yaml.safe_load, str))
def test_what_is_given_already_cannot_have_been_meant(entry, says):
    """A key that is there already is not suggested."""
    with pytest.raises(SceneError, match=says):
        parse(Transmission, {"ratio": 10, **entry}, "x")


@pytest.mark.parametrize(("kind", "size"), [("ball", "radius"), ("pin", "thrust_radius")])
def test_a_bearing_larger_than_any_is_refused(kind, size):
    """20 mm, written as 20."""
    with pytest.raises(SceneError, match=rf"`{size}`: should be at most 15 m, found 20; check the"):
        parse(Bearing, {"kind": kind, "radius": 0.1, size: 20.0}, "scene.yaml")


def test_all_problems_come_at_once():
    content = with_change(["friction", "joint_12", "viscous"], -1)
    content["stick"]["velocity"] = -1
    with pytest.raises(SceneError, match=r"viscous.*stick\.velocity"):
        parse(SceneFile, content, "scene.yaml")


@pytest.mark.parametrize(
    ("entry", "content", "says"),
    [
        (
            Bearing,
            {"kind": "pin", "radius": 8.0},
            "scene.yaml: radius = 8 m: usually at most 1 m; check the unit",
        ),
        (
            Friction,
            {"bearing": {"kind": "pin", "radius": 0.1}, "mu": {"static": 35, "kinetic": 30}},
            "scene.yaml: mu.static = 35: usually at most 2; check the unit",
        ),
        (
            Transmission,
            {"ratio": 10, "rotor_inertia": 4.4},
            "scene.yaml: rotor_inertia = 4.4 kg m^2: usually at most 0.1 kg m^2; kg cm^2 entered?",
        ),
        (
            SceneFile,
            with_change(["friction", "joint_12", "bearing", "radius"], 8.0),
            "scene.yaml: friction.joint_12.bearing.radius = 8 m: usually at most 1 m; "
            "check the unit",
        ),
        (
            SceneFile,
            with_change(["actuators", 1, "transmission", "ratio"], -2e3),
            "scene.yaml: actuators[1].transmission.ratio = 2000: usually at most 1000; "
            "check the unit",
        ),
    ],
)
def test_implausible_magnitudes_are_questioned_but_taken(entry, content, says):
    with pytest.warns(PinfricWarning) as said:
        parse(entry, content, "scene.yaml")
    assert [str(warning.message) for warning in said] == [says]


@settings(
    max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(content=st.text(max_size=80) | anything.map(yaml.safe_dump))
def test_any_text_is_yaml_or_refused(tmp_path, content):
    file = tmp_path / "scene.yaml"
    file.write_text(content, encoding="utf-8", errors="replace")
    try:
        found: object = read_yaml(file, SceneError)
    except SceneError as error:
        found = str(error)
    assert isinstance(found, dict) or found.startswith(str(file))


@pytest.mark.parametrize(
    ("text", "value"), [("1e-6", 1e-6), ("1.0e-6", 1e-6), (".5", 0.5), ("-2E3", -2000.0), ("7", 7)]
)
def test_numbers_as_people_write_them(tmp_path, text, value):
    file = tmp_path / "a.yaml"
    file.write_text(f"x: {text}\n")
    assert read_yaml(file, SceneError)["x"] == value


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: 1\na: 2\n", r"line 2.*duplicate key \"a\""),
        ("a: [1, 2\n", "not valid YAML"),
        ("", "the file is empty"),
        ("- 1\n", "found a list"),
        ("a: !!python/object/apply:os.system ['true']\n", "not valid YAML"),
    ],
)
def test_malformed_yaml_is_placed(tmp_path, text, says):
    file = tmp_path / "a.yaml"
    file.write_text(text)
    with pytest.raises(SceneError, match=says):
        read_yaml(file, SceneError)
