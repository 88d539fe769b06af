import copy

import yaml
from hypothesis import strategies as st

WHOLE = yaml.safe_load("""
pinfric: 1
robot:
  urdf: three_link.urdf
  gravity: [0.0, -9.81, 0.0]
  locked: {finger: 0.02}
  payloads:
    box: {link: tool0, mass: 2.0, com: [0, 0, 0.05], inertia: [0.01, 0, 0, 0.01, 0, 0.01]}
  urdf_dynamics: ignore
  masses: with_drives
friction:
  joint_12:
    bearing: {kind: pin, radius: 0.08, length: 0.10}
    mu: {static: 0.35, kinetic: 0.30}
    coulomb: {static: 0.5, kinetic: 0.4}
    stribeck: {velocity: 0.02, exponent: 2}
    viscous: 0.1
    stick_velocity: 1.0e-6
  joint_23:
    coulomb: {positive: {static: 2, kinetic: 1}, negative: {static: 3, kinetic: 1}}
actuators:
  - {joint: joint_1}
  - joint: joint_2
    transmission:
      {ratio: 100, efficiency: 0.88, back_efficiency: 0.83, no_load_torque: 0.031,
       rotor_inertia: 4.4e-6}
stick: {velocity: 1.0e-6}
simulation:
  start: {q: {joint_1: 0.0}, v: {joint_1: 1.0}}
  effort:
    joint_1: {sine: {amplitude: 5.0, angular_frequency: 1.0}}
    joint_12: 0.0
    joint_23: {table: torques.csv}
  t_end: 1.0
""")


def with_change(path, value):
    content = copy.deepcopy(WHOLE)
    here = content
    for key in path[:-1]:
        here = here[key]
    here[path[-1]] = value
    return content


numbers = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-3, 3)


#: A message quotes them; "[_" in one tells of our own types, so none has an underscore.
words = st.text(st.characters(exclude_characters="_", codec="utf-8"), max_size=8)


anything = st.recursive(
    st.none() | st.booleans() | numbers | words,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
    max_leaves=6,
)
