"""MJCF models of the kinds that people have, every number in sight: name -> its text."""

_BODY = '<inertial pos="{0}" mass="{1}" diaginertia="0.02 0.03 0.025"/>'
_FULL = '<inertial pos="0.1 0 0.05" mass="1.5" fullinertia="0.02 0.03 0.025 0.001 0.002 -0.001"/>'


def mjcf(bodies, before="", after=""):
    """A whole file."""
    return f'<mujoco model="m">{before}<worldbody>{bodies}</worldbody>{after}</mujoco>'


#: Arms, grippers, legs: defaults within defaults, every orientation, bodies of geoms.
MODELS = {
    "arm": mjcf(
        f"""
        <geom type="plane" size="1 1 1"/>
        <body name="base" pos="0 0 0.1"><inertial pos="0 0 0" mass="4" diaginertia="1 1 1"/>
        <body name="upper" pos="0 0 0.1" euler="30 0 20">
          <joint name="shoulder" axis="1 2 0" pos="0.1 0 0.2" range="-90 90" damping="1"
            frictionloss="0.4" armature="0.1"/>{_FULL}
          <body name="fore" pos="0.3 0 0" quat="0.5 0.1 0.2 0.3">
            <joint name="elbow" axis="0 1 0" ref="30" limited="true" range="-10 50"/>{_FULL}
            <body name="hand" pos="0 0 0.2" xyaxes="0 1 0 -1 0 0.2">
              <joint name="wrist" type="slide" axis="0 1 1" ref="0.1" range="-0.2 0.3"/>
              {_BODY.format("0 0 0.1", 0.4)}</body></body></body></body>""",
        after='<keyframe><key name="home" qpos="0.1 0.2 0.05"/></keyframe>',
    ),
    "defaults": mjcf(
        f"""
        <body name="a" childclass="x"><joint name="z1"/>{_FULL}
          <body name="b" pos="0.2 0 0"><joint name="a2" class="y"/>
            <geom type="capsule" size="0.02" fromto="0 0 0 0.1 0 0.3"/>
            <frame pos="0.1 0 0" euler="0 0 90" childclass="z">
              <body name="c"><joint name="m3"/><geom/></body>
              <geom size="0.03" pos="0 0 0.2" type="sphere" density="400"/>
            </frame></body></body>""",
        before="""<default><joint axis="0 1 0"/>
          <default class="x"><joint axis="1 0 0" armature="0.2"/><geom density="300"/>
            <default class="y"><joint axis="1 1 0"/></default></default>
          <default class="z"><geom type="box" size="0.1 0.2 0.05" euler="10 0 0"/></default>
          </default>""",
    ),
    "geoms": mjcf(
        """
        <body name="a" pos="0 0 0.5"><joint name="j" axis="1 0 0" pos="0 0.1 0"/>
          <geom type="capsule" size="0.05 0.2" euler="0 40 0"/>
          <geom type="box" size="0.05 0.1 0.2" pos="0.1 0 0"/>
          <geom type="sphere" size="0.1" mass="2" pos="0 0 0.3"/>
          <geom type="cylinder" size="0.1 0.2" density="500" axisangle="1 1 0 35"/>
          <geom type="ellipsoid" size="0.1 0.2 0.3" pos="0.2 0 0" zaxis="1 0 1"/>
          <geom type="box" size="0.02 0.03" fromto="0 0 0 0.3 0.1 0"/>
          <geom type="sphere" size="1" group="3"/><geom type="mesh" mesh="shell" mass="0"/>
          <geom type="sphere" size="1" density="0" contype="0" conaffinity="0"/>
        </body>""",
        before="""<compiler inertiagrouprange="0 2"/>
          <asset><mesh name="shell" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>""",
    ),
    "radians": mjcf(
        f"""
        <body name="a" euler="0.3 0.2 0.1"><joint name="j" axis="1 0 0" ref="0.4"
          limited="true" range="-1 1"/>{_FULL}
          <body name="b" euler="0 1.5707963267948966 0" pos="0.1 0.2 0.3">
          <joint name="k" axis="0 0 1"/>{_FULL}</body></body>""",
        before='<compiler angle="radian" eulerseq="ZyX" autolimits="false"/>',
    ),
    "two joints": mjcf(
        f"""
        <body name="a" pos="0 0 1" axisangle="0 1 0 30">
          <joint name="x" axis="1 0 0" pos="0.1 0 0"/><joint name="y" axis="0 1 0" ref="20"/>
          <joint name="s" type="slide" axis="0 0 1"/>{_FULL}
          <body name="b" pos="0.2 0 0"><joint axis="0 1 0"/>{_FULL}</body></body>"""
    ),
    "ball": mjcf(
        f"""
        <body name="a" zaxis="1 0 1"><joint name="z" type="slide" axis="1 0 1"/>{_FULL}
          <body name="b" axisangle="0 1 0 45" pos="0.3 0 0">
            <joint name="k" type="ball" pos="0 0.1 0"/>{_FULL}
            <body name="c" pos="0 0 0.2"><joint name="a" axis="0 1 0"/>{_FULL}</body>
          </body></body>"""
    ),
    "leg": mjcf(
        f"""
        <body name="trunk" pos="0 0 1"><freejoint name="root"/>{_BODY.format("0 0 0.1", 8)}
          <body name="hip" pos="0 0.1 0"><joint name="hip" axis="1 0 0"/>
            {_BODY.format("0 0.05 0", 0.7)}
            <body name="thigh"><joint name="thigh" axis="0 1 0"/>{_FULL}
              <body name="calf" pos="0 0 -0.2"><joint name="calf" axis="0 1 0"/>{_FULL}
                <geom name="foot" size="0.02" pos="0 0 -0.2"/></body></body></body></body>""",
        before='<option gravity="0.3 0 -9.7"/>',
        after='<keyframe><key name="stand" qpos="0 0 .4 1 0 0 0 0 .8 -1.6"/></keyframe>',
    ),
    "unnamed": mjcf(
        f"""
        <body><joint axis="0 1 0"/>{_FULL}<body pos="0.1 0 0.2"><joint/>{_FULL}</body></body>
        <body pos="1 0 0"><joint axis="1 0 0"/>{_FULL}</body>""",
        before='<compiler settotalmass="7" boundmass="2" boundinertia="0.024"/>',
    ),
    "gears": mjcf(
        f"""
        <body name="a"><joint name="j" axis="0 1 0" actuatorfrcrange="-7 5"/>{_FULL}
          <body name="b" pos="0.3 0 0"><joint name="k" axis="0 1 0"/>{_FULL}
          <body name="c" pos="0.3 0 0"><joint name="l" axis="0 1 0"/>{_FULL}
          </body></body></body>""",
        before='<default><position kp="10" forcerange="-3 3"/></default>',
        after="""<actuator><motor joint="k" gear="50" ctrlrange="-1 2"/>
          <position joint="l"/><motor joint="j" gear="100" ctrlrange="-1 1"/></actuator>""",
    ),
    "object": mjcf(
        """
        <body name="box" pos="1 0 0"><joint name="x" type="slide" axis="1 0 0" armature="0.04"/>
          <joint name="y" type="slide" axis="0 1 0" armature="0.04"/><geom size="0.05"/></body>
        <body name="arm"><geom type="mesh" mesh="stand"/><body name="link">
          <joint name="j" axis="0 1 0" armature="0.04"/><geom size="0.05" pos="0.2 0 0"/>
        </body></body>""",
        before='<asset><mesh name="stand" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>',
    ),
    "hollow": mjcf(
        f"""
        <body name="carriage"><joint name="rail" type="slide" axis="1 0 0" range="-1 1"/>
          {_BODY.format("0.1 0 0", 5)}
          <body name="mount" pos="0 0 0.1" euler="0 90 0"><geom size="0.05" mass="1"/>
            <body name="pole" pos="0.1 0 0"><joint name="pole" axis="0 0 1" pos="0 0 -0.05"/>
              {_BODY.format("0 0 0.3", 0.5)}<site name="tip" pos="0 0 0.6"/>
          </body></body></body>""",
        before='<option gravity="0 0 -3"><flag gravity="disable"/></option>',
    ),
}
#: Fingers that joints follow and that pins close.
GRIPPER = mjcf(
    f"""
    <body name="palm"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <body name="left" pos="0 0.05 0"><joint name="left" type="slide" axis="0 1 0"/>{_FULL}</body>
      <body name="right" pos="0 -0.05 0"><joint name="right" type="slide" axis="0 1 0"/>{_FULL}
      </body></body>""",
    after='<equality><joint joint1="left" joint2="right" polycoef="0.01 -2 0 0 0"/></equality>',
)
FOUR_BAR = mjcf(
    f"""
    <body name="crank"><joint name="j1" axis="0 1 0"/>{_BODY.format("0 0 0.1", 0.5)}
      <body name="coupler" pos="0 0 0.2"><joint name="j2" axis="0 1 0"/>
        {_BODY.format("0.15 0 0", 0.5)}<site name="a" pos="0.3 0 0"/></body></body>
    <body name="rocker" pos="0.3 0 0"><joint name="j3" axis="0 1 0"/>{_BODY.format("0 0 0.1", 0.5)}
      <site name="b" pos="0 0 0.2"/></body>""",
    after="<equality>\n{}</equality>",
)


