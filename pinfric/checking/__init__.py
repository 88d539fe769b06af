"""Checks: what is implausible about a robot or a scene, and the unit that would explain it.

Takes: a URDF, or a scene with its robot.

Steps: `RobotFacts` reads links and joints, and meshes when a rule asks for them; `link_findings`,
`joint_findings` and `scene_findings` compare them with what robots have.

Gives: `scene.findings`, one list that all commands show and none signs against (`Finding.refuses`);
`CheckReport` holds it for `pinfric check`, and raises on errors.
"""
