"""Checks: what is implausible about a robot or a scene, and the unit that would explain it.

Takes: a URDF, or a scene with its robot.

Steps: `RobotFacts` reads links, joints and meshes; `link_findings`, `joint_findings` and
`scene_findings` compare them with what robots have (`USUALLY`).

Gives: `CheckReport`: findings with their place and severity; `check` raises on errors.
"""