def legged(sides, leg, after=""):
    """A trunk that floats on legs, `leg` with a place and a name to fill in."""
    legs = "".join(leg.format(x, y, name) for name, (x, y) in sides.items())
    body = f"""<body name="trunk" pos="0 0 0.9"><freejoint/>
      <inertial pos="0 0 0" mass="12" diaginertia="0.1 0.3 0.3"/>{legs}</body>"""
    return mjcf(f'<geom type="plane" size="0 0 1"/>{body}', after=after)


_BONE = '<inertial pos="0 0 -0.1" mass="0.6" diaginertia="0.004 0.004 0.001"/>'
#: Feet that are no bodies: a ball at the end of each shank.
QUADRUPED = legged(
    {"fl": (0.2, 0.1), "fr": (0.2, -0.1), "hl": (-0.2, 0.1), "hr": (-0.2, -0.1)},
    f"""<body name="{{2}}_hip" pos="{{0}} {{1}} 0"><joint name="{{2}}_hx" axis="1 0 0"/>{_BONE}
      <body name="{{2}}_thigh"><joint name="{{2}}_hy" axis="0 1 0" range="-60 120"/>{_BONE}
        <body name="{{2}}_calf" pos="0 0 -0.25">
          <joint name="{{2}}_kn" axis="0 1 0" range="-150 -20"/>{_BONE}
          <geom type="capsule" size="0.01" fromto="0 0 0 0 0 -0.1"/>
          <geom size="0.02" pos="-0.01 0 -0.25"/></body></body></body>""",
    '<keyframe><key name="low" qpos="0 0 .2 1 0 0 0'
    + 4 * " 0 1.1 -2.2"
    + '"/><key name="home" qpos="0 0 .3 1 0 0 0'
    + 4 * " 0 0.8 -1.6"
    + '"/></keyframe>',
)
#: Soles of four balls below the ankles.
BIPED = legged(
    {"left": (0, 0.1), "right": (0, -0.1)},
    f"""<body name="{{2}}_hip" pos="{{0}} {{1}} 0"><joint name="{{2}}_hip_roll" axis="1 0 0"/>
      {_BONE}<body name="{{2}}_thigh"><joint name="{{2}}_hip" axis="0 1 0"/>{_BONE}
        <body name="{{2}}_shank" pos="0 0 -0.3">
          <joint name="{{2}}_knee" axis="0 1 0" range="5 140"/>{_BONE}
          <body name="{{2}}_ankle" pos="0 0 -0.3"><joint name="{{2}}_ankle" axis="0 1 0"/>{_BONE}
            <body name="{{2}}_foot"><joint name="{{2}}_ankle_roll" axis="1 0 0"/>
              <inertial pos="0 0 -0.03" mass="0.3" diaginertia="0.001 0.001 0.001"/>
              <geom size="0.005" pos="-0.05 0.03 -0.04"/><geom size="0.005" pos="0.13 0.03 -0.04"/>
              <geom size="0.005" pos="-0.05 -0.03 -0.04"/>
              <geom size="0.005" pos="0.13 -0.03 -0.04"/>
            </body></body></body></body></body>""",
)
