"""One axis and an arm of two for tests of stops."""

import pinocchio as pin
from builders import chain, lump
from mechanisms import shifted

import pinfric as pf

ARM = {
    "masses": (4.0, 2.5),
    "lengths": (0.6, 0.5),
    "centres": (0.3, 0.25),
    "inertias": (0.15, 0.06),
    "rotors": (1.2e-4, 4e-5),
    "ratios": (80.0, 50.0),
    "friction": (3.0, 1.0),
    "brakes": (0.8, 0.5),
    "delays": (0.02, 0.045),
}


def arm(gravity=-9.81):
    """Two bars that turn about horizontal axes, with Coulomb friction."""
    bodies = [
        lump(mass, [at, 0, 0], inertia)
        for mass, at, inertia in zip(ARM["masses"], ARM["centres"], ARM["inertias"], strict=True)
    ]
    turn, lengths = pin.JointModelRY(), ARM["lengths"]
    elbow = ("elbow", turn, bodies[1], [lengths[0], 0, 0])
    model = chain(("lift", turn, bodies[0]), elbow, gravity=-gravity)
    model.addBodyFrame("tip", 2, shifted(lengths[1]), 0)
    return pf.Scene(
        model,
        friction={
            name: {"coulomb": {"static": F, "kinetic": F}}
            for name, F in zip(("lift", "elbow"), ARM["friction"], strict=True)
        },
        actuators=[
            {"joint": name, "transmission": {"ratio": r, "rotor_inertia": J}}
            for name, r, J in zip(("lift", "elbow"), ARM["ratios"], ARM["rotors"], strict=True)
        ],
        tool="tip",
    )


def axis(joint, body, friction, gravity, **gear):
    """A scene of one joint with Coulomb friction; its gear has no losses unless given."""
    dry = {"axis": {"coulomb": {"static": friction, "kinetic": friction}}} if friction else {}
    return pf.Scene(
        chain(("axis", joint, body), gravity=gravity),
        friction=dry,
        actuators=[{"joint": "axis", "transmission": gear}],
    )


def turntable(friction=0.0, **losses):
    """1 kg m^2 about the vertical, behind a rotor of 1 kg m^2 at the joint: 100^2 x 1e-4."""
    body = lump(1.0, moment=1.0)
    return axis(pin.JointModelRZ(), body, friction, 0.0, ratio=100.0, rotor_inertia=1e-4, **losses)
