"""Export: a scene for other engines and controllers, with the error of each constant.

Takes: a scene, a format of `FORMATS`, and for engines of constant friction a motion.

Steps: `constants` fits each joint's constants along the motion and computes their error; one module
per format writes the file (`mjcf`, `urdf`, `sdf`, ...); `cpp` writes the compensator for
controllers, `mujoco_bridge` runs load-dependent friction inside MuJoCo.

Gives: `Exported`: the file's text, its constants and errors, and what it lacks.
"""
