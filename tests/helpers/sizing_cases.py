"""One turntable with a trapezoidal cycle, worked out by hand, and a catalogue of one drive."""

import numpy as np
import pinocchio as pin
import yaml
from builders import chain, dry, lump

import pinfric as pf
from pinfric.drives.catalog_file import load_catalog

INERTIA = 2.0  # kg m^2 about the vertical axis: gravity never acts on the drive
COULOMB = 3.0  # N m, at rest as in motion
RATE = 1.5  # rad/s, on the plateau
RAMP, PLATEAU, PAUSE = 0.25, 0.5, 1.0  # s
ACCELERATION = RATE / RAMP
CYCLE = 2 * RAMP + PLATEAU + PAUSE
#: s; a jump of the acceleration stands between two samples this close.
_JUMP = 1e-10

MOTOR = yaml.safe_load("""
source: invented
grade: R
continuous_torque: 0.5
peak_torque: 2.0
torque_constant: 0.1
resistance: 0.8
rotor_inertia: 5.0e-5
mass: 0.6
max_speed: 600.0
thermal:
  winding_housing: 2.0
  housing_ambient: 3.0
  winding_time: 20.0
  housing_time: 300.0
  max_winding: 125.0
""")
GEAR = yaml.safe_load("""
source: invented
grade: R
ratio: 100.0
rated_torque: 30.0
average_torque: 40.0
repeated_peak_torque: 60.0
momentary_peak_torque: 100.0
rated_speed: 200.0
average_input_speed: 300.0
max_input_speed: 700.0
input_inertia: 1.0e-5
mass: 0.9
nominal_life: 35000.0
efficiency: 0.8
back_efficiency: 0.7
stiffness: 1.0e+4
back_driving_torque: 3.0
bearing: {kind: crossed roller, max_moment: 1.0e+5, max_radial: 1.0e+6, max_axial: 1.0e+6}
""")
#: At which makers rate motors: nothing is derated, and nothing kept in reserve.
COOL = {"ambient": 25.0, "rms_factor": 1.0}


def write_catalog(path, motors=None, gears=None, **more):
    """Write a catalogue file; None takes the one motor, the one gear."""
    content = {"pinfric_catalog": 1, **more}
    content["conditions"] = COOL | content.get("conditions", {})
    content["motors"] = {"M": MOTOR} if motors is None else motors
    content["gears"] = {"G": GEAR} if gears is None else gears
    path.write_text(yaml.safe_dump(content))
    return path


def one_drive(tmp_path, motor=None, gear=None, **more):
    """A catalogue of one motor and one gear, each with figures changed (None leaves one out)."""
    motors = {"M": {k: v for k, v in {**MOTOR, **(motor or {})}.items() if v is not None}}
    gears = {"G": {k: v for k, v in {**GEAR, **(gear or {})}.items() if v is not None}}
    return load_catalog(write_catalog(tmp_path / "catalog.yaml", motors, gears, **more))


def turntable(**scene):
    """One body whose effort is INERTIA x acceleration + friction."""
    body = pin.Inertia(1.0, np.zeros(3), INERTIA * np.diag([0.5, 0.5, 1.0]))
    model = chain(("table", pin.JointModelRZ(), body))
    if "friction" not in scene:
        scene["friction"] = {"table": dry(COULOMB)}
    scene.setdefault("stick_velocity", 0.0)  # rest is v = 0 exactly: the cycle has no jitter
    return pf.Scene(model=model, **scene)


def trapezoid(scene, samples=400):
    """Speed up, run, slow down, stand: accelerations constant in each part, jumps between."""
    a, v = ACCELERATION, RATE
    t1, t2, t3, t4 = np.cumsum([RAMP, PLATEAU, RAMP, PAUSE])
    parts = [  # start, end, velocity at the start, acceleration
        (0.0, t1, 0.0, a),
        (t1, t2, v, 0.0),
        (t2, t3, v, -a),
        (t3, t4, 0.0, 0.0),
    ]
    rows = []
    for start, end, v0, acceleration in parts:
        last = end if end == t4 else end - _JUMP
        # at v = 0 exactly friction is an interval: begin just after the jump
        first = start + _JUMP * (1 if start in (0.0, t2) else 0)
        t = np.linspace(first, last, samples)
        rows.append((t, v0 + acceleration * (t - start), np.full(samples, acceleration)))
    t, v, a = (np.concatenate(column) for column in zip(*rows, strict=True))
    # positions do not matter: nothing depends on the angle
    return pf.Trajectory.from_arrays(scene, t, np.zeros((len(t), 1)), v[:, None], a[:, None])


def sized_cycle(catalog=None, scene=None, **more):
    """`pf.size` of the trapezoidal cycle, by default of the turntable."""
    scene = scene or turntable()
    return pf.size(scene, trapezoid(scene), catalog, **more)


def hour_with_a_stall(stall=300.0, move=2.0):
    """A pendulum held out for `stall` seconds at 2.5 times MOTOR's continuous torque, then hanging.

    Returns:
        scene, trajectory of an hour, and arguments of `one_drive` for a drive that fits but for
            this.
    """
    effort = 2.5 * MOTOR["continuous_torque"] * GEAR["ratio"] * GEAR["efficiency"]
    body = lump(effort / 9.81, [1.0, 0.0, 0.0])
    model = chain(("table", pin.JointModelRY(), body))
    scene = pf.Scene(model=model, stick_velocity=0.0)
    s = np.linspace(0.0, 1.0, 101)
    shape = 10 * s**3 - 15 * s**4 + 6 * s**5
    rates = (30 * s**2 - 60 * s**3 + 30 * s**4) / move
    accelerations = (60 * s - 180 * s**2 + 120 * s**3) / move**2
    down, still = np.pi / 2, np.zeros(2)
    t = np.concatenate([[0.0], stall + move * s, 3600.0 - move + move * s])
    q = np.concatenate([[0.0], down * shape, down * (1 - shape)])
    v = np.concatenate([still[:1], down * rates, -down * rates])
    a = np.concatenate([still[:1], down * accelerations, -down * accelerations])
    for x in (v, a):
        x[[1, 101, 102, 202]] = 0.0
    hour = pf.Trajectory.from_arrays(scene, t, q[:, None], v[:, None], a[:, None])
    strong = dict.fromkeys(("average_torque", "repeated_peak_torque", "momentary_peak_torque"), 300)
    drive = {
        "motor": {"peak_torque": 5.0},
        "gear": strong | {"stiffness": 1e5},
        "conditions": {"inertia_ratio": 20.0},
    }
    return scene, hour, drive
