"""URScript of a UR arm, interpreted here."""

from __future__ import annotations

import numpy as np

import pinfric as pf


def test_the_urscript_gives_the_constants(ur5):
    """URScript's blocks end with `end`; without them and `local` this program is Python's."""
    scene, motion, made, _ = ur5
    text = pf.export(scene, motion, "ur").text
    lines = [line.replace("local ", "") for line in text.splitlines() if line.strip() != "end"]
    program = {}
    exec("\n".join(lines), program)
    rates = [0.5, -0.4, 0.3, -0.2, 0.1, -0.6]
    torque = program["pinfric_friction"](rates)
    wanted = [
        joint.frictionloss * np.sign(v) + joint.damping * v
        for joint, v in zip(made.joints, rates, strict=True)
    ]
    np.testing.assert_allclose(torque, wanted, rtol=1e-5)
    assert torque[4] > 0.1  # it never moves in the motion: of random states
    slowly = np.array(program["pinfric_friction"]([0.001] * 6))
    np.testing.assert_allclose(
        slowly[0], 0.1 * wanted[0] - 0.049 * made.joints[0].damping, rtol=1e-5
    )
    assert all(f"# {joint.joint}" in text for joint in made.joints)
