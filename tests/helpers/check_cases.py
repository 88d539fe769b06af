from pinfric.checking.findings import Severity


def errors(report):
    return [f for f in report.findings if f.severity == Severity.ERROR]


ARM = """<robot{name}><link name="base"><inertial><mass value="7"/>{J}</inertial></link>
  <link name="rod"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>{J}</inertial>
    <visual><origin xyz="0 0 0.2"/><geometry><box size="0.05 0.05 0.4"/></geometry></visual></link>
  <link name="tip">{tip}</link>
  <joint name="swing" type="revolute"><parent link="base"/><child link="rod"/>{axis}
    <limit lower="{low}" upper="{high}" effort="40" velocity="3"/>{dynamics}</joint>
  <joint name="turn" type="revolute"><parent link="rod"/><child link="tip"/>
    <origin xyz="0 0 0.4"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="4" velocity="3"/></joint>
  {more}</robot>"""


TIP = '<inertial><mass value="0.5"/>{J}</inertial>'


J = '<inertia ixx="0.02" iyy="0.02" izz="0.0008" ixy="0" ixz="0" iyz="0"/>'


PLAIN = {
    "name": ' name="arm"',
    "tip": TIP,
    "axis": '<axis xyz="0 1 0"/>',
    "low": -2,
    "high": 2,
    "dynamics": "",
    "more": "",
}


GEAR = """<transmission name="t"><joint name="{joint}"/><actuator name="m">
  <mechanicalReduction>{ratio}</mechanicalReduction></actuator></transmission>"""


def arm(folder, **changes):
    text = ARM.format(J="{J}", **(PLAIN | changes)).replace("{J}", J)
    (folder / "arm.urdf").write_text(text)
    return folder / "arm.urdf"


SCENE = """pinfric: 1
robot: {{urdf: arm.urdf, payloads: {{box: {payload}}}, locked: {locked}}}
friction: {{swing: {friction}}}
actuators: {actuators}
simulation: {{t_end: 1.0, start: {{q: {{swing: {start}}}}}}}
"""


GOOD_SCENE = {
    "payload": "{link: rod, mass: 1.0, com: [0, 0, 0.4]}",
    "locked": "{}",
    "friction": "{bearing: {kind: pin, radius: 0.02}, mu: {static: 0.2, kinetic: 0.1}}",
    "actuators": "[{joint: swing, transmission: {ratio: 120}}, {joint: turn}]",
    "start": 0.5,
}
